"""Exposure of inner links in a search, against single points."""

from __future__ import annotations

import numpy as np
import pytest

from lis_grasp.probing.exposure import SPACING, exposed_width

ALONG = np.array([1.0, 0.0, 0.0])
TIP = np.array([[0.0, 0.0, 0.005]])


def test_a_link_behind_the_tip_meets_nothing_first() -> None:
    widths = [exposed_width(TIP - [lag, 0.0, 0.0], TIP, ALONG, 0.0) for lag in (0.001, 0.1)]
    assert widths == [0.0, 0.0]


def test_a_link_ahead_is_exposed_on_the_whole_width_of_an_object() -> None:
    width = exposed_width(TIP + [0.01, 0.0, 0.0], TIP, ALONG, 0.0)
    # Cylinders of 3, 5 and 5 cm radius: their mean diameter.
    assert width == pytest.approx(2.0 * np.mean([0.03, 0.05, 0.05]), abs=SPACING)


def test_a_link_above_all_objects_is_not_exposed() -> None:
    high = TIP + [0.05, 0.0, 0.25]
    assert exposed_width(high, TIP, ALONG, 0.0) == 0.0
    # Of three objects one is higher than 15 cm, and its diameter is 10 cm.
    width = exposed_width(high - [0.0, 0.0, 0.1], TIP, ALONG, 0.0)
    assert width == pytest.approx(0.1 / 3.0, abs=SPACING)


@pytest.mark.parametrize("turn", [0.4, 2.0, -1.1])
def test_exposure_does_not_depend_on_the_direction_in_the_plane(turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    inner = np.array([[0.0, 0.04, 0.02], [-0.02, -0.06, 0.08], [0.01, 0.1, 0.15]])
    here = exposed_width(inner, TIP, ALONG, 0.0)
    assert here > 0.0
    assert exposed_width(inner @ R.T, TIP @ R.T, R @ ALONG, 0.0) == pytest.approx(here, abs=SPACING)


def test_more_fingertips_side_by_side_leave_less_exposed() -> None:
    inner = np.array([[-0.03, y, 0.03] for y in np.linspace(-0.06, 0.06, 13)])
    rake = np.array([[0.0, y, 0.005] for y in (-0.045, 0.0, 0.045)])
    assert exposed_width(inner, rake, ALONG, 0.0) < 0.5 * exposed_width(inner, TIP, ALONG, 0.0)


def test_a_hand_of_fingertips_alone_is_not_exposed() -> None:
    assert exposed_width(np.empty((0, 3)), TIP, ALONG, 0.0) == 0.0
