"""Mass properties of links: which are possible, and replacements for those that are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.robots.link_bodies import points_of_bodies
from lis_grasp.robots.robot_model import Inertial, LinkGeometry, RobotModel
from lis_grasp.typing import FloatArray

LEAST_MASS = 1e-3
"""A link of less mass [kg] is simulated as a ball of this mass, whatever its inertia."""

RULE = (
    "principal moments must be positive, none larger than the other two together, and as of a body"
    " of the link's size and place"
)
"""What inertias must be, for messages."""

# The radius of gyration is within this multiple of the farthest vertex, or of this length [m].
_FARTHEST, _LEAST_SIZE = 2.5, 0.03
# Density of a link whose file gives no mass [kg/m^3]: plastics, or metal with cavities.
_DENSITY = 1000.0
_SMALL_BALL = 0.01  # radius of a link without bodies [m]
# Files are written with few digits: a violation of up to this fraction is corrected in silence.
_ROUNDING = 1e-3
_MARGIN = 1e-9  # by which principal moments keep off the bound, as a fraction


def is_possible(inertial: Inertial, points_L: FloatArray) -> bool:
    """Return whether a link can have these mass properties, or its mass is below `LEAST_MASS`.

    Principal moments must be positive, and none may exceed the sum of the other two. About the
    middle of the link's bodies, whose vertices are `points_L` (N, 3), the radius of gyration must
    not be far beyond them.
    """
    if inertial.mass < LEAST_MASS:
        return True
    low, middle, high = np.linalg.eigvalsh(inertial.inertia_L)
    if not (low > 0.0 and high <= low + middle):
        return False
    if not len(points_L):
        return True
    center = 0.5 * (points_L.min(axis=0) + points_L.max(axis=0))
    size = max(float(np.linalg.norm(points_L - center, axis=1).max()), _LEAST_SIZE)
    offset = inertial.center_L - center
    return bool(high / inertial.mass + offset @ offset <= (_FARTHEST * size) ** 2)


def small_ball(mass: float) -> FloatArray:
    """Return the inertia (3, 3) [kg m^2] of a ball of 1 cm radius."""
    return np.asarray(0.4 * mass * _SMALL_BALL**2 * np.eye(3))


def impossible_inertias(
    inertials: Mapping[str, Inertial], bodies: Sequence[LinkGeometry]
) -> list[str]:
    """Return the names of the links whose inertia they cannot have, given all bodies."""
    return [k for k, i in inertials.items() if not is_possible(i, points_of_bodies(bodies, k))]


def require_possible_inertias(model: RobotModel) -> None:
    """Raise `InvalidHandError` if a link's inertia is impossible, as simulation needs all of them.

    The message names the links and both fixes.
    """
    faults = impossible_inertias(model.inertials, model.link_geometries)
    if faults:
        raise InvalidHandError(
            f"the inertia of {', '.join(faults)} is impossible ({RULE}): add `repair: true` to the"
            " hand's YAML, or write a corrected copy of its model with `lis-grasp doctor --repair`"
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
