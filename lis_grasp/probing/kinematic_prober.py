"""Kinematic prober: touch a fixed object by geometry alone, without forces."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import HandPose, Probe, ProbeOutcome
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.hands.hand import Hand
from lis_grasp.probing.finger_extension import FingerExtender
from lis_grasp.probing.guarded_motion import GuardedMotion

Fingers = Literal["one", "all"]


class KinematicProber:
    """Probes by geometry alone: ten times faster than `DynamicProber`, without forces.

    The hand moves until its first link touches (`GuardedMotion`). The contact is the point of the
    object that the link touches, with the normal of the triangle there; its force is unknown. The
    contacts of a probe are in order of time.

    Parameters
    ----------
    hand
        The hand; it needs a probe posture. The first finger with an approach leads.
    mesh
        The true object in O [m], watertight.
    fingers
        "one": the first touch ends a probe; "all": then the other fingers extend, and each that
        touches adds a contact.

    Raises
    ------
    InvalidHandError
        If the hand has no probe posture.
    InvalidMeshError
        If the mesh is not watertight.
    """

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh, *, fingers: Fingers = "one") -> None:
        self._motion = GuardedMotion(hand, mesh)
        self._extender = FingerExtender(hand, mesh) if fingers == "all" else None
        self._link_fingers = hand.link_fingers
        self._normals = np.array(mesh.face_normals)

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        """Carry out one probe; see `Prober`."""
        course = self._motion.run(probe, obstacles)
        if isinstance(course, str):
            return ProbeOutcome(probe, "blocked", reason=course)
        missed = self._motion.missed(course, obstacles)
        if course.touched is None:
            return missed
        touches = [(course.until_contact, course.touched)]
        longest = 0.0
        q = course.approach.posture.joint_positions.copy()
        if self._extender is not None:
            touching = self._link_fingers.get(course.touched.link)
            for extension in self._extender.extend(course.X_OH_end, q, but=touching):
                longest = max(longest, extension.duration)
                if extension.touched is not None:
                    time = course.until_contact + extension.until_contact
                    touches.append((time, extension.touched))
                    q[extension.joints] = extension.positions
        touches.sort(key=lambda touch: touch[0])
        contacts = Contacts(
            points=np.array([link.point for _, link in touches]),
            normals=self._normals[[link.face for _, link in touches]],
            fingers=tuple(link.link for _, link in touches),
            times=np.array([time for time, _ in touches]),
        )
        return replace(
            missed,
            status="touched",
            contacts=contacts,
            duration=course.duration + longest,
            hand_pose=HandPose(course.X_OH_end, q),
        )
