"""Read a hand's tree of links and joints from a URDF (parsed by yourdfpy)."""

from __future__ import annotations

import os
import xml.parsers.expat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
import yourdfpy

from lis_grasp.exceptions import InvalidFileError, InvalidHandError, shown
from lis_grasp.grasping.hand import GeometryKind, Inertial, Joint, JointKind, LinkGeometry

FloatArray = npt.NDArray[np.float64]

_KINDS: Mapping[str, JointKind] = {
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
# Of a hand [m], [kg] or [kg m^2]: more is a mistake.
_LARGEST, _HEAVIEST = 1e3, 1e6
# Elements within elements: a URDF has five, an SDF six.
_DEEPEST = 50


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


def read_urdf(path: Path) -> HandModel:
    """Read links, joints, inertias and collision bodies.

    Raises
    ------
    InvalidFileError
        If the file, or a mesh that it names, is missing or unreadable.
    InvalidHandError
        If its tree cannot be used: a loop, several roots, missing limits or masses.
    """
    robot = _parse(path)
    links = {link.name: link for link in robot.links}
    joints = _ordered_joints(robot, path.name)
    movable = _actuated(robot)
    limits = [_limits(joint, path.name) for joint in movable]
    names = (joints[0].parent, *(joint.child for joint in joints))
    inertials = {name: _inertial(links[name]) for name in names}
    for joint in joints:
        if joint.kind != "fixed" and inertials[joint.child].mass <= 0.0:
            raise InvalidHandError(
                f"{path.name}: link '{joint.child}' moves on joint '{joint.name}' and must have an"
                " inertial with a mass above 0"
            )
    geometries = [
        _geometry(name, collision, path) for name in names for collision in links[name].collisions
    ]
    return HandModel(
        joint_names=tuple(joint.name for joint in movable),
        lower=_frozen([low for low, _, _ in limits]),
        upper=_frozen([high for _, high, _ in limits]),
        effort_limits=_frozen([effort for _, _, effort in limits]),
        links=names,
        joints=joints,
        inertials=MappingProxyType(inertials),
        link_geometries=tuple(geometries),
    )


def rpy_pose(translation: npt.ArrayLike, rpy: npt.ArrayLike) -> FloatArray:
    """Return a pose (4, 4) from a translation [m] and the URDF's fixed-axis angles [rad]."""
    pose = trimesh.transformations.euler_matrix(*np.asarray(rpy, np.float64), axes="sxyz")
    pose[:3, 3] = translation
    return np.asarray(pose, np.float64)


def _parse(path: Path) -> Any:
    """Return yourdfpy's robot, its errors translated."""
    if not path.is_file():
        raise InvalidFileError(f"there is no URDF file {path}")
    try:
        # yourdfpy logs a syntax error and reads on; a hand that is half read must be refused.
        require_plain_xml(path)
        with np.errstate(all="ignore"):  # poses are checked one by one below
            urdf = yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False)
    except (AttributeError, LookupError, TypeError, ValueError, SyntaxError) as error:
        raise InvalidHandError(f"{path.name} is not a URDF that can be read: {error}") from None
    return urdf.robot


def _ordered_joints(robot: Any, file: str) -> tuple[Joint, ...]:
    """Return the joints, a parent before its children, otherwise in the file's order."""
    names = [link.name for link in robot.links]
    children = [joint.child for joint in robot.joints]
    roots = [name for name in names if name not in children]
    if len(roots) != 1 or len(set(children)) != len(children):
        raise InvalidHandError(
            f"{file}: the links must form one tree; links without a parent: {', '.join(roots)}"
        )
    for joint in robot.joints:
        if joint.type not in _KINDS:
            raise InvalidHandError(
                f"{file}: joint '{joint.name}' is of type '{joint.type}'; a hand's joints must be"
                f" {', '.join(_KINDS)}"
            )
        if joint.parent not in names or joint.child not in names:
            raise InvalidHandError(f"{file}: joint '{joint.name}' joins a link that is not there")
    movable = [joint.name for joint in _actuated(robot)]
    for joint in robot.joints:
        if joint.mimic is not None and joint.mimic.joint not in movable:
            raise InvalidHandError(
                f"{file}: joint '{joint.name}' mimics '{joint.mimic.joint}', which must be a"
                " movable joint that mimics no other"
            )
    if not movable:
        raise InvalidHandError(f"{file}: a hand must have movable joints; there are none")
    ordered: list[Joint] = []
    reached, waiting = {roots[0]}, list(robot.joints)
    while waiting:
        joint = next((joint for joint in waiting if joint.parent in reached), None)
        if joint is None:
            raise InvalidHandError(f"{file}: joint '{waiting[0].name}' hangs on a loop of links")
        waiting.remove(joint)
        reached.add(joint.child)
        ordered.append(_joint(joint, movable, file))
    return tuple(ordered)


