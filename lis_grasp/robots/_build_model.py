"""The model of a robot, built from a description and checked."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yourdfpy

from lis_grasp.exceptions import InvalidHandError, LisGraspError, note
from lis_grasp.geometry import unit
from lis_grasp.io.units import UNITS, fitting_units
from lis_grasp.robots._description import (
    NO_EDITS,
    DescriptionEdits,
    apply_edits,
    mimicked,
    parse_description,
)
from lis_grasp.robots._urdf import naming
from lis_grasp.robots.inertias import (
    LEAST_MASS,
    impossible_inertias,
    repaired_inertial,
    without_rounding,
)
from lis_grasp.robots.link_bodies import (
    LARGEST,
    GivenMesh,
    convex_body,
    mesh_of,
    primitive,
    shape_and_sizes,
)
from lis_grasp.robots.model_uri import resolve_uri
from lis_grasp.robots.robot_model import (
    Inertial,
    Joint,
    JointKind,
    LinkGeometry,
    LinkVisual,
    RobotModel,
)
from lis_grasp.robots.schema import UNLIMITED
from lis_grasp.shapes.solids import convex_parts
from lis_grasp.typing import FloatArray

_JOINT_KINDS: Mapping[str, JointKind] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
}
# A concave mesh: largest number of convex parts, and of voxels of their search.
_MOST_PARTS, _VOXELS = 6, 50_000

# A robot's longest body [m], and its joints' offsets: beyond it a unit is mistaken.
_SMALLEST_BODY, _LARGEST_BODY = 0.001, 3.0
_USUAL_BODY = (0.03, 1.0)  # its longest body [m]: units that give such a length are proposed


def read_description(path: Path, edits: DescriptionEdits = NO_EDITS) -> RobotModel:
    """Read links, joints, inertias and collision bodies; for errors see `build_model`."""
    return build_model(parse_description(path, edits.xacro_args), path, edits)


def build_model(
    robot: yourdfpy.Robot, path: Path, edits: DescriptionEdits = NO_EDITS
) -> RobotModel:
    """Return links, joints, inertias and collision bodies of the robot that a file describes.

    The edits are applied to the robot first. A link that has visual meshes and no collision bodies
    gets the meshes' convex hulls. Meshes of links in `edits.convex_parts` become several bodies.

    Links and joints have the meaning of a URDF's. Raises `InvalidFileError` if a mesh file is
    missing or unreadable, `InvalidHandError` if the tree cannot be used: a loop, several roots,
    missing limits or masses.
    """
    with naming(path):
        return _Builder(apply_edits(robot, edits), path, edits).model()


class _Builder:
    """Checks the links and joints of one robot description and converts them to a hand's."""

    def __init__(self, robot: yourdfpy.Robot, path: Path, edits: DescriptionEdits) -> None:
        self._links = {link.name: link for link in robot.links}
        self._joints, self._path, self._repair = robot.joints, path, edits.repair
        self._split = frozenset(edits.convex_parts)
        unknown = sorted(self._split - set(self._links))
        if unknown:
            raise InvalidHandError(
                f"convex_parts must name links of the hand; it has no link '{unknown[0]}'",
                key="convex_parts",
            )
        self._actuated = [j for j in robot.joints if j.type != "fixed" and j.mimic is None]
        self._names = [joint.name for joint in self._actuated]
        self._unread: dict[str, LisGraspError] = {}  # by link, of its visuals the first

    def model(self) -> RobotModel:
        joints = self._ordered_joints()
        limits = np.array([joint_limits(joint) for joint in self._actuated])  # (J, 3)
        names = (joints[0].parent, *(joint.child for joint in joints))
        visuals = tuple(v for name in names for v in self._visuals(name))
        bodies = [body for name in names for body in self._bodies(name)]
        self._account_for_unread({body.link for body in bodies})
        bare = {v.link for v in visuals} - {body.link for body in bodies}
        hulls = [body for v in visuals if v.link in bare for body in self._hulls(v)]
        bodies += hulls
        _require_plausible_sizes(bodies, joints)
        inertials = self._inertials(names, joints, bodies)
        lower, upper, effort = (column.copy() for column in limits.T)
        return RobotModel(
            joint_names=tuple(self._names),
            lower=lower,
            upper=upper,
            effort_limits=effort,
            links=names,
            joints=joints,
            inertials=MappingProxyType(inertials),
            link_geometries=tuple(bodies),
            visuals=visuals,
            hulls_of_visuals=tuple(dict.fromkeys(hull.link for hull in hulls)),
        )

    def _inertials(
        self, names: Sequence[str], joints: Sequence[Joint], bodies: Sequence[LinkGeometry]
    ) -> dict[str, Inertial]:
        """Return the mass properties by link; a link that moves must have, or carry, a mass."""
        inertials = {name: link_inertial(self._links[name]) for name in names}
        repair = set(impossible_inertias(inertials, bodies)) if self._repair else set()
        while missing := _massless(inertials, joints):
            joint = missing[0]
            if not self._repair or joint.child in repair:
                raise InvalidHandError(
                    f"link '{joint.child}' moves on joint '{joint.name}' and must have an inertial"
                    " with a mass above 0; `repair: true` in the YAML gives it one"
                )
            repair.add(joint.child)
            inertials[joint.child] = replace(inertials[joint.child], mass=LEAST_MASS)
        for link in repair:
            placed = [
                body.mesh.copy().apply_transform(body.X_LG) for body in bodies if body.link == link
            ]
            inertials[link] = repaired_inertial(link_inertial(self._links[link]), placed)
        return inertials

    def _visuals(self, link: str) -> Iterator[LinkVisual]:
        for visual in self._links[link].visuals:
            try:
                shape = self._shape(link, visual)
            except LisGraspError as error:
                self._unread.setdefault(link, error)
                continue
            if isinstance(shape, LinkGeometry):
                shape = LinkVisual(link, shape.X_LG, shape.mesh)
            yield from () if shape is None else (shape,)

    def _account_for_unread(self, with_bodies: Collection[str]) -> None:
        """Raise the error of a visual that would be a link's only body; note the others."""
        for link, error in self._unread.items():
            if link not in with_bodies:
                raise error
        if self._unread:
            note(
                f"{', '.join(self._unread)} of {self._path.name} cannot be drawn:"
                f" {next(iter(self._unread.values()))}"
            )

    def _bodies(self, link: str) -> Iterator[LinkGeometry]:
        for collision in self._links[link].collisions:
            shape = self._shape(link, collision)
            if isinstance(shape, LinkGeometry):
                yield shape
            elif shape is not None:
                yield from self._hulls(shape)

    def _hulls(self, shape: LinkVisual) -> Iterator[LinkGeometry]:
        """Yield a mesh's convex hull, or its convex parts; nothing for a flat mesh."""
        link, mesh = shape.link, mesh_of(shape)
        parts = [convex_body(link, shape.X_LG, mesh)]
        if parts[0] is not None and link in self._split:
            found = convex_parts(mesh, most=_MOST_PARTS, voxels=_VOXELS)
            parts = [convex_body(link, shape.X_LG, part) for part in found]
        yield from (part for part in parts if part is not None)

    def _ordered_joints(self) -> tuple[Joint, ...]:
        """Return the joints, a parent before its children, otherwise in the file's order."""
        if not self._links:
            raise InvalidHandError("there must be links; there are none")
        for joint in self._joints:
            self._check(joint)
        children = [joint.child for joint in self._joints]
        roots = [name for name in self._links if name not in children]
        if len(roots) != 1 or len(set(children)) != len(children):
            raise InvalidHandError(
                f"the links must form one tree; links without a parent:"
                f" {', '.join(roots) or 'none, as they form a loop'}"
            )
        if not self._actuated:
            raise InvalidHandError("there must be movable joints; there are none")
        ordered: list[Joint] = []
        joined, waiting = {roots[0]}, list(self._joints)
        while waiting:
            joint = next((joint for joint in waiting if joint.parent in joined), None)
            if joint is None:
                raise InvalidHandError(f"joint '{waiting[0].name}' is on a loop of links")
            waiting.remove(joint)
            joined.add(joint.child)
            ordered.append(self._joint(joint))
        return tuple(ordered)

    def _check(self, joint: Any) -> None:
        if joint.type not in _JOINT_KINDS:
            raise InvalidHandError(
                f"joint '{joint.name}' is of type '{joint.type}'; joints must be"
                f" {', '.join(_JOINT_KINDS)}"
            )
        for link in (joint.parent, joint.child):
            if link not in self._links:
                raise InvalidHandError(f"joint '{joint.name}' joins '{link}', which is no link")
        if joint.mimic is not None and joint.mimic.joint not in self._names:
            raise InvalidHandError(
                f"joint '{joint.name}' mimics '{joint.mimic.joint}', which must be a movable joint"
                " that mimics no other"
            )

    def _joint(self, joint: Any) -> Joint:
        kind = _JOINT_KINDS[joint.type]
        axis = np.zeros(3) if kind == "fixed" else unit_axis(joint)
        leader, multiplier, offset = mimicked(joint)
        if not np.isfinite([multiplier, offset]).all():
            raise InvalidHandError(f"joint '{joint.name}' must mimic by finite numbers")
        return Joint(
            name=joint.name,
            kind=kind,
            parent=joint.parent,
            child=joint.child,
            X_PJ=pose_matrix(joint.origin),
            axis_J=axis,
            index=self._names.index(leader) if kind != "fixed" else -1,
            follows=joint.mimic is not None,
            multiplier=multiplier,
            offset=offset,
        )

    def _shape(self, link: str, element: Any) -> LinkGeometry | LinkVisual | None:
        """Return a simple body, or a mesh; None without extent, as frames that name a place have.

        The mesh of a file is not read.
        """
        X_LG, mesh = pose_matrix(element.origin), getattr(element.geometry, "mesh", None)
        if isinstance(mesh, GivenMesh):
            return LinkVisual(link, X_LG, mesh.mesh)
        if mesh is not None:
            file = resolve_uri(mesh.filename, self._path.parent, str(self._path))
            scale = None if mesh.scale is None else np.atleast_1d(mesh.scale)
            return LinkVisual(link, X_LG, file, scale)
        kind, sizes = shape_and_sizes(element.geometry)
        if kind is None:
            raise InvalidHandError(
                f"a collision body of link '{link}' must be a box, sphere, cylinder, capsule or"
                " mesh"
            )
        return None if 0.0 in sizes else primitive(link, X_LG, kind, sizes)


