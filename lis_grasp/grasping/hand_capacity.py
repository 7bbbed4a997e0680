"""Capacity of a hand: grip forces, loads and accelerations within its efforts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from lis_grasp.geometry import cross
from lis_grasp.grasping._expanding_polytope import inscribed_ball_radii
from lis_grasp.grasping.contact_wrenches import WrenchModel, cone_edges
from lis_grasp.grasping.epsilon import ROBUST_FRACTION
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

EFFORT_FRACTION = 0.9
"""Fraction of the joint efforts for a squeeze: the springs need some to keep the posture."""

# Balance first, then the total, whose weight is 1, then evenness.
_BALANCE_WEIGHT = 100.0
_EVENNESS_WEIGHT = 0.03


def grip_fraction(
    hand: Hand, X_OH: npt.ArrayLike, q: npt.ArrayLike, fingers: Sequence[str], forces: FloatArray
) -> float:
    """Return the largest fraction, at most 1, of contact forces that a hand can exert.

    Joint efforts are ``tau = J^T f`` with the Jacobian J of the pads' centres: a force along the
    normal of a round pad passes through its centre. No effort exceeds 0.9 of its limit.

    The palm is at `X_OH` (4, 4) with joint positions `q` (J,) [rad or m]; `fingers` exert `forces`
    (C, 3) [N] on the object, in O.
    """
    _, _, jacobian, _ = hand.pad_jacobians(X_OH, q)  # (F, 3, 6 + J)
    efforts = np.zeros(jacobian.shape[-1] - 6)
    for finger, force in zip(fingers, forces, strict=True):
        efforts += jacobian[hand.fingers.index(finger), :, 6:].T @ force
    load = float(np.max(np.abs(efforts) / (EFFORT_FRACTION * hand.effort_limits), initial=0.0))
    return 1.0 / max(load, 1.0)


def largest_forces(
    hand: Hand, X_OH: FloatArray, q: FloatArray, used: BoolArray, forces: FloatArray
) -> FloatArray:
    """Return how many times each finger can exert each of several forces at its contact.

    No joint effort exceeds 0.9 of its limit, and no normal part of a force is larger than
    `hand.max_contact_force`. Fingers that one motor moves share its effort evenly. Efforts are
    computed for a force at the centre of the pad; on a rounded pad, at planned contacts, this makes
    the factors up to 6 % too large or 3 % too small.

    Palm poses (B, 4, 4) in O, joint positions (B, J) [rad or m], the pads `used` (B, F), and forces
    (B, F, K, 3) in O of unit normal part give factors (B, F, K) [N], 0 without a contact.
    """
    jacobian = hand.pad_jacobians(X_OH, q)[2][..., 6:] * used[..., None, None]  # (B, F, 3, J)
    sharing = np.maximum((np.abs(jacobian).max(axis=2) > 0.0).sum(axis=1), 1)  # (B, J)
    limits = EFFORT_FRACTION * hand.effort_limits / sharing
    efforts = np.abs(forces @ jacobian) / limits[:, None, None]  # (B, F, K, J)
    return used[..., None] / np.maximum(efforts.max(axis=-1), 1.0 / hand.max_contact_force)


def spare_accelerations(
    wrenches: FloatArray, masses: npt.ArrayLike, *, scale: float, tolerance: float
) -> FloatArray:
    """Return the largest acceleration that each grasp adds, in any direction, to holding a weight.

    Every contact exerts, independently of the others, a force in the convex hull of its largest
    ones and none: the wrenches of a grasp are the Minkowski sum of these hulls (the L-infinity
    metric of Ferrari and Canny 1992, with a limit for each contact). The acceleration is the
    distance of the weight from the border of this set, divided by the mass, and 0 where the weight
    is outside.

    `wrenches` (B, C, K, 6) are the largest primitive ones of the contacts, torques about the centre
    of mass in the metric of `WrenchModel.torque_metric` [N]; +z points upwards. With M `masses` of
    the object [kg] they give accelerations (M, B) [m/s^2]. Results are precise to some millionths
    of a usual force `scale` [N]; the distance may be too small by the fraction `tolerance`.
    """
    scaled, masses = wrenches / scale, np.asarray(masses, dtype=np.float64)
    weights = np.zeros((len(masses), 6))
    weights[:, 2] = masses * GRAVITY / scale

    def farthest(directions: FloatArray, bodies: IndexArray) -> FloatArray:
        mass, grasp = np.divmod(bodies, len(scaled))
        own = scaled[grasp]  # (b, C, K, 6)
        along = (own @ directions[:, None, :, None])[..., 0]  # (b, C, K)
        chosen = along.argmax(axis=-1)[..., None]
        best = np.take_along_axis(own, chosen[..., None], axis=2)[:, :, 0]
        pushes = np.take_along_axis(along, chosen, axis=2) > 0.0  # (b, C, 1)
        return np.asarray((best * pushes).sum(axis=1) - weights[mass])

    radii = inscribed_ball_radii(farthest, len(masses) * len(scaled), tolerance=tolerance)
    return scale * radii.reshape(len(masses), -1) / masses[:, None]


def largest_wrenches(
    hand: Hand,
    model: WrenchModel,
    X_OH: FloatArray,
    q: FloatArray,
    used: BoolArray,
    points: FloatArray,
    normals: FloatArray,
) -> FloatArray:
    """Return the largest wrenches that fingers exert at contacts (B, F, 3), shape (B, F, K, 6).

    They are the wrenches of the model's primitive forces and of the normal forces, times
    `largest_forces`, which explains X_OH, q and used.
    """
    push = WrenchModel(
        0.0, "frictionless", origin=model.origin, torque_metric=model.torque_metric
    ).wrenches(points, normals)
    wrenches = np.concatenate([model.wrenches(points, normals), push], axis=2)
    return wrenches * largest_forces(hand, X_OH, q, used, wrenches[..., :3])[..., None]


def least_pinched_height(hand: Hand, friction: float) -> float:
    """Return the height of an object on a support below which a hand cannot pinch it [m].

    A ball of radius r on the support touches an object of height h < r from above, at an elevation
    whose sine is ``1 - h / r`` or more. At half the friction, all such contacts together push the
    object down if its tangent exceeds ``friction / 2``. The height is 0 for flat pads, which reach
    the support.
    """
    radius = min(pad.radius for pad in hand.pads)
    return float(radius * (1.0 - np.sin(np.arctan(ROBUST_FRACTION * friction))))


def narrowest_width(mesh: trimesh.Trimesh) -> float:
    """Return the least distance between two parallel planes with the mesh in between [m].

    The least over the facets of its convex hull. The width of a convex polyhedron is that of a
    facet, or of two edges (Houle and Toussaint 1988), which are left out: this is an upper bound.
    """
    hull = ConvexHull(mesh.vertices)
    corners = hull.points[hull.vertices]
    normals = np.unique(np.round(hull.equations[:, :3], 6), axis=0)
    return float(min(np.ptp(corners @ normal) for normal in normals))


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
    sums = np.ones((1, unknowns))
    matrix = np.vstack([_BALANCE_WEIGHT * columns, sums, _EVENNESS_WEIGHT * np.eye(unknowns)])
    wanted = np.zeros(6)
    if load is not None:
        force, point = load
        turning = cross(point - points.mean(axis=0), force) / length
        wanted = -_BALANCE_WEIGHT * np.concatenate([force, turning])
    coefficients, _ = nnls(matrix, np.concatenate([wanted, [total], even]))
    return np.einsum("ce,cek->ck", coefficients.reshape(len(points), -1), edges)
