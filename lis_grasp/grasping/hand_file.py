"""Read a hand: one YAML file that names a URDF and says what a URDF cannot (pads, postures)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
import yaml
import yourdfpy
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.grasping.hand import (
    HAND_NAMES,
    Hand,
    Inertial,
    Joint,
    JointKind,
    LinkGeometry,
    Pad,
    ProbePosture,
)
from lis_grasp.model_files import model_path

FloatArray = npt.NDArray[np.float64]

_KINDS = ("multi_finger", "jaw")
_KEYS = {
    "name",
    "kind",
    "model",
    "palm",
    "approach",
    "pads",
    "pregrasps",
    "probe_postures",
    "self_collision_exclusions",
    "max_contact_force",
}


def load_hand(path_or_name: str | Path) -> Hand:
    """Read a hand by the name of a shipped one, or by the path of its YAML file; see `Hand.load`."""
    path = _find(path_or_name)
    entries = _Entries(path, _read_yaml(path))
    entries.refuse_unknown(_KEYS)
    return _build(entries, _read_urdf(path, entries.text("model")))


def _find(path_or_name: str | Path) -> Path:
    if str(path_or_name) in HAND_NAMES:
        return model_path(f"hands/{path_or_name}/{path_or_name}.yaml")
    path = Path(path_or_name)
    if not path.is_file():
        raise InvalidHandError(
            f"there is no hand '{path_or_name}': name one of {', '.join(HAND_NAMES)}, or give the"
            " path of a hand's YAML file"
        )
    return path


def _read_yaml(path: Path) -> Mapping[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise InvalidFileError(f"cannot read the hand {path}: {reason}") from None
    if not isinstance(content, dict):
        raise InvalidHandError(f"{path} must hold keys and values; see models/hands for examples")
    return content


def _read_urdf(yaml_path: Path, model: str) -> Any:
    path = yaml_path.parent / model
    if not path.is_file():
        raise InvalidHandError(f"{yaml_path} names the model '{model}', but {path} does not exist")
    try:
        urdf = yourdfpy.URDF.load(
            str(path), build_scene_graph=False, load_meshes=False, build_collision_scene_graph=False
        )
    except (ValueError, TypeError, AttributeError, KeyError, SyntaxError) as error:
        reason = " ".join(str(error).split())
        raise InvalidHandError(f"{path} is no valid URDF: {reason}") from None
    return urdf.robot


def _build(entries: _Entries, robot: Any) -> Hand:
    joints = _joints(entries, robot)
    links = _ordered_links(entries, robot, joints)
    actuated = sorted((j for j in joints if j.index >= 0), key=lambda joint: joint.index)
    limits = {j.name: j.limit for j in robot.joints}
    for joint in actuated:
        limit = limits[joint.name]
        bounds = () if limit is None else (limit.lower, limit.upper, limit.effort)
        if not bounds or not all(b is not None and np.isfinite(b) for b in bounds):
            raise entries.error(f"joint '{joint.name}' needs finite lower, upper and effort limits")
    bare = Hand(
        name=entries.text("name"),
        kind=entries.choice("kind", _KINDS),
        joint_names=tuple(joint.name for joint in actuated),
        lower=_frozen([limits[j.name].lower for j in actuated]),
        upper=_frozen([limits[j.name].upper for j in actuated]),
        effort_limits=_frozen([limits[j.name].effort for j in actuated]),
        links=links,
        joints=joints,
        inertials=MappingProxyType(_inertials(robot)),
        link_geometries=_geometries(entries, robot),
        pads=_pads(entries, links),
        X_LH=_palm(entries, links),
        approach_H=entries.direction("approach"),
        pregrasps=MappingProxyType({}),
        probe_postures=MappingProxyType({}),
        self_collision_exclusions=_exclusions(entries, links, joints),
        max_contact_force=entries.positive("max_contact_force"),
    )
    return _with_postures(bare, entries)


def _joints(entries: _Entries, robot: Any) -> tuple[Joint, ...]:
    kinds: dict[str, JointKind] = {
        "revolute": "revolute",
        "prismatic": "prismatic",
        "fixed": "fixed",
    }
    joints = []
    count = 0
    for joint in robot.joints:
        if joint.type not in kinds:
            raise entries.error(
                f"joint '{joint.name}' is {joint.type}; revolute, prismatic and fixed joints with"
                " limits can be used"
            )
        kind = kinds[joint.type]
        axis = np.zeros(3) if kind == "fixed" else np.asarray(joint.axis, dtype=np.float64)
        if kind != "fixed":
            axis = axis / np.linalg.norm(axis)
        joints.append(
            Joint(
                name=joint.name,
                kind=kind,
                parent=joint.parent,
                child=joint.child,
                X_PJ=_pose(joint.origin),
                axis_J=_frozen(axis),
                index=-1 if kind == "fixed" else count,
            )
        )
        count += kind != "fixed"
    if not count:
        raise entries.error("the model has no actuated joint; a hand needs one at least")
    return _parents_first(entries, joints)


def _parents_first(entries: _Entries, joints: Sequence[Joint]) -> tuple[Joint, ...]:
    roots = {j.parent for j in joints} - {j.child for j in joints}
    if len(roots) != 1:
        raise entries.error(f"the model must be one tree of links; its roots are {sorted(roots)}")
    known, ordered, waiting = set(roots), [], list(joints)
    while waiting:
        ready = [j for j in waiting if j.parent in known]
        if not ready:
            raise entries.error("the model must be one tree of links; some joints form a loop")
        known |= {j.child for j in ready}
        ordered += ready
        waiting = [j for j in waiting if j not in ready]
    return tuple(ordered)


def _ordered_links(
    entries: _Entries, robot: Any, joints: Sequence[Joint]
) -> tuple[str, ...]:
    declared = {link.name for link in robot.links}
    links = (joints[0].parent, *(joint.child for joint in joints))
    missing = [link for link in links if link not in declared]
    if missing:
        raise entries.error(f"joints name the link '{missing[0]}', which the model does not have")
    return links


def _inertials(robot: Any) -> dict[str, Inertial]:
    inertials = {}
    for link in robot.links:
        if link.inertial is None:
            inertials[link.name] = Inertial(0.0, _frozen(np.zeros(3)), _frozen(np.zeros((3, 3))))
            continue
        X_LC = _pose(link.inertial.origin)
        inertia = X_LC[:3, :3] @ np.asarray(link.inertial.inertia) @ X_LC[:3, :3].T
        inertials[link.name] = Inertial(
            float(link.inertial.mass), _frozen(X_LC[:3, 3]), _frozen(inertia)
        )
    return inertials


def _geometries(entries: _Entries, robot: Any) -> tuple[LinkGeometry, ...]:
    geometries = []
    for link in robot.links:
        for collision in link.collisions:
            X_LG, shape = _pose(collision.origin), collision.geometry
            if shape.box is not None:
                size = tuple(float(s) for s in shape.box.size)
                body = trimesh.creation.box(size)
                geometries.append(LinkGeometry(link.name, X_LG, "box", size, body))
            elif shape.sphere is not None:
                radius = float(shape.sphere.radius)
                body = trimesh.creation.icosphere(subdivisions=2, radius=radius)
                geometries.append(LinkGeometry(link.name, X_LG, "sphere", (radius,), body))
            elif shape.cylinder is not None:
                size = (float(shape.cylinder.radius), float(shape.cylinder.length))
                body = trimesh.creation.cylinder(*size, sections=24)
                geometries.append(LinkGeometry(link.name, X_LG, "cylinder", size, body))
            else:
                geometries.append(_mesh_geometry(entries, link.name, X_LG, shape.mesh))
    if not geometries:
        raise entries.error("the model has no collision geometry; nothing of it could touch")
    return tuple(geometries)


def _mesh_geometry(entries: _Entries, link: str, X_LG: FloatArray, source: Any) -> LinkGeometry:
    if source is None or source.filename.startswith("package://"):
        name = "nothing" if source is None else source.filename
        raise entries.error(
            f"link '{link}' has {name} as collision geometry; use box, sphere, cylinder, or a mesh"
            " file beside the URDF"
        )
    path = (entries.path.parent / source.filename).resolve()
    try:
        body = trimesh.load(path, force="mesh")
    except (OSError, ValueError) as error:
        raise entries.error(f"link '{link}': cannot read the mesh {path}: {error}") from None
    if source.scale is not None:
        body.apply_scale(source.scale)
    return LinkGeometry(link, X_LG, "mesh", (), body)


def _pads(entries: _Entries, links: Sequence[str]) -> tuple[Pad, ...]:
    pads = []
    for finger, pad in entries.mapping("pads").items():
        inside = entries.inside(f"pads.{finger}", pad)
        inside.refuse_unknown({"link", "center", "radius", "axis", "half_angle"})
        pads.append(
            Pad(
                finger=str(finger),
                link=inside.one_of("link", links),
                center_L=inside.vector("center"),
                radius=inside.positive("radius", zero_allowed=True),
                axis_L=inside.direction("axis"),
                half_angle=inside.positive("half_angle"),
            )
        )
    return tuple(pads)


def _palm(entries: _Entries, links: Sequence[str]) -> FloatArray:
    palm = entries.inside("palm", entries.mapping("palm"))
    palm.refuse_unknown({"link", "xyz", "rpy"})
    if palm.text("link") != links[0]:
        raise entries.error(
            f"palm.link must be the model's base link '{links[0]}'; it is '{palm.text('link')}'"
        )
    X_LH = np.eye(4)
    X_LH[:3, :3] = Rotation.from_euler("xyz", palm.vector("rpy")).as_matrix()
    X_LH[:3, 3] = palm.vector("xyz")
    return _frozen(X_LH)


def _exclusions(
    entries: _Entries, links: Sequence[str], joints: Sequence[Joint]
) -> frozenset[tuple[str, str]]:
    pairs = {tuple(sorted((joint.parent, joint.child))) for joint in joints}
    listed = entries.values.get("self_collision_exclusions", [])
    for pair in listed:
        if not (isinstance(pair, list) and len(pair) == 2 and all(link in links for link in pair)):
            raise entries.error(
                f"self_collision_exclusions must be pairs of link names; one is {pair}"
            )
        pairs.add(tuple(sorted(pair)))
    return frozenset((first, second) for first, second in pairs)


def _with_postures(hand: Hand, entries: _Entries) -> Hand:
    from dataclasses import replace

    pregrasps = {
        str(name): _posture(hand, entries.inside(f"pregrasps.{name}", fingers))
        for name, fingers in entries.mapping("pregrasps").items()
    }
    probes = {}
    for finger, entry in entries.mapping("probe_postures").items():
        inside = entries.inside(f"probe_postures.{finger}", entry)
        inside.refuse_unknown({"direction", "link", "center", "radius", "positions"})
        positions = inside.inside("positions", inside.mapping("positions"))
        probes[str(finger)] = ProbePosture(
            finger=str(finger),
            joint_positions=_posture(hand, positions),
            direction_H=inside.direction("direction"),
            link=inside.one_of("link", hand.links),
            center_L=inside.vector("center"),
            radius=inside.positive("radius"),
        )
    return replace(
        hand, pregrasps=MappingProxyType(pregrasps), probe_postures=MappingProxyType(probes)
    )


def _posture(hand: Hand, entries: _Entries) -> FloatArray:
    """Return joint positions (J,) from lists by finger, each from the palm outwards."""
    q = np.full(len(hand.joint_names), np.nan)
    entries.refuse_unknown(set(hand.fingers))
    for finger in hand.fingers:
        indices = list(hand.finger_joints(finger))
        values = np.atleast_1d(np.asarray(entries.required(finger), dtype=np.float64))
        if values.shape != (len(indices),):
            raise entries.error(f"{finger} has {len(indices)} joints; {len(values)} positions came")
        q[indices] = values
    outside = (q < hand.lower - 1e-9) | (q > hand.upper + 1e-9) | np.isnan(q)
    if outside.any():
        i = int(np.argmax(outside))
        raise entries.error(
            f"joint '{hand.joint_names[i]}' must lie in [{hand.lower[i]}, {hand.upper[i]}];"
            f" it is at {q[i]}"
        )
    return _frozen(q)


class _Entries:
    """A mapping of a hand's YAML whose entries are checked as they are taken out."""

    def __init__(self, path: Path, values: Any, place: str = "") -> None:
        self.path = path
        self._place = place
        if not isinstance(values, Mapping):
            raise self.error("must hold keys and values")
        self.values = values

    def error(self, message: str) -> InvalidHandError:
        where = f"{self.path}, {self._place}" if self._place else f"{self.path}"
        return InvalidHandError(f"{where}: {message}")

    def inside(self, name: str, values: Any) -> _Entries:
        return _Entries(self.path, values, f"{self._place}.{name}" if self._place else name)

    def required(self, key: str) -> Any:
        if key not in self.values:
            raise self.error(f"'{key}' is required and missing")
        return self.values[key]

    def refuse_unknown(self, known: set[str]) -> None:
        unknown = sorted(str(key) for key in self.values if key not in known)
        if unknown:
            raise self.error(f"'{unknown[0]}' is not known; known are {', '.join(sorted(known))}")

    def text(self, key: str) -> str:
        return str(self.required(key))

    def choice(self, key: str, known: tuple[str, ...]) -> Any:
        return self.one_of(key, known)

    def one_of(self, key: str, known: Sequence[str]) -> str:
        value = self.text(key)
        if value not in known:
            raise self.error(f"'{key}' must be one of {', '.join(known)}; it is '{value}'")
        return value

    def mapping(self, key: str) -> Mapping[str, Any]:
        value = self.required(key)
        if not isinstance(value, Mapping) or not value:
            raise self.error(f"'{key}' must hold keys and values; see models/hands for examples")
        return value

    def vector(self, key: str) -> FloatArray:
        try:
            value = np.array(self.required(key), dtype=np.float64)
        except (TypeError, ValueError):
            value = np.empty(0)
        if value.shape != (3,) or not np.isfinite(value).all():
            raise self.error(f"'{key}' must be three numbers; it is {self.required(key)}")
        return _frozen(value)

    def direction(self, key: str) -> FloatArray:
        value = self.vector(key)
        length = np.linalg.norm(value)
        if length < 1e-9:
            raise self.error(f"'{key}' must be a direction; it is zero")
        return _frozen(value / length)

    def positive(self, key: str, *, zero_allowed: bool = False) -> float:
        value = self.required(key)
        number = isinstance(value, int | float) and bool(np.isfinite(value))
        if not number or value < 0.0 or (value == 0.0 and not zero_allowed):
            least = "at least 0" if zero_allowed else "positive"
            raise self.error(f"'{key}' must be a number, {least}; it is {value}")
        return float(value)


def _pose(origin: npt.ArrayLike | None) -> FloatArray:
    return _frozen(np.eye(4) if origin is None else origin)


def _frozen(values: npt.ArrayLike) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