def _require_plausible_sizes(bodies: Sequence[LinkGeometry], joints: Sequence[Joint]) -> None:
    """Raise `InvalidHandError` if a body or an offset is too large, or all bodies too small."""
    if not bodies:
        return
    sizes = [float(body.mesh.extents.max()) for body in bodies]
    at = int(np.argmax(sizes))
    if not _SMALLEST_BODY <= sizes[at] <= _LARGEST_BODY:
        cause = "a mesh in m needs no scale"
        if sizes[at] > _LARGEST_BODY:
            cause = fitting_words(sizes[at], *_USUAL_BODY)
        raise InvalidHandError(
            f"the longest body must be of {_SMALLEST_BODY:g} to {_LARGEST_BODY:g} m; it is that of"
            f" link '{bodies[at].link}' with {sizes[at]:.3g} m: lengths are in m, and {cause}"
        )
    for joint in joints:
        offset = float(np.linalg.norm(joint.X_PJ[:3, 3]))
        if joint.kind != "fixed" and offset > _LARGEST_BODY:
            raise InvalidHandError(
                f"joint '{joint.name}' must be within {_LARGEST_BODY:g} m of its parent link; it is"
                f" {offset:.3g} m away: lengths are in m, and {fitting_words(offset, *_USUAL_BODY)}"
            )


