"""Mass properties of links: which are possible, and replacements for those that are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.robots.robot_model import Inertial
from lis_grasp.typing import FloatArray

LEAST_MASS = 1e-3
"""A link of less mass [kg] is simulated as a ball of this mass, whatever its inertia."""

# Of a link whose file gives no mass [kg/m^3]: plastics, or metal with cavities.
_DENSITY = 1000.0
_SMALL_BALL = 0.01  # radius of a link without bodies [m]
# Files are written with few digits: a violation of up to this fraction is corrected in silence.
_ROUNDING = 1e-3
_MARGIN = 1e-9  # by which principal moments keep off the bound, as a fraction


def is_possible(inertial: Inertial) -> bool:
    """Return whether a body can have these mass properties, or its mass is below `LEAST_MASS`.

    Principal moments must be positive, and none may exceed the sum of the other two.
    """
    if inertial.mass < LEAST_MASS:
        return True
    low, middle, high = np.linalg.eigvalsh(inertial.inertia_L)
    return bool(low > 0.0 and high <= low + middle)


def small_ball(mass: float) -> FloatArray:
    """Return the inertia (3, 3) [kg m^2] of a ball of 1 cm radius."""
    return np.asarray(0.4 * mass * _SMALL_BALL**2 * np.eye(3))


def impossible_inertias(inertials: Mapping[str, Inertial]) -> list[str]:
    """Return the names of the links whose inertia no body can have."""
    return [link for link, inertial in inertials.items() if not is_possible(inertial)]


def require_possible_inertias(inertials: Mapping[str, Inertial]) -> None:
    """Raise `InvalidHandError` if a link's inertia is impossible, as simulation needs all of them.

    The message names the links and both fixes.
    """
    faults = impossible_inertias(inertials)
    if faults:
        raise InvalidHandError(
            f"the inertia of {', '.join(faults)} is impossible (principal moments must be positive,"
            " and none larger than the other two together): add `repair: true` to the hand's YAML,"
            " or write a corrected copy of its model with `lis-grasp doctor --repair`"
        )


def without_rounding(inertia: npt.ArrayLike) -> FloatArray:
    """Return a symmetric inertia (3, 3), moved off the bound of what is possible by rounding.

    One that violates the bound by more than a thousandth is returned as it is.
    """
    matrix = np.asarray(inertia, np.float64)
    matrix = 0.5 * (matrix + matrix.T)
    moments, axes = np.linalg.eigh(matrix)
    low, middle, high = moments
    bound = (low + middle) * (1.0 - _MARGIN)
    if low <= 0.0 or high <= bound or high > (low + middle) * (1.0 + _ROUNDING):
        return matrix
    return np.asarray((axes * [low, middle, bound]) @ axes.T)


def repaired_inertial(inertial: Inertial, bodies: Sequence[trimesh.Trimesh]) -> Inertial:
    """Return the mass properties of the link's mass spread evenly over its bodies.

    Parameters
    ----------
    inertial
        What the file gives. Without a mass, the bodies have the density of water.
    bodies
        Convex bodies in the link frame [m]; without any, the mass is a ball of 1 cm radius about
        the file's centre of mass.
    """
    solids = [body for body in bodies if body.volume > 0.0]
    volume = sum(body.volume for body in solids)
    mass = inertial.mass if inertial.mass > 0.0 else max(_DENSITY * volume, LEAST_MASS)
    if not solids:
        return Inertial(mass, inertial.center_L, small_ball(mass))
    center = sum(body.volume * body.center_mass for body in solids) / volume
    inertia = np.zeros((3, 3))
    for body in solids:
        offset = body.center_mass - center
        shifted = body.volume * (offset @ offset * np.eye(3) - np.outer(offset, offset))
        inertia += (mass / volume) * (body.moment_inertia + shifted)
    return Inertial(mass, np.asarray(center), without_rounding(inertia))
