"""Seals of suction cups: where a lip lies on a surface all around, and its pose there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lis_grasp.geometry import tangent_frame, unit
from lis_grasp.robots.robot_model import Cup
from lis_grasp.shapes.mesh_distance import MeshTree
from lis_grasp.typing import BoolArray, FloatArray

# Points of a lip, the gap that still seals [m], and rounds of fitting the lip to the surface.
_LIP, _GAP, _ROUNDS = 32, 5e-4, 4


class Seals(NamedTuple):
    """Cups pressed on a surface: which seal, and the poses of their lips."""

    sealed: BoolArray  #: (P,)
    centers: FloatArray  #: (P, 3) [m]: of the lips' circles
    axes: FloatArray  #: (P, 3), unit: outward of the object


def press_cups(tree: MeshTree, points: FloatArray, normals: FloatArray, cup: Cup) -> Seals:
    """Press cups on a surface at points (P, 3) [m], against outward unit normals (P, 3).

    A cup seals if 32 points of its lip are within 0.5 mm of the surface, after the lip has moved
    along its axis by at most its travel, and turned by at most its tilt. The lip follows the
    surface by least squares: the median of the gaps along its axis, and their first harmonic.
    Leaks of rough or porous surfaces are not part of it.

    Examples
    --------
    >>> box = shapes.find("box").mesh
    >>> top = np.array([[0.0, 0.0, box.bounds[1, 2]]])
    >>> press_cups(MeshTree(box), top, np.array([[0.0, 0.0, 1.0]]), Hand.load("cup").cup).sealed
    array([ True])
    """
    centers, axes = points.copy(), normals.copy()
    sealed, open_ = np.zeros(len(points), dtype=np.bool_), np.arange(len(points))
    for _ in range(_ROUNDS):
        fits, moved, turned = _follow(tree, centers[open_], axes[open_], cup.radius)
        sealed[open_] = fits
        travel = np.abs(np.einsum("pi,pi->p", moved - points[open_], normals[open_]))
        may = np.einsum("pi,pi->p", turned, normals[open_]) > np.cos(cup.tilt)
        may &= (travel <= cup.travel) & ~fits
        open_ = open_[may]
        centers[open_], axes[open_] = moved[may], turned[may]
    return Seals(sealed, centers, axes)


def _follow(
    tree: MeshTree, centers: FloatArray, axes: FloatArray, radius: float
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return which lips seal where they are, and the poses that follow the surface better."""
    angles = 2.0 * np.pi * np.arange(_LIP) / _LIP
    one, two = np.moveaxis(tangent_frame(axes), -2, 0)
    ways = np.cos(angles)[:, None] * one[:, None] + np.sin(angles)[:, None] * two[:, None]
    lip = centers[:, None] + radius * ways  # (P, L, 3)
    squares, _, nearest = tree.nearest(lip.reshape(-1, 3))
    gaps = np.sqrt(squares).reshape(lip.shape[:2])
    heights = np.einsum("pli,pi->pl", nearest.reshape(lip.shape) - lip, axes)
    rise = np.median(heights, axis=1)
    waves = np.stack([(heights * wave).mean(axis=1) for wave in (np.cos(angles), np.sin(angles))])
    slopes = 2.0 / radius * waves
    turned = unit(axes - slopes[0, :, None] * one - slopes[1, :, None] * two)
    fits = np.asarray((gaps <= _GAP).all(axis=1))
    return fits, centers + rise[:, None] * axes, turned
