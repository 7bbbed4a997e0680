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
from lis_grasp.visualization.view_layers import SeenSurface, depth_picture


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


def test_the_picture_has_the_object_in_colours_and_holes_in_black(scenario: Scenario) -> None:
    (view,) = scenario.agent.seen_by
    depth = view.depth.copy()
    depth[:20, :20] = np.nan
    pixels = np.array(Image.open(io.BytesIO(depth_picture(replace(view, depth=depth)))))
    mask = (view.object_mask & np.isfinite(depth))[::2, ::2]
    coloured = np.ptp(pixels.astype(int), axis=2) > 10
    assert pixels.shape == (240, 320, 3)
    assert coloured[mask].mean() > 0.9
    assert not coloured[~view.object_mask[::2, ::2]].any()
    assert not pixels[:10, :10].any()
