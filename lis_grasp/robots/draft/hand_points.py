"""Points on the links of a hand: vertices of their bodies, and the farthest from a joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.geometry import apply_pose
from lis_grasp.robots.hand_parts import LinkGeometry
from lis_grasp.robots.link_bodies import fibonacci_directions
from lis_grasp.robots.link_tree import HandModel
from lis_grasp.typing import FloatArray

_KEPT = 60  # points of a body


def points_of_bodies(bodies: Sequence[LinkGeometry]) -> FloatArray:
    """Return all vertices of bodies of one link, shape (N, 3) [m], in the link frame."""
    placed = [apply_pose(b.X_LG, np.asarray(b.mesh.vertices)) for b in bodies]
    return np.vstack([np.empty((0, 3)), *placed])


def link_points(model: HandModel) -> dict[str, FloatArray]:
    """Return by link some vertices of its bodies, (N, 3) [m], in the link frame.

    They are the outermost ones along directions spread over the sphere, so that extents along any
    direction are exact to a small fraction of a body's size.
    """
    points: dict[str, list[FloatArray]] = {}
    directions = fibonacci_directions(_KEPT)
    for body in model.link_geometries:
        p_L = points_of_bodies([body])
        if len(p_L) > _KEPT:
            p_L = p_L[np.unique(np.argmax(p_L @ directions.T, axis=0))]
        points.setdefault(body.link, []).append(p_L)
    return {link: np.vstack(parts) for link, parts in points.items()}


def reach(p_L: FloatArray, origin_L: FloatArray, axis_L: FloatArray) -> FloatArray:
    """Return the vector (3,) [m] from a joint to the points farthest from its axis, across it."""
    arms = p_L - origin_L
    arms = arms - np.outer(arms @ axis_L, axis_L)
    lengths = np.linalg.norm(arms, axis=1)
    return np.asarray(arms[lengths >= 0.9 * lengths.max()].mean(axis=0))