def fitting_words(length: float, low: float, high: float) -> str:
    """Return in words in which units a length [m] would be from `low` to `high` [m]."""
    fit = fitting_units(length, low, high)
    if not fit:
        return "no unit would fit: correct it"
    units = " or ".join(f"{name} (then {size:.3g} m)" for name, size in fit.items())
    factors = " or ".join(f"{UNITS[name]:g}" for name in fit)
    return f"{units} would fit: multiply by {factors}, a mesh by its scale"


def _massless(inertials: Mapping[str, Inertial], joints: Sequence[Joint]) -> list[Joint]:
    """Return the movable joints that move no mass, the outermost first."""
    masses = {name: inertial.mass for name, inertial in inertials.items()}
    found = []
    for joint in reversed(joints):
        if joint.kind == "fixed":
            masses[joint.parent] += masses[joint.child]
        elif masses[joint.child] <= 0.0:
            found.append(joint)
    return found


def unit_axis(joint: Any) -> FloatArray:
    """Return a joint's axis (3,), unit."""
    axis = np.asarray(joint.axis, np.float64)
    largest = np.abs(axis).max(initial=0.0)
    if axis.shape != (3,) or not 0.0 < largest < np.inf:
        raise InvalidHandError(
            f"joint '{joint.name}' must have an axis of three numbers, not all 0"
        )
    return unit(axis / largest)  # the square of a very large number is infinite


