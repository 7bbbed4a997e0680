"""The robot hand: links, joints, pads, postures, and kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from lis_grasp.geometry import apply_pose
from lis_grasp.robots.kinematics import Kinematics
from lis_grasp.robots.robot_model import (
    Cup,
    GraspFamily,
    HandKind,
    Pad,
    ProbePosture,
    RobotModel,
    joints_to,
    links_fixed_to,
)
from lis_grasp.robots.yaml_files import read_hand_file
from lis_grasp.typing import FloatArray

SEATING = 0.012
"""Last part of the approach of a fixed jaw or a suction cup [m], at whose end it touches."""
# Fingertips that are planned this near to the table [m] may slide on it.
_NEAR_TABLE = 0.002


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Hand(RobotModel):
    """A robot hand, read by `Hand.load` from a URDF, SDF or MJCF and one YAML file.

    Frames: O the frame of poses (the object's, or any other), H the palm frame, L a link frame. J
    actuated joints, in the URDF's order.

    Parameters
    ----------
    name, kind
        Its name; ``"parallel_jaw"`` for parallel flat pads, ``"suction_cup"`` for
        one cup, else ``"multi_finger"``.
    joint_names, lower, upper, effort_limits
        The J actuated joints: names, limits (J,) [rad or m] and largest effort (J,) [N m or N].
    links
        Names of all links, a parent before its children; the first is the base.
    joints
        Every joint, fixed ones too, a parent before its children.
    inertials
        Mass properties by link name.
    link_geometries
        The collision bodies.
    visuals
        Visual shapes of the links, for drawing only.
    hulls_of_visuals
        Names of the links whose collision bodies are the convex hulls of their visual meshes.
    pads
        One for each finger.
    X_LH
        Shape (4, 4): the palm frame in the base link's.
    approach_H
        Shape (3,), unit: direction of the hand's motion towards an object to grasp.
    pregrasps
        Opened postures (J,) by name.
    probe_postures
        Postures (J,) by the leading finger's name.
    self_collision_exclusions
        Pairs of link names, each pair sorted, that may touch.
    max_contact_force
        Largest force of one finger [N].
    X_FB
        Shape (4, 4): the base link in the flange frame of an arm; None for the default mount.
    low_objects
        File of the same hand with narrower pads, for objects lower than its round pads; or None.
    families
        Kinds of grasps that the hand can do.

    Examples
    --------
    >>> Hand.load("wsg50")
    Hand('wsg50', parallel_jaw, 2 joints, fingers: left, right)
    """

    name: str
    kind: HandKind
    pads: tuple[Pad, ...]
    X_LH: FloatArray
    approach_H: FloatArray
    pregrasps: Mapping[str, FloatArray]
    probe_postures: Mapping[str, ProbePosture]
    self_collision_exclusions: frozenset[tuple[str, str]]
    max_contact_force: float
    X_FB: FloatArray | None = None
    low_objects: Path | None = None
    families: tuple[GraspFamily, ...] = ("pinch",)

    @classmethod
    def load(cls, path_or_name: str | Path) -> Hand:
        """Read a hand: one of `HAND_NAMES` or of an installed package, or a YAML file by its path.

        Raises `InvalidHandError` if there is no such hand, or its YAML or URDF is incomplete or
        contradicts itself.
        """
        return cls(**read_hand_file(path_or_name))

    def __repr__(self) -> str:
        joints, fingers = len(self.joint_names), ", ".join(self.fingers)
        return f"Hand({self.name!r}, {self.kind}, {joints} joints, fingers: {fingers})"

    def for_height(self, height: float) -> Hand:
        """Return the hand with the pads for an object of a height [m] above its support."""
        high = height >= 2.0 * min(pad.radius for pad in self.pads)
        if high or self.low_objects is None or "flat_faces" not in self.families:
            return self
        return Hand.load(self.low_objects)

    @property
    def fingers(self) -> tuple[str, ...]:
        """Names of the fingers, in the order of the pads."""
        return tuple(pad.finger for pad in self.pads)

    @property
    def fixed_fingers(self) -> tuple[str, ...]:
        """Names of the fingers that no joint moves: jaws that another one closes on."""
        return tuple(finger for finger in self.fingers if not self.finger_joints(finger))

    @property
    def cup(self) -> Cup | None:
        """The suction cup that it holds with; None for a hand with fingers."""
        return self.pads[0].cup

    @property
    def seated_fingers(self) -> tuple[str, ...]:
        """Names of the fingers that the hand's own motion seats: fixed jaws and suction cups."""
        return self.fixed_fingers if self.cup is None else self.fingers

    @property
    def slides_on_table(self) -> bool:
        """Whether fingertips may slide on a table: jaws, with their long pads, stick to it."""
        return "table" in self.families

    def slides_at(self, X_OH: npt.ArrayLike, q: npt.ArrayLike, support_height: float) -> bool:
        """Return whether fingertips are so near to a table at a height [m] that they may slide."""
        if not self.slides_on_table:
            return False
        links, tips = self.forward_kinematics(X_OH, q), self.fingertip_links
        heights = [
            apply_pose(links[g.link] @ g.X_LG, g.mesh.vertices)[:, 2].min()
            for g in self.link_geometries
            if g.link in tips
        ]
        return bool(abs(min(heights, default=np.inf) - support_height) < _NEAR_TABLE)

    @property
    def pad_links(self) -> frozenset[str]:
        """The links that carry pads, and the links fixed to them."""
        links = {pad.link for pad in self.pads}
        for joint in self.joints:  # parents come before their children
            if joint.kind == "fixed" and joint.parent in links:
                links.add(joint.child)
        return frozenset(links)

    @property
    def fingertip_links(self) -> frozenset[str]:
        """The links that carry a pad or lead in a probe posture, and the links fixed to them."""
        tips = {pad.link for pad in self.pads}
        tips |= {posture.link for posture in self.probe_postures.values()}
        return frozenset().union(*(links_fixed_to(self, tip) for tip in tips))

    @property
    def base_link(self) -> str:
        """Name of the root of the link tree."""
        return self.links[0]

    @property
    def mass(self) -> float:
        """Mass of the whole hand [kg]."""
        return float(sum(inertial.mass for inertial in self.inertials.values()))

    @property
    def link_fingers(self) -> Mapping[str, str]:
        """Finger by link name; links of several fingers or of none are absent."""
        owners: dict[str, set[str]] = {}
        for pad in self.pads:
            for joint in joints_to(self.joints, pad.link):
                owners.setdefault(joint.child, set()).add(pad.finger)
        fixed = [pad for pad in self.pads if pad.finger in self.fixed_fingers]
        owners |= {pad.link: {pad.finger} for pad in fixed}  # though it carries the other jaw
        # Side branches of a finger's links belong to the finger, too.
        for joint in self.joints:
            if joint.child not in owners and joint.parent in owners:
                owners[joint.child] = owners[joint.parent]
        single = {link: next(iter(o)) for link, o in owners.items() if len(o) == 1}
        return MappingProxyType({link: single[link] for link in self.links if link in single})

    def finger_joints(self, finger: str) -> tuple[int, ...]:
        """Return the indices of the joints that move a finger's pad, from the palm outwards."""
        pad = next(pad for pad in self.pads if pad.finger == finger)
        moving = (joint.index for joint in joints_to(self.joints, pad.link) if joint.index >= 0)
        return tuple(dict.fromkeys(moving))

    def forward_kinematics(self, X_OH: npt.ArrayLike, q: npt.ArrayLike) -> dict[str, FloatArray]:
        """Return the pose of every link, for any number of hand poses at once.

        Parameters
        ----------
        X_OH
            Shape (..., 4, 4): poses of the palm.
        q
            Shape (..., J) [rad or m]: joint positions; its leading dimensions broadcast against
            the dimensions of `X_OH`.

        Returns
        -------
        dict
            Link name -> poses X_OL, shape (..., 4, 4), in the order of `links`.
        """
        return self._kinematics.poses(X_OH, q)

    def pad_centers(
        self, X_OH: npt.ArrayLike, q: npt.ArrayLike, offsets: FloatArray | None = None
    ) -> FloatArray:
        """Return the pads' centres in O, (..., F, 3) [m]; arguments as `forward_kinematics`.

        With `offsets` (..., F, 3) [m] from the centres, in the frames of the pads' links, return
        those points of the pads instead.
        """
        return self._kinematics.pads(X_OH, q, offsets)[0]

    def pad_axes(self, X_OH: npt.ArrayLike, q: npt.ArrayLike) -> FloatArray:
        """Return the pads' axes in O, (..., F, 3); arguments as `forward_kinematics`."""
        return self._kinematics.pads(X_OH, q)[1]

    def pad_jacobians(
        self, X_OH: npt.ArrayLike, q: npt.ArrayLike, offsets: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the pads' centres and axes, and their Jacobians by palm and joints.

        Parameters
        ----------
        X_OH, q, offsets
            As in `pad_centers`.

        Returns
        -------
        centers, axes
            Shape (..., F, 3), as in `pad_centers` and `pad_axes`.
        of_centers, of_axes
            Shape (..., F, 3, 6 + J). Columns 0 to 2: turning the palm about O's axes through the
            palm's origin [m/rad]; 3 to 5: moving the palm along O's axes; then the joints [m/rad or
            1], zero for joints that do not move that pad.
        """
        return self._kinematics.pad_jacobians(X_OH, q, offsets)

    @cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(
            self.links, self.joints, self.pads, X_LH=self.X_LH, actuated=len(self.joint_names)
        )


def thumb_of(axes: FloatArray) -> int:
    """Return the index of the finger that opposes the others.

    Its pad's axis is the least aligned with the mean axis of the other pads.

    Parameters
    ----------
    axes
        Shape (F, 3), unit: the pads' axes, as in `Hand.pad_axes`.
    """
    return int(np.argmin([axes[f] @ np.delete(axes, f, axis=0).mean(0) for f in range(len(axes))]))
