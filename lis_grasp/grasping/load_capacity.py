"""Accelerations that a hand can give an object while it carries it, within its joint efforts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.expanding_polytope import inscribed_ball_radii
from lis_grasp.grasping.grip_capacity import EFFORT_FRACTION
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.typing import BoolArray, FloatArray, IndexArray


def largest_forces(
    hand: Hand, X_OH: FloatArray, q: FloatArray, used: BoolArray, forces: FloatArray
) -> FloatArray:
    """Return how many times each finger can exert each of several forces at its contact.

    No joint effort exceeds 0.9 of its limit, and no normal part of a force is larger than
    `hand.max_contact_force`. Fingers that one motor moves share its effort evenly. Efforts are
    those of a force at the centre of the pad; on a rounded pad, at planned contacts, this makes the
    factors up to 6 % too large or 3 % too small.

    Parameters
    ----------
    hand
        The hand.
    X_OH, q
        Shapes (B, 4, 4) and (B, J): palm poses in O, and joint positions [rad or m].
    used
        Shape (B, F): which pads have a contact.
    forces
        Shape (B, F, K, 3): forces in O, of unit normal part.

    Returns
    -------
    factors
        Shape (B, F, K) [N], 0 without a contact.
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

    Parameters
    ----------
    wrenches
        Shape (B, C, K, 6): largest primitive wrenches of the contacts, torques about the centre of
        mass in the metric of `WrenchModel.torque_metric` [N]; +z points upwards.
    masses
        Shape (M,): masses of the object [kg].
    scale
        A usual force [N]; results are precise to some millionths of it.
    tolerance
        Fraction by which the distance may be too small.

    Returns
    -------
    accelerations
        Shape (M, B) [m/s^2].
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

    They are the model's primitive wrenches and those of the normal forces, times `largest_forces`;
    X_OH, q and used are as there.
    """
    push = WrenchModel(
        0.0, "frictionless", origin=model.origin, torque_metric=model.torque_metric
    ).wrenches(points, normals)
    wrenches = np.concatenate([model.wrenches(points, normals), push], axis=2)
    return wrenches * largest_forces(hand, X_OH, q, used, wrenches[..., :3])[..., None]
