"""Read a hand's tree of links and joints from an SDF file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.hands.hand_parts import (
    GeometryKind,
    Inertial,
    Joint,
    JointKind,
    LinkGeometry,
    unit_axis,
)
from lis_grasp.hands.link_tree import (
    JOINT_KINDS,
    HandModel,
    frozen,
    load_mesh,
    make_inertial,
    primitive,
    require_pose,
    rpy_pose,
)
from lis_grasp.hands.model_uri import resolve_uri
from lis_grasp.hands.plain_xml import require_plain_xml
from lis_grasp.typing import FloatArray

_PRIMITIVES: Mapping[GeometryKind, tuple[str, ...]] = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
_DRAKE = "{http://drake.mit.edu}"
# SDF says "no limit" by numbers like these.
_UNLIMITED = 1e15


def read_sdf(path: Path) -> HandModel:
    """Read links, joints, inertias and collision bodies of the file's one model.

    A joint whose frame is not the child link's gets a frame link ``<joint>_frame`` of its own, on
    which the child is fixed, so that every link keeps the frame that the file gives it.

    Raises
    ------
    InvalidFileError
        If the file, or a mesh that it names, is missing or unreadable.
    InvalidHandError
        If its tree cannot be used: a loop, several roots, missing limits or masses, unknown names.
    """
    model = _Model(path)
    joints = model.ordered_joints()
    names = (joints[0].parent, *(joint.child for joint in joints))
    limits = [model.limits(joint) for joint in joints if joint.is_actuated]
    return HandModel(
        joint_names=tuple(joint.name for joint in joints if joint.is_actuated),
        lower=frozen([low for low, _, _ in limits]),
        upper=frozen([high for _, high, _ in limits]),
        effort_limits=frozen([effort for _, _, effort in limits]),
        links=names,
        joints=joints,
        inertials=MappingProxyType({name: model.inertial(name) for name in names}),
        link_geometries=tuple(g for name in names for g in model.geometries(name)),
    )


class _Model:
    """One model's elements by name, and the poses of all its frames."""

    def __init__(self, path: Path) -> None:
        self._path = path
        if not path.is_file():
            raise InvalidFileError(f"there is no SDF file {path}")
        require_plain_xml(path)
        try:
            root = ET.parse(path).getroot()
        except ET.ParseError as error:  # a prefix of no namespace, which plain XML may have
            self._fail(f"the file is not valid XML: {error}")
        models = root.findall("model")
        if len(models) != 1:
            self._fail(f"the file must hold one model; it holds {len(models)}")
        if models[0].find("include") is not None or models[0].find("model") is not None:
            self._fail("included and nested models are not read: write the links out")
        self._links, self._joints, self._frames = (
            {element.get("name", ""): element for element in models[0].findall(kind)}
            for kind in ("link", "joint", "frame")
        )
        self._poses: dict[str, FloatArray] = {"__model__": np.eye(4)}

    def ordered_joints(self) -> tuple[Joint, ...]:
        """Return the joints, a parent before its children, otherwise in the file's order."""
        ends = {name: self._ends(name) for name in self._joints}
        children = [child for _, child in ends.values()]
        roots = [name for name in self._links if name not in children]
        if len(roots) != 1 or len(set(children)) != len(children):
            self._fail(
                f"the links must form one tree; links without a parent: {', '.join(roots) or '-'}"
            )
        movable = [name for name in self._joints if self._kind(name) != "fixed"]
        if all(self._mimic(name) is not None for name in movable):
            self._fail("a hand must have movable joints; there are none")
        ordered: list[Joint] = []
        reached, waiting = {roots[0]}, list(self._joints)
        while waiting:
            name = next((n for n in waiting if ends[n][0] in reached), "")
            if not name:
                self._fail(f"joint '{waiting[0]}' hangs on a loop of links")
            waiting.remove(name)
            reached.add(ends[name][1])
            ordered += self._joint(name, *ends[name])
        names = [joint.name for joint in ordered if joint.is_actuated]
        return tuple(self._with_index(joint, names) for joint in ordered)

    def limits(self, joint: Joint) -> tuple[float, float, float]:
        """Return lower and upper limit [rad or m] and effort [N m or N]."""
        limit = self._joints[joint.name].find("axis/limit")
        low, high, effort = (
            self._number(limit, name, default)
            for name, default in (("lower", -np.inf), ("upper", np.inf), ("effort", np.nan))
        )
        if not effort > 0.0 or effort > _UNLIMITED:
            self._fail(f"joint '{joint.name}' must have a limit with an effort above 0")
        if joint.kind == "revolute" and (low < -_UNLIMITED or high > _UNLIMITED):
            low, high = -np.pi, np.pi
        if not (np.isfinite([low, high]).all() and low < high):
            self._fail(
                f"joint '{joint.name}' must have a lower limit below its upper limit; they are"
                f" {low} and {high}"
            )
        return low, high, effort

    def inertial(self, link: str) -> Inertial:
        """Return the mass properties of a link; none for the frame of a joint."""
        element = self._links[link].find("inertial") if link in self._links else None
        mass = self._number(element, "mass", 0.0)
        if element is None or mass <= 0.0:
            return Inertial(0.0, frozen(np.zeros(3)), frozen(np.zeros((3, 3))))
        X_LI = self._raw_pose(element)
        xx, yy, zz, xy, xz, yz = (
            self._number(element.find("inertia"), f"i{axes}", 0.0)
            for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
        )
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return make_inertial(link, mass, X_LI, inertia)

    def geometries(self, link: str) -> list[LinkGeometry]:
        """Return the collision bodies of a link."""
        if link not in self._links:
            return []
        return [self._geometry(link, c) for c in self._links[link].findall("collision")]

    def _geometry(self, link: str, collision: ET.Element) -> LinkGeometry:
        X_LG = frozen(self._raw_pose(collision))
        shape = collision.find("geometry")
        mesh = None if shape is None else shape.find("mesh")
        if mesh is not None:
            uri = mesh.findtext("uri", "").strip()
            factors = None if mesh.find("scale") is None else self._numbers(mesh, "scale")
            file = resolve_uri(uri, self._path.parent, self._path.name)
            return LinkGeometry(link, X_LG, "mesh", (), load_mesh(file, factors))
        for kind, sizes in _PRIMITIVES.items():
            found = None if shape is None else shape.find(kind)
            if found is None and shape is not None:
                found = shape.find(f"{_DRAKE}{kind}")
            if found is not None:
                numbers = [self._numbers(found, size) for size in sizes]
                return primitive(link, X_LG, kind, np.concatenate(numbers))
        return self._fail(
            f"a collision body of link '{link}' must be a box, sphere, cylinder, capsule or mesh"
        )

    def _joint(self, name: str, parent: str, child: str) -> list[Joint]:
        kind, mimic = self._kind(name), self._mimic(name)
        X_PJ = np.linalg.inv(self._pose(parent)) @ self._pose(name)
        X_JC = np.linalg.inv(self._pose(name)) @ self._pose(child)
        if kind == "fixed":
            return [Joint(name, kind, parent, child, frozen(X_PJ @ X_JC), frozen([0.0] * 3), -1)]
        element = self._joints[name].find("axis")
        axis = unit_axis([0.0, 0.0, 1.0] if element is None else self._numbers(element, "xyz"))
        if axis is None:
            return self._fail(f"joint '{name}' must have an axis of three numbers, not all 0")
        described = element.find("xyz") if element is not None else None
        expressed_in = None if described is None else described.get("expressed_in")
        if expressed_in:
            R_JE = np.linalg.inv(self._pose(name)[:3, :3]) @ self._pose(expressed_in)[:3, :3]
            axis = R_JE @ axis
        offset = not np.allclose(X_JC, np.eye(4), atol=1e-12)
        moving = f"{name}_frame" if offset else child
        multiplier, shift = (1.0, 0.0) if mimic is None else mimic[1:]
        if not np.isfinite([multiplier, shift]).all():
            self._fail(f"joint '{name}' must mimic by finite numbers")
        made = [
            Joint(
                name,
                kind,
                parent,
                moving,
                frozen(X_PJ),
                frozen(axis),
                0,
                mimic is not None,
                multiplier,
                shift,
            )
        ]
        if offset:
            zero = frozen(np.zeros(3))
            made.append(Joint(f"{name}_mount", "fixed", moving, child, frozen(X_JC), zero, -1))
        if self.inertial(child).mass <= 0.0:
            self._fail(
                f"link '{child}' moves on joint '{name}' and must have an inertial with a mass"
            )
        return made

    def _with_index(self, joint: Joint, names: list[str]) -> Joint:
        if joint.kind == "fixed":
            return joint
        mimic = self._mimic(joint.name)
        leader = joint.name if mimic is None else mimic[0]
        if leader not in names:
            self._fail(
                f"joint '{joint.name}' mimics '{leader}', which must be a movable joint that mimics"
                " no other"
            )
        return replace(joint, index=names.index(leader))

    def _mimic(self, name: str) -> tuple[str, float, float] | None:
        """Return leader, multiplier and offset of a joint that follows another."""
        joint = self._joints[name]
        drake = joint.find(f"{_DRAKE}mimic")
        if drake is not None:
            multiplier, offset = (
                float(self._parse(drake.get(key, default))[0])
                for key, default in (("multiplier", "1"), ("offset", "0"))
            )
            return drake.get("joint", ""), multiplier, offset
        mimic = joint.find("axis/mimic")
        if mimic is None:
            return None
        multiplier = self._number(mimic, "multiplier", 1.0)
        reference = self._number(mimic, "reference", 0.0)
        offset = self._number(mimic, "offset", 0.0) - multiplier * reference
        return mimic.get("joint", ""), multiplier, offset

    def _ends(self, name: str) -> tuple[str, str]:
        joint = self._joints[name]
        parent, child = (joint.findtext(end, "").strip() for end in ("parent", "child"))
        for link in (parent, child):
            if link not in self._links:
                self._fail(f"joint '{name}' joins a link that is not there: '{link}'")
        return parent, child

    def _kind(self, name: str) -> JointKind:
        given = self._joints[name].get("type", "")
        if given not in JOINT_KINDS:
            self._fail(
                f"joint '{name}' is of type '{given}'; a hand's joints must be"
                f" {', '.join(JOINT_KINDS)}"
            )
        return JOINT_KINDS[given]

    def _pose(self, name: str, below: tuple[str, ...] = ()) -> FloatArray:
        """Return the pose (4, 4) of a link, joint or frame in the model frame."""
        if name in self._poses:
            return self._poses[name]
        if name in below:
            self._fail(f"the pose of '{name}' is given relative to itself")
        if name in self._links:
            element, base = self._links[name], "__model__"
        elif name in self._joints:
            element, base = self._joints[name], self._joints[name].findtext("child", "").strip()
        elif name in self._frames:
            element = self._frames[name]
            base = element.get("attached_to") or "__model__"
        else:
            self._fail(f"a pose is given relative to '{name}', which is not there")
        pose = element.find("pose")
        relative = base if pose is None else pose.get("relative_to") or base
        self._poses[name] = self._pose(relative, (*below, name)) @ self._raw_pose(element)
        return self._poses[name]

    def _raw_pose(self, element: ET.Element) -> FloatArray:
        """Return the numbers of an element's pose as (4, 4)."""
        pose = element.find("pose")
        if pose is None or not (pose.text or "").strip():
            return np.eye(4)
        numbers = self._parse(pose.text or "")
        if not np.isfinite(numbers).all():
            self._fail(f"a pose must have finite numbers; '{(pose.text or '').strip()}' came")
        if len(numbers) == 7 and pose.get("rotation_format") == "quat_xyzw":
            x, y, z, w = numbers[3:]
            X = trimesh.transformations.quaternion_matrix([w, x, y, z])
            X[:3, 3] = numbers[:3]
            return require_pose(np.asarray(X, np.float64))
        if len(numbers) != 6:
            self._fail(f"a pose must have 6 numbers; '{(pose.text or '').strip()}' came")
        angles = np.radians(numbers[3:]) if pose.get("degrees") == "true" else numbers[3:]
        return require_pose(rpy_pose(numbers[:3], angles))

    def _number(self, element: ET.Element | None, name: str, default: float) -> float:
        text = None if element is None else element.findtext(name)
        return default if text is None else float(self._parse(text)[0])

    def _numbers(self, element: ET.Element, name: str) -> FloatArray:
        return self._parse(element.findtext(name, ""))

    def _parse(self, text: str) -> FloatArray:
        try:
            numbers = np.array([float(word) for word in text.split()])
        except ValueError:
            numbers = np.array([])
        if not len(numbers) or np.isnan(numbers).any():
            self._fail(f"numbers were expected; '{text.strip()}' came")
        return numbers

    def _fail(self, reason: str) -> Any:
        raise InvalidHandError(f"{self._path.name}: {reason}")
