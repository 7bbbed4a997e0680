"""Dynamic prober: touch an object with a hand in Drake, by guarded motion and contact patches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import PROBE_SPEED, HandPose, Probe, ProbeOutcome
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.hands.hand import Hand
from lis_grasp.probing.guarded_motion import Course, GuardedMotion
from lis_grasp.simulation.contact_patches import Patch
from lis_grasp.simulation.probing_scene import FreeObject, ProbingScene
from lis_grasp.typing import FloatArray

# 0.2 mm a step of 2 ms: with the skin's stiffness, a touch exceeds the threshold by at most 1 N.
_FORCE_THRESHOLD = 0.2  # [N]
# Free flight needs no dynamics: the simulation starts this far before the first contact [m].
_BEFORE = 0.002
# A touch is detected within this distance of the first contact; later ones are grazes [m].
_BEYOND = 0.01
# A free object is touched slowly [m/s]; tilted by more than this afterwards, it has toppled [rad].
_GENTLE_SPEED, _TOPPLED = 0.03, np.deg2rad(5.0)

GRAZED = "a link grazed the object below the force threshold"
TOPPLED = "the touch toppled the object"


class DynamicProber:
    """Probes with the whole hand in Drake; every link can touch.

    The hand rides on an arm along the probe's direction at 0.1 m/s, one finger extended in its
    probe posture, the joints under PD control. Free flight is exact without integration and is
    skipped (`GuardedMotion`). The motion is simulated from 2 mm before the first contact until a
    contact's normal force exceeds 0.2 N.

    Contact is Drake's hydroelastic one between the exact mesh and compliant links, so bores and
    concave corners are true. A contact is the area-weighted centroid and normal of its patch, not
    the force's direction, which friction tilts. A patch across an edge counts as two contacts. Each
    is tagged with the link that touched.

    An outcome depends on nothing but the probe.

    Parameters
    ----------
    hand, mesh
        The hand and the true object; requirements and errors as of `KinematicProber`.
    free
        Makes the object free to move on a table; None fixes it. Contacts are in the object's frame
        at that time. Each probe starts with the object at its first pose. A touch that topples it
        is not used.
    """

    def __init__(
        self, hand: Hand, mesh: trimesh.Trimesh, *, free: FreeObject | None = None
    ) -> None:
        self._scene = ProbingScene(hand, mesh, free)
        self._motion = GuardedMotion(hand, mesh)
        self._hand = hand
        self._free = free
        self._hull = np.asarray(mesh.convex_hull.vertices)

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        """Carry out one probe; see `Prober`.

        Raises
        ------
        SimulationError
            If Drake's solver fails.
        """
        missed, course = self._motion.outcome(probe, obstacles)
        if course is None or course.touched is None:
            return missed
        patches, X_WO, hand_pose = self._touch(course)
        moved, tilt = self._displacement()
        reason = TOPPLED if tilt > _TOPPLED else GRAZED if not patches else ""
        if reason:
            return replace(missed, status="blocked", reason=reason, moved=moved)
        return replace(
            missed,
            status="touched",
            contacts=_contacts(patches, X_WO, course.until_contact),
            moved=moved,
            hand_pose=hand_pose,
        )

    def _touch(self, course: Course) -> tuple[list[Patch], FloatArray, HandPose]:
        """Simulate the last part of a course; return contact patches, X_WO and the hand's pose."""
        scene, posture = self._scene, course.approach.posture
        palm_to_base = self._hand.forward_kinematics(np.eye(4), posture.joint_positions)
        X_OB = course.X_OH @ palm_to_base[self._hand.base_link]
        scene.place(posture.joint_positions, X_OB, course.direction)
        speed = PROBE_SPEED if self._free is None else _GENTLE_SPEED
        start = max(course.travelled - _BEFORE, 0.0)
        scene.start_motion(start, speed)
        step = speed * scene.time_step
        end = course.travelled + min(_BEYOND, course.remaining)
        patches: list[Patch] = []
        for n in range(1, int(np.ceil((end - start) / step)) + 1):
            scene.step(start + n * step, speed)
            patches = scene.patches(_FORCE_THRESHOLD)
            if patches:
                break
        X_WO = scene.X_WO
        hand_pose = HandPose(np.linalg.inv(X_WO) @ scene.X_WH, scene.joint_positions)
        if self._free is not None:
            scene.retreat(start + n * step, PROBE_SPEED)
        return patches, X_WO, hand_pose

    def _displacement(self) -> tuple[float, float]:
        """Return the largest displacement of the object [m], and its tilt [rad]."""
        X_WO = self._scene.X_WO
        moved = self._hull @ X_WO[:3, :3].T + X_WO[:3, 3] - self._hull
        tilt = float(np.arccos(np.clip(X_WO[2, 2], -1.0, 1.0)))
        return float(np.linalg.norm(moved, axis=1).max()), tilt


def _contacts(patches: list[Patch], X_WO: FloatArray, time: float) -> Contacts:
    """Return patches in W as contacts in O, for an object at X_WO."""
    points = np.array([patch.point for patch in patches])
    return Contacts(
        points=(points - X_WO[:3, 3]) @ X_WO[:3, :3],
        normals=np.array([patch.normal for patch in patches]) @ X_WO[:3, :3],
        forces=np.array([patch.force for patch in patches]),
        fingers=tuple(patch.link for patch in patches),
        times=np.full(len(patches), time),
    )
