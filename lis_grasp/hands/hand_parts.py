"""Records of a hand's parts: joints, inertias, collision bodies, pads, and probe postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh

from lis_grasp.typing import FloatArray

JointKind = Literal["revolute", "prismatic", "fixed"]
GeometryKind = Literal["box", "sphere", "cylinder", "capsule", "mesh"]
HandKind = Literal["multi_finger", "jaw"]


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint of the hand's tree.

    Parameters
    ----------
    name, kind
        As in the URDF; a continuous joint is a revolute one without limits.
    parent, child
        Names of the two links.
    X_PJ
        Shape (4, 4): pose of the joint frame (the child's frame at position 0) in the parent's.
    axis_J
        Shape (3,), unit, in the joint frame; zeros for a fixed joint.
    index
        Place of the joint in `Hand.joint_names`, or of the joint that it follows; -1 for a fixed
        joint.
    follows
        Whether a transmission couples it to another joint (a URDF's ``mimic``): it has no motor.
    multiplier, offset
        Of a joint that follows: its position is ``multiplier * q[index] + offset``.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    X_PJ: FloatArray
    axis_J: FloatArray
    index: int
    follows: bool = False
    multiplier: float = 1.0
    offset: float = 0.0

    @property
    def is_actuated(self) -> bool:
        """Whether it is one of `Hand.joint_names`."""
        return self.index >= 0 and not self.follows

    def position(self, q: FloatArray) -> FloatArray:
        """Return its position, shape (...), for those of the actuated joints, (..., J)."""
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
class Inertial:
    """Mass properties of a link.

    Parameters
    ----------
    mass
        [kg]; 0 for a frame without matter.
    center_L
        Shape (3,) [m]: centre of mass in the link frame.
    inertia_L
        Shape (3, 3) [kg m^2]: about the centre of mass, along the link frame's axes.
    """

    mass: float
    center_L: FloatArray
    inertia_L: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LinkGeometry:
    """One collision body of a link.

    Parameters
    ----------
    link
        Name of the link.
    X_LG
        Shape (4, 4): pose of the geometry in the link frame.
    kind
        What it is.
    dimensions
        [m] box: its three sides; sphere: radius; cylinder and capsule: radius and length along z
        (of the capsule's straight part); mesh: empty.
    mesh
        The body as a closed triangle mesh in its own frame G [m].
    """

    link: str
    X_LG: FloatArray
    kind: GeometryKind
    dimensions: tuple[float, ...]
    mesh: trimesh.Trimesh


@dataclass(frozen=True, slots=True, eq=False)
class Pad:
    """The part of a finger that is meant to touch.

    Parameters
    ----------
    finger
        Name of the finger.
    link
        The link that carries the pad.
    center_L
        Shape (3,) [m], in the link frame: centre of the pad's sphere, or of a flat pad's face.
    radius
        [m] of the sphere: a surface is touched at p with outward normal n when the centre is at
        ``p + radius * n``. 0: a flat pad.
    axis_L
        Shape (3,), unit, in the link frame: the way out of the finger at the middle of the pad.
    half_angle
        [rad] The pad covers the directions within this angle of its axis.
    """

    finger: str
    link: str
    center_L: FloatArray
    radius: float
    axis_L: FloatArray
    half_angle: float


@dataclass(frozen=True, slots=True, eq=False)
class ProbePosture:
    """A posture in which one fingertip leads, for touching.

    Parameters
    ----------
    finger
        The leading finger.
    joint_positions
        Shape (J,) [rad or m].
    direction_H
        Shape (3,), unit, in the palm frame: the way the hand moves.
    link, center_L, radius
        The leading sphere: its link, its centre in the link frame (3,) [m], its radius [m].
    """

    finger: str
    joint_positions: FloatArray
    direction_H: FloatArray
    link: str
    center_L: FloatArray
    radius: float
