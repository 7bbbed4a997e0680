"""Model of a robot: links, joints, inertias, collision bodies, and the pads of a hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.records import FrozenArrays, reduce_record
from lis_grasp.typing import FloatArray

JointKind = Literal["revolute", "prismatic", "fixed"]
GeometryKind = Literal["box", "sphere", "cylinder", "capsule", "mesh"]
HandKind = Literal["multi_finger", "parallel_jaw", "suction_cup"]
GraspFamily = Literal["pinch", "table", "rim", "flat_faces", "suction"]
"""Kinds of grasps: fingertips on opposite sides; the same with fingertips that slide on the table;
a wall or plate from above and below; with the flat faces that the hand has for low objects; a place
where a suction cup seals."""


@dataclass(frozen=True, slots=True, eq=False)
class Joint(FrozenArrays):
    """A joint of the hand's tree; its position is ``multiplier * q[index] + offset``."""

    name: str
    kind: JointKind  # a URDF's continuous joint is a revolute one without limits
    parent: str  # name of the link that it moves on
    child: str  # name of the link that it moves
    X_PJ: FloatArray  # (4, 4): the joint frame (the child's at position 0) in the parent's
    axis_J: FloatArray  # (3,), unit, in the joint frame; zeros for a fixed joint
    index: int  # in `Hand.joint_names`, of the joint or of the one that it follows; -1 if fixed
    follows: bool = False  # coupled to another joint (a URDF's ``mimic``), without a motor
    multiplier: float = 1.0
    offset: float = 0.0  # [rad or m]

    @property
    def is_actuated(self) -> bool:
        """Whether it is one of `Hand.joint_names`."""
        return self.index >= 0 and not self.follows

    def position(self, q: FloatArray) -> FloatArray:
        """Return its position, shape (...), from the positions of the actuated joints, (..., J)."""
        return np.asarray(self.multiplier * q[..., self.index] + self.offset)


def joints_to(joints: Sequence[Joint], link: str) -> tuple[Joint, ...]:
    """Return the joints from the base to a link."""
    by_child = {joint.child: joint for joint in joints}
    chain: list[Joint] = []
    while link in by_child:
        chain.append(by_child[link])
        link = by_child[link].parent
    return tuple(reversed(chain))


@dataclass(frozen=True, slots=True, eq=False)
class Inertial(FrozenArrays):
    """Mass properties of a link."""

    mass: float  # [kg]; 0 for a frame without matter
    center_L: FloatArray  # (3,) [m]: centre of mass in the link frame
    inertia_L: FloatArray  # (3, 3) [kg m^2]: about the centre of mass, along the link's axes


@dataclass(frozen=True, slots=True, eq=False)
class LinkGeometry(FrozenArrays):
    """One collision body of a link."""

    link: str
    X_LG: FloatArray  # (4, 4): pose of the body's frame G in the link frame
    kind: GeometryKind
    # [m] box: sides; sphere: radius; cylinder, capsule: radius, (straight) length on z; mesh: empty
    dimensions: tuple[float, ...]
    mesh: trimesh.Trimesh  # the body as a closed triangle mesh in G [m], convex


@dataclass(frozen=True, slots=True, eq=False)
class LinkVisual:
    """What a link looks like; see `load_visual`."""

    link: str
    X_LG: FloatArray  # (4, 4): pose of its frame G in the link frame
    shape: trimesh.Trimesh | Path  # in G [m], or a mesh file
    scale: FloatArray | None = None  # (1,) or (3,): of the file


@dataclass(frozen=True, slots=True)
class Cup:
    """A suction cup: its lip is a circle in the plane of the pad, about the pad's centre."""

    radius: float  #: of the lip [m]
    travel: float  #: of the lip along its axis, until it lies on a surface [m]
    tilt: float  #: largest, of the lip, until it lies on a surface [rad]
    vacuum: float  #: largest pressure below that of the air [Pa]

    @property
    def pull(self) -> float:
        """Force of the air that presses a sealed object against the lip [N]."""
        return float(np.pi * self.radius**2 * self.vacuum)


@dataclass(frozen=True, slots=True, eq=False)
class Pad(FrozenArrays):
    """The part of a finger that is meant to touch.

    A surface is touched at p with outward normal n when the pad's centre is at ``p + radius * n``.
    """

    finger: str
    link: str  # the link that carries the pad
    center_L: FloatArray  # (3,) [m], in the link frame: of the pad's sphere, or of a flat face
    radius: float  # of the sphere [m]; 0 for a flat pad
    axis_L: FloatArray  # (3,), unit, in the link frame: outward at the middle of the pad
    half_angle: float  # [rad]: the pad covers the directions within this angle of its axis
    cup: Cup | None = None  # the suction cup, whose lip the pad is; None for a finger


@dataclass(frozen=True, slots=True, eq=False)
class ProbePosture(FrozenArrays):
    """A posture for touching, in which one fingertip is ahead of the rest of the hand."""

    finger: str
    joint_positions: FloatArray  # (J,) [rad or m]
    direction_H: FloatArray  # (3,), unit, in the palm frame: the hand's motion
    link: str  # of the fingertip's sphere
    center_L: FloatArray  # (3,) [m], its centre in the link frame
    radius: float  # of the sphere [m]


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel(FrozenArrays):
    """Links, joints and collision bodies of a description; for the fields see `Hand`."""

    joint_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    effort_limits: FloatArray
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    inertials: Mapping[str, Inertial]
    link_geometries: tuple[LinkGeometry, ...]
    visuals: tuple[LinkVisual, ...]
    hulls_of_visuals: tuple[str, ...]

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return reduce_record(self)

    @property
    def joined_links(self) -> frozenset[tuple[str, str]]:
        """The pairs of links that a joint joins, each sorted."""
        return frozenset((min(j.parent, j.child), max(j.parent, j.child)) for j in self.joints)


def by_joint_kind(model: RobotModel, *, revolute: float, prismatic: float) -> FloatArray:
    """Return one of two values for each actuated joint, shape (J,)."""
    values = {"revolute": revolute, "prismatic": prismatic}
    kinds = {joint.index: joint.kind for joint in model.joints if joint.is_actuated}
    return np.array([values[kinds[i]] for i in range(len(model.joint_names))])


def rigid_groups(model: RobotModel) -> dict[str, str]:
    """Return by link the first link of those that are fixed to each other with it."""
    groups = {model.links[0]: model.links[0]}
    for joint in model.joints:  # parents come before their children
        groups[joint.child] = groups[joint.parent] if joint.kind == "fixed" else joint.child
    return groups


def links_fixed_to(model: RobotModel, link: str) -> frozenset[str]:
    """Return a link, and all links that no movable joint separates from it."""
    groups = rigid_groups(model)
    return frozenset(other for other in model.links if groups[other] == groups[link])


def joints_before(model: RobotModel) -> Mapping[str, int]:
    """Return the number of movable joints from the base to each link, by its name."""
    return {
        link: sum(joint.kind != "fixed" for joint in joints_to(model.joints, link))
        for link in model.links
    }


def rpy_pose(translation: npt.ArrayLike, rpy: npt.ArrayLike) -> FloatArray:
    """Return a pose (4, 4) from a translation [m] and the URDF's fixed-axis angles [rad]."""
    pose = trimesh.transformations.euler_matrix(*np.asarray(rpy, np.float64), axes="sxyz")
    pose[:3, 3] = translation
    return np.asarray(pose, np.float64)
