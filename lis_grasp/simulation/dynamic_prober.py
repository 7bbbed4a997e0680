"""Touch an object with a hand's fingertip in Drake: guarded motion, and contacts out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.exploration.motion_time import PROBE_SPEED
from lis_grasp.exploration.probe import HandPose, Probe, ProbeOutcome
from lis_grasp.hands.hand import Hand
from lis_grasp.probing.guarded_motion import Course, GuardedMotion
from lis_grasp.simulation.contact_patches import Patch
from lis_grasp.simulation.probing_scene import FreeObject, ProbingScene
from lis_grasp.typing import FloatArray

# 0.2 mm a step of 2 ms: with the skin's stiffness, a touch passes the threshold by 1 N at the most.
_FORCE_THRESHOLD = 0.2  # [N]
# Free flight needs no dynamics; they take over this far before the first contact [m].
_BEFORE = 0.002
# A touch is felt within this much of the first contact; what is felt no sooner is a graze [m].
_BEYOND = 0.01
# An object that may move is touched slowly [m/s]; tilted by more than this afterwards, it has
# toppled [rad].
_GENTLE_SPEED, _TOPPLED = 0.03, np.deg2rad(5.0)

GRAZED = "a link met the object and felt too little"
TOPPLED = "the touch toppled the object"


class DynamicProber:
    """Probes with the whole hand in Drake: every link can touch, and what touches first is felt.

    The hand rides on an arm along the probe's direction at 0.1 m/s, one finger stretched out in its
    probe posture, the joints under PD control. As long as nothing is near,
    nothing acts on the hand: that part of the motion is exact without integration, and is skipped
    (`GuardedMotion`). From 2 mm before the first contact on, the motion is simulated, until a
    contact's normal force passes 0.2 N.

    Contact is Drake's hydroelastic one between the exact mesh and compliant links, so bores and
    concave corners are true. A contact is the area-weighted centroid and normal of its patch, not
    the force's direction, which friction tilts; a patch across an edge counts as two contacts. Each
    is tagged with the link that touched.

    An outcome depends on nothing but the probe.

    Parameters
    ----------
    hand
        The hand; it needs a probe posture.
    mesh
        The true object in O [m], watertight.
    finger
        The leading finger; None takes, for each probe, the first one with an approach.
    free
        How the object stands on a table, where a touch may move it; None holds it. Its motion is
        measured: contacts are told in the object's frame wherever it is, and the next probe finds
        it again. A touch that topples it is not used.

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
        free: FreeObject | None = None,
    ) -> None:
        self._motion = GuardedMotion(hand, mesh, finger)
        self._hand = hand
        self._scene = ProbingScene(hand, mesh, free)
        self._free = free
        self._hull = np.asarray(mesh.convex_hull.vertices)

    def probe(self, probe: Probe, known: KnownShape | None = None) -> ProbeOutcome:
        """Carry out one probe; see `Prober`.

        Raises
        ------
        SimulationError
            If Drake's solver fails.
        """
        course = self._motion.run(probe, known)
        if isinstance(course, str):
            return ProbeOutcome(probe, "blocked", reason=course)
        missed = self._motion.nothing_felt(course, probe, known)
        if course.met is None:
            return missed
        patches, X_WO, hand_pose = self._feel(course)
        moved, tilt = self._moved()
        reason = TOPPLED if tilt > _TOPPLED else GRAZED if not patches else ""
        if reason:
            return replace(missed, status="blocked", reason=reason, moved=moved)
        contacts = _contacts(patches, X_WO, course.until_contact)
        return replace(
            missed, status="touched", contacts=contacts, moved=moved, hand_pose=hand_pose
        )

    def _feel(self, course: Course) -> tuple[list[Patch], FloatArray, HandPose]:
        """Simulate the last of a course; return what is felt, the object's pose and the hand's."""
        scene, posture = self._scene, course.approach.posture
        palm_to_base = self._hand.forward_kinematics(np.eye(4), posture.joint_positions)
        X_OB = course.X_OH @ palm_to_base[self._hand.base_link]
        scene.place(posture.joint_positions, X_OB, course.direction)
        speed = PROBE_SPEED if self._free is None else _GENTLE_SPEED
        start = max(course.travelled - _BEFORE, 0.0)
        scene.start_motion(start, speed)
        step = speed * scene.time_step
        end = course.travelled + min(_BEYOND, course.left)
        felt: list[Patch] = []
        for n in range(1, int(np.ceil((end - start) / step)) + 1):
            scene.step(start + n * step, speed)
            felt = scene.felt(_FORCE_THRESHOLD)
            if felt:
                break
        X_WO = scene.X_WO
        X_OH = np.linalg.inv(X_WO) @ scene.X_WB @ self._hand.X_LH
        hand_pose = HandPose(X_OH, scene.joint_positions)
        if self._free is not None:
            scene.retreat(start + n * step, PROBE_SPEED)
        return felt, X_WO, hand_pose

    def _moved(self) -> tuple[float, float]:
        """Return by how much the touch has moved the object [m], and tilted it [rad]."""
        X_WO = self._scene.X_WO
        moved = self._hull @ X_WO[:3, :3].T + X_WO[:3, 3] - self._hull
        tilt = float(np.arccos(np.clip(X_WO[2, 2], -1.0, 1.0)))
        return float(np.linalg.norm(moved, axis=1).max()), tilt


def _contacts(patches: list[Patch], X_WO: FloatArray, time: float) -> Contacts:
    """Return what was felt, in O: wherever the touch had moved the object by then."""
    points = np.array([patch.point for patch in patches])
    return Contacts(
        points=(points - X_WO[:3, 3]) @ X_WO[:3, :3],
        normals=np.array([patch.normal for patch in patches]) @ X_WO[:3, :3],
        forces=np.array([patch.force for patch in patches]),
        fingers=tuple(patch.link for patch in patches),
        times=np.full(len(patches), time),
    )
