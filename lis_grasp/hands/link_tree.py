"""What a URDF or SDF says about a hand, and the checks of its pieces that are the same for both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidFileError, InvalidHandError, shown
from lis_grasp.hands.hand_parts import GeometryKind, Inertial, Joint, JointKind, LinkGeometry
from lis_grasp.typing import FloatArray

JOINT_KINDS: Mapping[str, JointKind] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
}
# Facets round a sphere or cylinder: the chord is within 1 % of the radius of the arc.
_CYLINDER_SECTIONS = 32
_SPHERE_SUBDIVISIONS = 3
# How many sizes a body has.
_SIZES: Mapping[GeometryKind, int] = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2}
LARGEST = 1e3
"""Of lengths and positions in a hand [m or rad]; more is a mistake."""
# Of a body's sizes [m].
_SMALLEST = 1e-6

_HEAVIEST = 1e6  # [kg] or [kg m^2]


@dataclass(frozen=True, slots=True, eq=False)
class HandModel:
    """What a URDF or SDF says about a hand; the fields are those of `Hand`."""

    joint_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    effort_limits: FloatArray
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    inertials: Mapping[str, Inertial]
    link_geometries: tuple[LinkGeometry, ...]


def frozen(values: npt.ArrayLike) -> FloatArray:
    """Return numbers as an array that cannot be written to."""
    array = np.array(values, np.float64)
    array.flags.writeable = False
    return array


def rpy_pose(translation: npt.ArrayLike, rpy: npt.ArrayLike) -> FloatArray:
    """Return a pose (4, 4) from a translation [m] and the URDF's fixed-axis angles [rad]."""
    pose = trimesh.transformations.euler_matrix(*np.asarray(rpy, np.float64), axes="sxyz")
    pose[:3, 3] = translation
    return np.asarray(pose, np.float64)


def require_pose(X: FloatArray) -> FloatArray:
    """Return a pose (4, 4) whose numbers are finite and within reach; refuse any other."""
    if not np.all(np.abs(X) <= LARGEST):
        raise InvalidHandError(
            f"a pose in the hand's file must be finite, and within {LARGEST:g} m; it is at"
            f" {X[:3, 3].tolist()}"
        )
    return X


def make_inertial(
    link: str, mass: float, X_LI: FloatArray, inertia_I: npt.NDArray[np.float64]
) -> Inertial:
    """Return the mass properties of a link from those in the frame I of its inertial element.

    Raises
    ------
    InvalidHandError
        If a number is not finite, or the mass is negative.
    """
    if not (0.0 <= mass <= _HEAVIEST and np.all(np.abs(inertia_I) <= _HEAVIEST)):
        raise InvalidHandError(
            f"link '{link}' must have a mass of at least 0 and finite moments of inertia [kg, m];"
            f" its mass is {mass}"
        )
    rotated = X_LI[:3, :3] @ inertia_I @ X_LI[:3, :3].T
    return Inertial(mass, frozen(X_LI[:3, 3]), frozen(rotated))


def primitive(
    link: str, X_LG: FloatArray, kind: GeometryKind, dimensions: npt.ArrayLike
) -> LinkGeometry:
    """Return a body of a simple shape, and a mesh of it; dimensions as in `LinkGeometry`."""
    sizes = tuple(float(size) for size in np.asarray(dimensions, np.float64).ravel())
    if len(sizes) != _SIZES[kind] or not all(_SMALLEST <= size <= LARGEST for size in sizes):
        raise InvalidHandError(
            f"a {kind} of link '{link}' must have {_SIZES[kind]} sizes of {_SMALLEST:g} to"
            f" {LARGEST:g} m; it has {', '.join(map(str, sizes)) or 'none'}"
        )
    match kind:
        case "box":
            mesh = trimesh.creation.box(extents=sizes)
        case "sphere":
            mesh = trimesh.creation.icosphere(subdivisions=_SPHERE_SUBDIVISIONS, radius=sizes[0])
        case "cylinder":
            mesh = trimesh.creation.cylinder(
                radius=sizes[0], height=sizes[1], sections=_CYLINDER_SECTIONS
            )
        case _:
            mesh = trimesh.creation.capsule(radius=sizes[0], height=sizes[1])
    return LinkGeometry(link, X_LG, kind, sizes, mesh)


def load_mesh(file: Path, scale: npt.ArrayLike | None) -> trimesh.Trimesh:
    """Read the mesh of a link's body.

    Raises
    ------
    InvalidFileError
        If it cannot be read, or is empty.
    InvalidHandError
        If the scale is none, or makes a mesh of it that is none.
    """
    factors = None if scale is None else np.atleast_1d(np.asarray(scale, np.float64))
    if factors is not None and (
        factors.shape not in ((1,), (3,)) or not (np.isfinite(factors) & (factors != 0.0)).all()
    ):
        raise InvalidHandError(
            f"the scale of {file.name} must be 1 or 3 finite numbers other than 0; it is"
            f" {shown(factors.tolist())}"
        )
    try:
        loaded = trimesh.load(file, force="mesh")
    except (OSError, ValueError, KeyError, IndexError, NotImplementedError) as error:
        raise InvalidFileError(f"the mesh {file} cannot be read: {error}") from None
    if len(loaded.faces) == 0:
        raise InvalidFileError(f"the mesh {file} has no triangles")
    if factors is not None:
        with np.errstate(all="ignore"):
            loaded.apply_scale(factors if len(factors) == 3 else float(factors[0]))
    if not (np.abs(loaded.vertices) <= LARGEST).all():
        raise InvalidHandError(f"the mesh {file.name} must be within {LARGEST:g} m of its origin")
    return loaded
