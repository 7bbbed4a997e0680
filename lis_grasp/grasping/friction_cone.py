"""Coulomb friction cones, linearised to pyramids of forces."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.typing import FloatArray

CONE_EDGES = 8
"""Edges of a friction pyramid."""


def cone_edges(normals: npt.ArrayLike, friction: float, *, edges: int = CONE_EDGES) -> FloatArray:
    """Return the edges of linearised Coulomb friction cones.

    The cone ``|f_t| <= mu f_n`` becomes the pyramid of forces with normal part 1 and tangential
    part mu in `edges` (at least 3) directions, so every non-negative combination is inside the
    cone. Unit normals (..., C, 3), OUTWARD of the object, give forces on the object (..., C, edges,
    3), which point inward.
    """
    if not (np.isfinite(friction) and friction >= 0.0):
        raise InvalidOptionError.out_of_range("friction", friction, "a number of at least 0")
    if edges < 3:
        raise InvalidOptionError.out_of_range("edges", edges, "at least 3")
    inward = -np.asarray(normals, dtype=np.float64)
    # The axis least aligned with the normal makes a tangent.
    helper = np.eye(3)[np.argmin(np.abs(inward), axis=-1)]
    first = np.cross(inward, helper)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(inward, first)
    angles = 2.0 * np.pi * np.arange(edges) / edges
    tangents = np.cos(angles)[:, None] * first[..., None, :]
    tangents += np.sin(angles)[:, None] * second[..., None, :]
    return np.asarray(inward[..., None, :] + friction * tangents)
