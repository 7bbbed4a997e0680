"""Stills: required arguments, colour bar, object and hand."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from lis_grasp import Contacts, Hand, PatchImplicitSurface, extract_mesh, shapes
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.visualization.colours import ColourScale
from lis_grasp_studies.figures.static_scene import draw_still


def _polygons(axes) -> PolyCollection:
    (collection,) = (c for c in axes.collections if isinstance(c, PolyCollection))
    return collection


def _touched_cube() -> Contacts:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    return Contacts(0.03 * axes, axes)


def test_a_still_needs_an_object_or_an_estimate() -> None:
    with pytest.raises(InvalidOptionError) as error:
        draw_still(Figure().subplots(), contacts=_touched_cube())
    assert error.value.option == "truth"


def test_the_colour_bar_is_in_millimetres_of_the_scale_given() -> None:
    mesh = extract_mesh(PatchImplicitSurface.from_contacts(_touched_cube()), resolution=0.004)
    bar = draw_still(Figure().subplots(), estimate=mesh, scale=ColourScale(0.0, 0.003))
    assert bar is not None
    assert bar.norm.vmin == 0.0
    assert bar.norm.vmax == pytest.approx(3.0, abs=1e-12)


def test_an_estimate_without_uncertainty_has_no_colour_bar() -> None:
    assert draw_still(Figure().subplots(), estimate=shapes.build("box").mesh) is None


def test_a_hand_adds_polygons_beyond_the_object() -> None:
    box, hand = shapes.build("box"), Hand.load("wsg50")
    alone, held = Figure().subplots(), Figure().subplots()
    draw_still(alone, truth=box)
    X_OH = np.eye(4)
    X_OH[:3, 3] = [0.0, 0.0, 0.3]
    links = hand.forward_kinematics(X_OH, hand.lower)
    draw_still(held, truth=box, hand=hand, links=links)
    assert len(_polygons(held).get_paths()) > len(_polygons(alone).get_paths())
    assert np.ptp(held.get_ylim()) > np.ptp(alone.get_ylim())


def test_a_still_is_the_same_at_every_size() -> None:
    small, large = Figure().subplots(), Figure().subplots()
    draw_still(small, truth=shapes.build("box", 0.05))
    draw_still(large, truth=shapes.build("box", 0.2))
    assert np.allclose(small.get_xlim(), large.get_xlim(), atol=1e-12)
    assert len(_polygons(small).get_paths()) == len(_polygons(large).get_paths())