def _actuated(robot: Any) -> list[Any]:
    """Return the movable joints that follow no other, in the file's order."""
    return [joint for joint in robot.joints if joint.type != "fixed" and joint.mimic is None]


def _joint(joint: Any, movable: list[str], file: str) -> Joint:
    kind = _KINDS[joint.type]
    axis = np.zeros(3)
    if kind != "fixed":
        axis = np.asarray(joint.axis, np.float64)
        length = float(np.linalg.norm(axis))
        if not (np.isfinite(length) and length > 0.0):
            raise InvalidHandError(f"{file}: joint '{joint.name}' must have a nonzero axis")
        axis = axis / length
    mimic = joint.mimic
    multiplier = 1.0 if mimic is None or mimic.multiplier is None else float(mimic.multiplier)
    offset = 0.0 if mimic is None or mimic.offset is None else float(mimic.offset)
    if not np.isfinite([multiplier, offset]).all():
        raise InvalidHandError(f"{file}: joint '{joint.name}' must mimic by finite numbers")
    leader = joint.name if mimic is None else mimic.joint
    return Joint(
        name=joint.name,
        kind=kind,
        parent=joint.parent,
        child=joint.child,
        X_PJ=_frozen(_origin(joint.origin)),
        axis_J=_frozen(axis),
        index=movable.index(leader) if kind != "fixed" else -1,
        follows=mimic is not None,
        multiplier=multiplier,
        offset=offset,
    )


def _limits(joint: Any, file: str) -> tuple[float, float, float]:
    """Return lower and upper limit [rad or m] and effort [N m or N]."""
    limit = joint.limit
    effort = None if limit is None else limit.effort
    if effort is None or not (np.isfinite(effort) and effort > 0.0):
        raise InvalidHandError(
            f"{file}: joint '{joint.name}' must have a limit with an effort above 0; it is {effort}"
        )
    if joint.type == "continuous":
        return -np.pi, np.pi, float(effort)
    lower, upper = limit.lower, limit.upper
    if lower is None or upper is None or not -_LARGEST <= lower < upper <= _LARGEST:
        raise InvalidHandError(
            f"{file}: joint '{joint.name}' must have a lower limit below its upper limit;"
            f" they are {lower} and {upper}"
        )
    return float(lower), float(upper), float(effort)


def _inertial(link: Any) -> Inertial:
    inertial = link.inertial
    if inertial is None or not inertial.mass:
        return Inertial(0.0, _frozen(np.zeros(3)), _frozen(np.zeros((3, 3))))
    inertia = np.zeros((3, 3)) if inertial.inertia is None else np.asarray(inertial.inertia)
    return make_inertial(link.name, float(inertial.mass), _origin(inertial.origin), inertia)


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
    return Inertial(mass, _frozen(X_LI[:3, 3]), _frozen(rotated))


def _geometry(link: str, collision: Any, path: Path) -> LinkGeometry:
    geometry, X_LG = collision.geometry, _frozen(_origin(collision.origin))
    if geometry.box is not None:
        return primitive(link, X_LG, "box", np.asarray(geometry.box.size))
    if geometry.sphere is not None:
        return primitive(link, X_LG, "sphere", [geometry.sphere.radius])
    if geometry.cylinder is not None:
        return primitive(
            link, X_LG, "cylinder", [geometry.cylinder.radius, geometry.cylinder.length]
        )
    if geometry.mesh is not None:
        file = resolve_uri(geometry.mesh.filename, path.parent, path.name)
        return LinkGeometry(link, X_LG, "mesh", (), load_mesh(file, geometry.mesh.scale))
    raise InvalidHandError(
        f"{path.name}: a collision body of link '{link}' must be a box, sphere, cylinder or mesh"
    )