def joint_limits(joint: Any) -> tuple[float, float, float]:
    """Return lower and upper limit [rad or m] and effort [N m or N]."""
    limit = joint.limit
    effort = None if limit is None else limit.effort
    if effort is None or not (np.isfinite(effort) and effort > 0.0):
        raise InvalidHandError(
            f"joint '{joint.name}' must have a limit with an effort above 0; the file gives"
            f" {'none' if effort is None else effort}: give it under effort_limits in the YAML"
        )
    if joint.type == "continuous":
        return -np.pi, np.pi, float(effort)
    lower, upper = limit.lower, limit.upper
    if lower is None or upper is None:
        given = "none" if lower is None and upper is None else "one of them"
        raise InvalidHandError(
            f"joint '{joint.name}' must have a lower and an upper limit; the file gives {given}:"
            " add what is missing, or give the joint type 'fixed', or 'continuous' (without limits)"
        )
    if not -LARGEST <= lower < upper <= LARGEST:
        raise InvalidHandError(
            f"joint '{joint.name}' must have a lower limit below its upper limit, within"
            f" {LARGEST:g}; they are {lower} and {upper}: correct them in the file, or give the"
            " joint type 'fixed', or 'continuous' (without limits)"
        )
    return float(lower), float(upper), float(effort)


def link_inertial(link: Any) -> Inertial:
    """Return a link's mass properties in the link frame."""
    inertial = link.inertial
    if inertial is None or not inertial.mass:
        return Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
    mass = float(inertial.mass)
    inertia = np.zeros((3, 3)) if inertial.inertia is None else np.asarray(inertial.inertia)
    if not (0.0 <= mass <= UNLIMITED and np.all(np.abs(inertia) <= UNLIMITED)):
        raise InvalidHandError(
            f"link '{link.name}' must have a mass of at least 0 and finite moments of inertia"
            f" [kg, m]; its mass is {mass}"
        )
    X_LI = pose_matrix(inertial.origin)
    rotated = without_rounding(X_LI[:3, :3] @ inertia @ X_LI[:3, :3].T)
    return Inertial(mass, X_LI[:3, 3].copy(), rotated)


def pose_matrix(matrix: FloatArray | None) -> FloatArray:
    """Return a pose (4, 4), the identity for None; InvalidHandError if it is not finite."""
    X = np.eye(4) if matrix is None else np.array(matrix, np.float64)
    if not np.all(np.abs(X) <= LARGEST):
        raise InvalidHandError(
            f"a pose must be finite, and within {LARGEST:g} m; it is at {X[:3, 3].tolist()}"
        )
    return X
