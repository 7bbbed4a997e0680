"""Reading of a hand's links and joints from an SDF file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NoReturn

import numpy as np
import yourdfpy
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.geometry import inverse_pose, rotate
from lis_grasp.robots._urdf import require_unique_names
from lis_grasp.robots.link_bodies import LARGEST, Capsule
from lis_grasp.robots.robot_model import rpy_pose
from lis_grasp.typing import FloatArray

_DRAKE = "{http://drake.mit.edu}"
# SDF writes "no limit" as numbers like these.
_UNLIMITED = 1e15


def parse_sdf(root: ET.Element, path: Path) -> yourdfpy.Robot:
    """Return the links and joints of an SDF file's one model as a URDF would have them.

    A joint whose frame is not the child link's gets a frame link ``<joint>_frame``, on which the
    child is fixed, so that every link keeps the frame that the file gives it.
    """
    for model in root.iter("model"):
        for kind in ("link", "joint"):
            require_unique_names(model.findall(kind), path)
    return _Model(root, path).robot()


class _Model:
    """One model's elements by name, and the poses of all its frames."""

    def __init__(self, root: ET.Element, path: Path) -> None:
        self._path = path
        models = root.findall("model") or root.findall("world/model")
        if len(models) != 1:
            self._fail(f"the file must hold one model; it holds {len(models)}")
        if models[0].find("include") is not None or models[0].find("model") is not None:
            uri = models[0].findtext("include/uri", "").strip()
            way = f"give the file of {uri} itself, or write" if uri else "write"
            self._fail(f"included and nested models are not read: {way} the links out in one model")
        self._links, self._joints, self._frames = (
            {element.get("name", ""): element for element in models[0].findall(kind)}
            for kind in ("link", "joint", "frame")
        )
        self._poses: dict[str, FloatArray] = {"__model__": np.eye(4)}

    def robot(self) -> yourdfpy.Robot:
        """Return the model's links and joints as a URDF would have them."""
        links = [self._link(name, element) for name, element in self._links.items()]
        joints = []
        for name, element in self._joints.items():
            held_by = element.findtext("parent", "").strip()
            if held_by == "world" and held_by not in self._links:
                continue
            made = self._chain(name, element)
            joints += made
            links += [yourdfpy.Link(joint.child) for joint in made[:-1]]
        return yourdfpy.Robot("", links, joints)

    def _link(self, name: str, element: ET.Element) -> yourdfpy.Link:
        link = yourdfpy.Link(name)
        inertial = element.find("inertial")
        if inertial is not None:
            xx, yy, zz, xy, xz, yz = (
                self._number(inertial.find("inertia"), f"i{axes}", 0.0)
                for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
            )
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            mass = self._number(inertial, "mass", 0.0)
            link.inertial = yourdfpy.Inertial(self._pose_on(name, inertial), mass, inertia)
        link.collisions, link.visuals = (
            [
                made("", self._pose_on(name, body), self._geometry(body.find("geometry")))
                for body in element.findall(kind)
            ]
            for kind, made in (("collision", yourdfpy.Collision), ("visual", yourdfpy.Visual))
        )
        return link

    def _geometry(self, shape: ET.Element | None) -> yourdfpy.Geometry:
        for element in () if shape is None else shape:
            match element.tag.removeprefix(_DRAKE):
                case "box":
                    return yourdfpy.Geometry(box=yourdfpy.Box(self._numbers(element, "size")))
                case "sphere":
                    radius = self._numbers(element, "radius")[0]
                    return yourdfpy.Geometry(sphere=yourdfpy.Sphere(radius))
                case "cylinder" | "capsule" as kind:
                    made = Capsule if kind == "capsule" else yourdfpy.Cylinder
                    sizes = (self._numbers(element, name)[0] for name in ("radius", "length"))
                    return yourdfpy.Geometry(cylinder=made(*sizes))
                case "mesh":
                    scaled = element.find("scale") is not None
                    scale = self._numbers(element, "scale") if scaled else None
                    uri = element.findtext("uri", "").strip()
                    return yourdfpy.Geometry(mesh=yourdfpy.Mesh(uri, scale))
        return yourdfpy.Geometry()

    def _chain(self, name: str, element: ET.Element) -> list[yourdfpy.Joint]:
        """Return a joint, and the fixed one that follows it where its frame is not the child's."""
        parent, child = (element.findtext(end, "").strip() for end in ("parent", "child"))
        for link in (parent, child):
            if link not in self._links:
                self._fail(f"joint '{name}' joins '{link}', which is no link")
        kind, pose = element.get("type", ""), self._pose(name)
        X_PJ = inverse_pose(self._pose(parent)) @ pose
        X_JC = inverse_pose(pose) @ self._pose(child)
        if kind == "fixed":
            return [yourdfpy.Joint(name, kind, parent, child, X_PJ @ X_JC)]
        limit = self._limit(element.find("axis/limit"))
        if kind == "revolute" and max(-limit.lower, limit.upper) > _UNLIMITED:
            kind = "continuous"
        moving = yourdfpy.Joint(
            name,
            kind,
            parent,
            child,
            origin=X_PJ,
            axis=self._axis(name, element.find("axis")),
            limit=limit,
            mimic=self._mimic(element),
        )
        if np.allclose(X_JC, np.eye(4), atol=1e-12):
            return [moving]
        moving.child = f"{name}_frame"
        return [moving, yourdfpy.Joint(f"{name}_mount", "fixed", moving.child, child, X_JC)]

    def _axis(self, joint: str, axis: ET.Element | None) -> FloatArray:
        if axis is None:
            return np.array([0.0, 0.0, 1.0])
        numbers = self._numbers(axis, "xyz")
        frame = next(axis.iterfind("xyz")).get("expressed_in")
        if frame and numbers.shape == (3,):
            numbers = rotate(inverse_pose(self._pose(joint)) @ self._pose(frame), numbers)
        return numbers

    def _limit(self, limit: ET.Element | None) -> yourdfpy.Limit:
        effort = self._number(limit, "effort", np.inf)
        return yourdfpy.Limit(
            effort=None if effort > _UNLIMITED else effort,
            lower=self._number(limit, "lower", -np.inf),
            upper=self._number(limit, "upper", np.inf),
        )

    def _mimic(self, joint: ET.Element) -> yourdfpy.Mimic | None:
        drake = joint.find(f"{_DRAKE}mimic")
        if drake is not None:
            factors = (
                float(self._parse(drake.get(key, default))[0])
                for key, default in (("multiplier", "1"), ("offset", "0"))
            )
            return yourdfpy.Mimic(drake.get("joint", ""), *factors)
        mimic = joint.find("axis/mimic")
        if mimic is None:
            return None
        multiplier = self._number(mimic, "multiplier", 1.0)
        reference = self._number(mimic, "reference", 0.0)
        offset = self._number(mimic, "offset", 0.0) - multiplier * reference
        return yourdfpy.Mimic(mimic.get("joint", ""), multiplier, offset)

    def _pose(self, name: str, below: tuple[str, ...] = ()) -> FloatArray:
        """Return the pose (4, 4) of a link, joint or frame in the model frame."""
        if name in self._poses:
            return self._poses[name]
        if name in below:
            self._fail(f"the pose of '{name}' is given relative to itself")
        named = (self._links, self._joints, self._frames)
        element = next((elements[name] for elements in named if name in elements), None)
        if element is None:
            self._fail(f"a pose is given relative to '{name}', which is not there")
        base = element.findtext("child", "").strip() if element.tag == "joint" else "__model__"
        base = element.get("attached_to") or base  # of a frame
        self._poses[name] = self._pose(_relative(element) or base, (*below, name)) @ self._own_pose(
            element
        )
        return self._poses[name]

    def _pose_on(self, link: str, body: ET.Element) -> FloatArray:
        """Return the pose (4, 4) of a body of a link in the link's frame."""
        if (relative := _relative(body)) in ("", link):
            return self._own_pose(body)
        X_LR = inverse_pose(self._pose(link)) @ self._pose(relative)
        return np.asarray(X_LR @ self._own_pose(body))

    def _own_pose(self, element: ET.Element) -> FloatArray:
        """Return the numbers of an element's pose as (4, 4)."""
        pose = element.find("pose")
        text = "" if pose is None else (pose.text or "").strip()
        if pose is None or not text:
            return np.eye(4)
        numbers = self._parse(text)
        if not (np.abs(numbers) <= LARGEST).all():
            self._fail(f"a pose must have finite numbers, within {LARGEST:g}; it is '{text}'")
        if len(numbers) == 7 and pose.get("rotation_format") == "quat_xyzw" and numbers[3:].any():
            X = rpy_pose(numbers[:3], np.zeros(3))
            X[:3, :3] = Rotation.from_quat(numbers[3:]).as_matrix()
            return X
        if len(numbers) != 6:
            self._fail(f"a pose must have 6 numbers, or 7 with a quaternion; it is '{text}'")
        angles = np.radians(numbers[3:]) if pose.get("degrees") == "true" else numbers[3:]
        return rpy_pose(numbers[:3], angles)

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
            self._fail(f"numbers were expected instead of '{text.strip()}'")
        return numbers

    def _fail(self, reason: str) -> NoReturn:
        raise InvalidHandError(f"{self._path}: {reason}", file=self._path.name)


def _relative(element: ET.Element) -> str:
    """Return the frame in which an element's pose is given; empty for the usual one."""
    pose = element.find("pose")
    return "" if pose is None else pose.get("relative_to", "")