def primitive(
    link: str, X_LG: FloatArray, kind: GeometryKind, dimensions: npt.ArrayLike
) -> LinkGeometry:
    """Return a body of a simple shape, and a mesh of it; dimensions as in `LinkGeometry`."""
    sizes = tuple(float(size) for size in np.asarray(dimensions, np.float64).ravel())
    if len(sizes) != _SIZES[kind] or not all(0.0 < size <= _LARGEST for size in sizes):
        raise InvalidHandError(
            f"a {kind} of link '{link}' must have {_SIZES[kind]} sizes above 0 and at most"
            f" {_LARGEST:g} m; it has {', '.join(map(str, sizes)) or 'none'}"
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
    """
    try:
        loaded = trimesh.load(file, force="mesh")
    except (OSError, ValueError, KeyError, IndexError, NotImplementedError) as error:
        raise InvalidFileError(f"the mesh {file} cannot be read: {error}") from None
    if len(loaded.faces) == 0:
        raise InvalidFileError(f"the mesh {file} has no triangles")
    if scale is not None:
        loaded.apply_scale(scale)
    return loaded


def resolve_uri(uri: str, folder: Path, named_in: str) -> Path:
    """Find a file that another one names.

    A plain path counts from `folder`; ``package://NAME/...`` is looked for in a folder NAME above
    it, in `folder` itself, and in folders NAME beside those of ``ROS_PACKAGE_PATH`` (a copy of
    drake_models, for example).

    Raises
    ------
    InvalidFileError
        If there is no such file; says where it was looked for.
    """
    scheme, separator, rest = uri.partition("://")
    if not separator:
        candidates = [folder / uri]
    elif scheme == "file":
        candidates = [Path(rest)]
    elif scheme == "package":
        package, _, inside = rest.partition("/")
        above = [parent / inside for parent in _upwards(folder) if parent.name == package]
        roots = [Path(r) for r in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if r]
        listed = [root / package / inside for root in roots]
        listed += [root / inside for root in roots if root.name == package]
        candidates = [*above, folder / inside, *listed]
    else:
        raise InvalidFileError(f"{named_in}: files are named by path or package:// URI, not {uri}")
    for candidate in candidates:
        try:
            if candidate.is_file():
                return candidate
        except (OSError, ValueError) as error:  # no name that a file can have
            raise InvalidFileError(f"{named_in}: {shown(uri)} is no file: {error}") from None
    tried = ", ".join(str(candidate) for candidate in candidates)
    raise InvalidFileError(
        f"{named_in}: {uri} was not found; looked at {tried}: a package's folder may be listed in"
        " ROS_PACKAGE_PATH"
    )


def _upwards(folder: Path) -> list[Path]:
    resolved = folder.resolve()
    return [resolved, *resolved.parents]


def _origin(matrix: FloatArray | None) -> FloatArray:
    return np.eye(4) if matrix is None else require_pose(np.array(matrix, np.float64))


def require_pose(X: FloatArray) -> FloatArray:
    """Return a pose (4, 4) whose numbers are finite and within reach; refuse any other."""
    if not np.all(np.abs(X) <= _LARGEST):
        raise InvalidHandError(
            f"a pose in the hand's file must be finite, and within {_LARGEST:g} m; it is at"
            f" {X[:3, 3].tolist()}"
        )
    return X


def require_plain_xml(path: Path) -> None:
    """Refuse a file that is no XML, or declares entities.

    Entities let a small file grow to gigabytes, or name files that are none of its business; no
    hand needs them.

    Raises
    ------
    InvalidFileError
        If it is so.
    """

    def refuse(*_: object) -> None:
        raise InvalidFileError(f"{path} must not declare XML entities: write their text out")

    parser = xml.parsers.expat.ParserCreate()
    parser.EntityDeclHandler = refuse
    depth = 0

    def enter(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise InvalidFileError(f"{path} must not nest elements deeper than {_DEEPEST}")

    def leave(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartElementHandler, parser.EndElementHandler = enter, leave
    try:
        parser.Parse(path.read_bytes(), True)
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}") from None
    except (xml.parsers.expat.ExpatError, ValueError) as error:
        raise InvalidFileError(f"{path} is not valid XML: {error}") from None


def _frozen(values: npt.ArrayLike) -> FloatArray:
    array = np.array(values, np.float64)
    array.flags.writeable = False
    return array
