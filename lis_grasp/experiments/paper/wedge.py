"""The paper's noise experiment: 12 contacts round a 90 degree edge (section IV.E, fig. 12)."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.experiments.compared_estimators import Noise
from lis_grasp.shapes import Shape

NOISE_LEVELS = tuple(
    Noise(1e-3 * millimetres, float(np.deg2rad(degrees)))
    for millimetres, degrees in ((0, 0), (1, 2.5), (2, 5), (4, 10), (6, 15), (8, 20))
)
"""Noise of position and normal, from none to more than any sensor has."""

_SPACING = 0.05
_SIDE = 0.6


def wedge() -> Shape:
    """Return a large cube with an edge along y at the origin; its other edges are far away."""
    half = 0.5 * _SIDE
    cube = trimesh.creation.box(bounds=[[-_SIDE, -half, -_SIDE], [0.0, half, 0.0]])
    return Shape.from_mesh("wedge", cube)


def touch_wedge() -> Contacts:
    """Return 12 contacts 50 mm apart: 2 columns of 3 on each face, the first 25 mm from the edge.

    The paper gives their number and spacing; their arrangement is ours.
    """
    away = -_SPACING * np.array([0.5, 1.5])
    along = _SPACING * np.array([-1.0, 0.0, 1.0])
    a, y = (values.ravel() for values in np.meshgrid(away, along))
    zero, one = np.zeros(6), np.ones(6)
    top = np.column_stack([a, y, zero]), np.column_stack([zero, zero, one])
    side = np.column_stack([zero, y, a]), np.column_stack([one, zero, zero])
    return Contacts(np.vstack([top[0], side[0]]), np.vstack([top[1], side[1]]))
