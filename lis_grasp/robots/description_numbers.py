"""Checked numbers of a robot description: axes, limits, mass properties and poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.geometry import unit
from lis_grasp.records import read_only
from lis_grasp.robots.hand_parts import Inertial
from lis_grasp.robots.inertias import without_rounding
from lis_grasp.robots.link_bodies import LARGEST
from lis_grasp.typing import FloatArray

_HEAVIEST = 1e6  # [kg] or [kg m^2]


def unit_axis(joint: Any) -> FloatArray:
    """Return a joint's axis (3,), unit."""
    axis = np.asarray(joint.axis, np.float64)
    largest = np.abs(axis).max(initial=0.0)
    if axis.shape != (3,) or not 0.0 < largest < np.inf:
        raise InvalidHandError(
            f"joint '{joint.name}' must have an axis of three numbers, not all 0"
        )
    scaled = axis / largest  # the square of a very large number is infinite
    return unit(scaled)


def joint_limits(joint: Any) -> tuple[float, float, float]:
    """Return lower and upper limit [rad or m] and effort [N m or N]."""
    limit = joint.limit
    effort = None if limit is None else limit.effort
    if effort is None or not (np.isfinite(effort) and effort > 0.0):
        raise InvalidHandError(
            f"joint '{joint.name}' must have a limit with an effort above 0; it is {effort}: give"
            " it under effort_limits in the YAML"
        )
    if joint.type == "continuous":
        return -np.pi, np.pi, float(effort)
    lower, upper = limit.lower, limit.upper
    if lower is None or upper is None or not -LARGEST <= lower < upper <= LARGEST:
        raise InvalidHandError(
            f"joint '{joint.name}' must have a lower limit below its upper limit; they are"
            f" {lower} and {upper}: correct them in the file, or give the joint type 'fixed'"
        )
    return float(lower), float(upper), float(effort)


def link_inertial(link: Any) -> Inertial:
    """Return a link's mass properties in the link frame."""
    inertial = link.inertial
    if inertial is None or not inertial.mass:
        return Inertial(0.0, read_only(np.zeros(3)), read_only(np.zeros((3, 3))))
    mass = float(inertial.mass)
    inertia = np.zeros((3, 3)) if inertial.inertia is None else np.asarray(inertial.inertia)
    if not (0.0 <= mass <= _HEAVIEST and np.all(np.abs(inertia) <= _HEAVIEST)):
        raise InvalidHandError(
            f"link '{link.name}' must have a mass of at least 0 and finite moments of inertia"
            f" [kg, m]; its mass is {mass}"
        )
    X_LI = pose_matrix(inertial.origin)
    rotated = without_rounding(X_LI[:3, :3] @ inertia @ X_LI[:3, :3].T)
    return Inertial(mass, read_only(X_LI[:3, 3].copy()), read_only(rotated))


def pose_matrix(matrix: FloatArray | None) -> FloatArray:
    """Return a pose (4, 4), the identity for None; InvalidHandError if it is not finite."""
    X = np.eye(4) if matrix is None else np.array(matrix, np.float64)
    if not np.all(np.abs(X) <= LARGEST):
        raise InvalidHandError(
            f"a pose must be finite, and within {LARGEST:g} m; it is at {X[:3, 3].tolist()}"
        )
    return read_only(X)
