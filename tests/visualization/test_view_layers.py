"""Layers of a view on the page: seen, guessed and unknown surface apart, and the depth image."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from lis_grasp.contacts import Contacts
from lis_grasp.stages.scenario import Scenario
from lis_grasp.task.task import Task
from lis_grasp.visualization import Scene
from lis_grasp.visualization.view_layers import (
    GUESSED_COLOUR,
    UNKNOWN_COLOUR,
    SeenSurface,
    depth_picture,
)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Scenario.from_config(Task.of("box", hand="wsg50", prober="kinematic", camera=True))


def test_a_page_distinguishes_what_was_seen_guessed_and_is_unknown(scenario: Scenario) -> None:
    given = scenario.agent.perception.prior.given(Contacts.empty())
    (view,) = scenario.agent.seen_by
    truth = scenario.truth.shape.mesh
    some = SeenSurface(view, given.seen, given.guesses.subset(slice(0, 1)))
    page = Scene(truth=truth, estimate=truth.subdivide(), seen=some).html()
    for layer in ("seen", "guessed", "unknown"):
        assert f'data-layer="{layer}"' in page
    assert 'alt="Depth image"' in page
    blind = Scene(truth=truth, estimate=truth).html()
    assert 'data-layer="seen"' not in blind
    assert "Depth image" not in blind


def test_the_picture_has_the_object_in_colours_and_marks_guesses(scenario: Scenario) -> None:
    (view,) = scenario.agent.seen_by
    rows, columns = np.nonzero(view.object_mask)
    corner = rows.min() - 40, columns.min() - 40  # of the picture in the image
    depth = view.depth.copy()
    depth[corner[0] : corner[0] + 10, corner[1] : corner[1] + 10] = np.nan
    view = replace(view, depth=depth)
    place = view.project(view.contacts.points[:1])[0, :2]
    drawn = depth_picture(view, view.contacts.subset(slice(0, 1)))
    pixels = np.array(Image.open(io.BytesIO(drawn)))
    assert pixels.shape == (np.ptp(rows) + 81, np.ptp(columns) + 81, 3)
    part = tuple(slice(low, low + n) for low, n in zip(corner, pixels.shape, strict=False))
    mask = view.object_mask[part]
    coloured = np.ptp(pixels.astype(int), axis=2) > 10
    assert coloured[mask].mean() > 0.9
    assert not coloured[~mask & np.isfinite(depth[part])].any()
    hole, grey = "#{:02x}{:02x}{:02x}".format(*tuple(pixels[5, 5])), pixels[5, 60]
    assert hole == UNKNOWN_COLOUR
    assert np.ptp(grey) == 0
    column, row = np.round(place).astype(int) - corner[::-1]
    assert "#{:02x}{:02x}{:02x}".format(*tuple(pixels[row, column])) == GUESSED_COLOUR
