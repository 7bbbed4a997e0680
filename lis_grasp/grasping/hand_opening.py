"""Largest opening of a hand, and whether an object's narrowest width fits into it."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray

# Postures sampled between the joints' limits; a fixed seed, as no result depends on the draw much.
_POSTURES, _SEED = 4000, 0
# Pads oppose each other if the cosine between their axes is below this (within 60 degrees).
_OPPOSED = -0.5
# Directions checked at once.
_CHUNK = 256


def largest_opening(hand: Hand) -> float:
    """Return the largest distance between two pads that face each other [m].

    Over random postures between the joints' limits, and the pregrasps; a lower bound that is close
    to the true value for few joints. 0 if no two pads ever face each other.
    """
    rng = np.random.default_rng(_SEED)
    low, high = hand.lower, hand.upper
    postures = low + (high - low) * rng.random((_POSTURES, len(low)))
    postures = np.vstack([postures, low, high, *(list(hand.pregrasps.values()) or [low])])
    centers = hand.pad_centers(np.eye(4), postures)  # (B, F, 3)
    axes = hand.pad_axes(np.eye(4), postures)
    between = centers[:, None] - centers[:, :, None]  # (B, F, F, 3), from the first pad
    facing = np.einsum("bik,bjk->bij", axes, axes) < _OPPOSED
    facing &= np.einsum("bik,bijk->bij", axes, between) > 0.0
    lengths = np.linalg.norm(between, axis=-1)
    return float(lengths[facing].max(initial=0.0))


def narrowest_width(mesh: trimesh.Trimesh) -> float:
    """Return the least distance between two parallel planes with the mesh in between [m].

    Over the facets of its convex hull: the width of a convex polyhedron is that of a facet, or of
    two edges (Houle and Toussaint 1988), which are left out. So this is an upper bound.
    """
    hull = ConvexHull(mesh.vertices)
    corners = hull.points[hull.vertices]
    normals = np.unique(np.round(hull.equations[:, :3], 6), axis=0)
    widths: list[FloatArray] = []
    for start in range(0, len(normals), _CHUNK):
        heights = corners @ normals[start : start + _CHUNK].T
        widths.append(np.ptp(heights, axis=0))
    return float(np.concatenate(widths).min())
