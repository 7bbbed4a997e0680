"""Grip forces: contact forces that squeeze an object in balance."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from lis_grasp.geometry import cross
from lis_grasp.grasping.contact_wrenches import cone_edges
from lis_grasp.typing import FloatArray

# Balance first, then the total, then evenness: each two orders of magnitude behind the last.
_BALANCE_WEIGHT = 100.0
_TOTAL_WEIGHT = 1.0
_EVENNESS_WEIGHT = 0.03


def balanced_grip(
    points: FloatArray,
    normals: FloatArray,
    *,
    friction: float,
    total: float,
    load: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """Return contact forces that squeeze the object and balance a load.

    Forces ``f_i = sum_e a_ie d_ie`` are non-negative sums of the edges ``d_ie`` of each contact's
    friction cone (Kerr and Roth 1986: internal forces inside linearised cones). The coefficients
    solve the non-negative least-squares problem

        min  w_b^2 |f_L + sum f_i|^2 + w_b^2 |(p_L - c) x f_L + sum (p_i - c) x f_i|^2 / l^2
             + w_t^2 (sum_ie a_ie - total)^2 + w_e^2 sum_ie (a_ie - total / n)^2

    whose last term spreads the force evenly and away from the borders of the cones. ``c`` is the
    points' centroid and ``l`` their mean distance from it. Contacts without an equilibrium inside
    their cones get the squeeze that is least out of balance.

    Points (C, 3) [m], C >= 1, and unit outward normals (C, 3) in any frame, the cones' Coulomb
    coefficient, the sum `total` of the normal forces [N], and the `load`, a force f_L (3,) [N] that
    acts on the object at p_L (3,) [m], give forces on the object (C, 3) [N]. Without a load the
    forces cancel each other.
    """
    arms = points - points.mean(axis=0)  # (C, 3)
    length = max(float(np.linalg.norm(arms, axis=1).mean()), 1e-6)
    edges = cone_edges(normals, friction)  # (C, E, 3)
    wrenches = np.concatenate([edges, cross(arms[:, None], edges) / length], axis=2)  # (C, E, 6)
    columns = wrenches.reshape(-1, 6).T  # (6, C E)
    unknowns = columns.shape[1]
    even = np.full(unknowns, _EVENNESS_WEIGHT * total / unknowns)
    sums = _TOTAL_WEIGHT * np.ones((1, unknowns))
    matrix = np.vstack([_BALANCE_WEIGHT * columns, sums, _EVENNESS_WEIGHT * np.eye(unknowns)])
    wanted = np.zeros(6)
    if load is not None:
        force, point = load
        turning = cross(point - points.mean(axis=0), force) / length
        wanted = -_BALANCE_WEIGHT * np.concatenate([force, turning])
    coefficients, _ = nnls(matrix, np.concatenate([wanted, [_TOTAL_WEIGHT * total], even]))
    return np.einsum("ce,cek->ck", coefficients.reshape(len(points), -1), edges)
