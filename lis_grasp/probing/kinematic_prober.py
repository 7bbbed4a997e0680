"""Touch a fixed object by geometry alone: the hand moves until its first link meets the object."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.exploration.probe import HandPose, Probe, ProbeOutcome
from lis_grasp.hands.hand import Hand
from lis_grasp.probing.guarded_motion import Course, GuardedMotion
from lis_grasp.probing.other_fingers import OtherFingers, Stretching

Fingers = Literal["one", "all"]


class KinematicProber:
    """Probes as `DynamicProber` does, without forces and time steps: an order faster, no Drake.

    The hand moves until its first link touches, see `GuardedMotion`: every link is checked all the
    way. The contact is the object's point that the link meets first, with the normal of the
    triangle there; its force is not known. All of a probe's contacts come in order of time.

    Parameters
    ----------
    hand
        The hand; it needs a probe posture.
    mesh
        The true object in O [m], watertight.
    finger
        The leading finger; None takes, for each probe, the first one with an approach.
    fingers
        "one": the first touch ends a probe; "all": then the other fingers stretch out, and each
        that touches adds a contact.

    Raises
    ------
    InvalidHandError
        If the hand has no probe posture (for that finger).
    InvalidMeshError
        If the mesh is not watertight.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        *,
        finger: str | None = None,
        fingers: Fingers = "one",
    ) -> None:
        self._motion = GuardedMotion(hand, mesh, finger)
        self._others = OtherFingers(hand, mesh) if fingers == "all" else None
        self._link_fingers = hand.link_fingers
        self._normals = np.array(mesh.face_normals)

    def probe(self, probe: Probe, known: KnownShape | None = None) -> ProbeOutcome:
        """Carry out one probe; see `Prober`."""
        course = self._motion.run(probe, known)
        if isinstance(course, str):
            return ProbeOutcome(probe, "blocked", reason=course)
        missed = self._motion.nothing_felt(course, probe, known)
        if course.met is None:
            return missed
        touches = [(course.until_contact, course.met)]
        longer = 0.0
        q = course.approach.posture.joint_positions.copy()
        for stretching in self._stretch(course):
            longer = max(longer, stretching.duration)
            if stretching.met is not None:
                time = course.until_contact + stretching.until_contact
                touches.append((time, stretching.met))
                q[stretching.joints] = stretching.positions
        touches.sort(key=lambda touch: touch[0])
        contacts = Contacts(
            points=np.array([met.point for _, met in touches]),
            normals=self._normals[[met.face for _, met in touches]],
            fingers=tuple(met.link for _, met in touches),
            times=np.array([time for time, _ in touches]),
            free_points=missed.free_points,
            free_radii=missed.free_radii,
        )
        return replace(
            missed,
            status="touched",
            contacts=contacts,
            duration=course.duration + longer,
            hand_pose=HandPose(course.X_OH_end, q),
        )

    def _stretch(self, course: Course) -> list[Stretching]:
        """Stretch out the fingers that did not touch, at the end of a course."""
        if self._others is None or course.met is None:
            return []
        touching = self._link_fingers.get(course.met.link)
        return self._others.stretch(
            course.X_OH_end, course.approach.posture.joint_positions, but=touching
        )
