"""Read a hand's tree of links and joints from a URDF (parsed by yourdfpy)."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yourdfpy

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.hands.hand_parts import Inertial, Joint, LinkGeometry, unit_axis
from lis_grasp.hands.link_tree import (
    JOINT_KINDS,
    LARGEST,
    HandModel,
    frozen,
    load_mesh,
    make_inertial,
    primitive,
    require_pose,
)
from lis_grasp.hands.model_uri import resolve_uri
from lis_grasp.hands.plain_xml import require_plain_xml
from lis_grasp.typing import FloatArray


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
        lower=frozen([low for low, _, _ in limits]),
        upper=frozen([high for _, high, _ in limits]),
        effort_limits=frozen([effort for _, _, effort in limits]),
        links=names,
        joints=joints,
        inertials=MappingProxyType(inertials),
        link_geometries=tuple(geometries),
    )


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
        if joint.type not in JOINT_KINDS:
            raise InvalidHandError(
                f"{file}: joint '{joint.name}' is of type '{joint.type}'; a hand's joints must be"
                f" {', '.join(JOINT_KINDS)}"
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
    kind = JOINT_KINDS[joint.type]
    axis = np.zeros(3) if kind == "fixed" else unit_axis(joint.axis)
    if axis is None:
        raise InvalidHandError(
            f"{file}: joint '{joint.name}' must have an axis of three numbers, not all 0"
        )
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
        X_PJ=frozen(_origin(joint.origin)),
        axis_J=frozen(axis),
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
    if lower is None or upper is None or not -LARGEST <= lower < upper <= LARGEST:
        raise InvalidHandError(
            f"{file}: joint '{joint.name}' must have a lower limit below its upper limit;"
            f" they are {lower} and {upper}"
        )
    return float(lower), float(upper), float(effort)


def _inertial(link: Any) -> Inertial:
    inertial = link.inertial
    if inertial is None or not inertial.mass:
        return Inertial(0.0, frozen(np.zeros(3)), frozen(np.zeros((3, 3))))
    inertia = np.zeros((3, 3)) if inertial.inertia is None else np.asarray(inertial.inertia)
    return make_inertial(link.name, float(inertial.mass), _origin(inertial.origin), inertia)


def _geometry(link: str, collision: Any, path: Path) -> LinkGeometry:
    geometry, X_LG = collision.geometry, frozen(_origin(collision.origin))
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


def _origin(matrix: FloatArray | None) -> FloatArray:
    return np.eye(4) if matrix is None else require_pose(np.array(matrix, np.float64))
