"""Touch a fixed object with a hand's fingertip in Drake: guarded motion, and contacts out of it."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.grasping.hand import Hand
from lis_grasp.simulation.approach import rotation_to_x
from lis_grasp.simulation.guarded_motion import SPEED, Course, GuardedMotion
from lis_grasp.simulation.patches import Patch
from lis_grasp.simulation.probing_scene import ProbingScene

# 0.2 mm a step of 2 ms: with the skin's stiffness, a touch passes the threshold by 1 N at the most.
_FORCE_THRESHOLD = 0.2  # [N]
# Free flight needs no dynamics; they take over this far before the first contact [m].
_BEFORE = 0.002
# A touch is felt within this much of the first contact; what is felt no sooner is a graze [m].
_BEYOND = 0.01

GRAZED = "a link met the object and felt too little"


class DynamicProber:
    """Probes with the whole hand in Drake: every link can touch, and what touches first is felt.

    The hand rides on an arm along the probe's direction at 0.1 m/s, one finger stretched out in its
    probe posture, the joints under PD control; the object is fixed. As long as nothing is near,
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

    Raises
    ------
    InvalidHandError
        If the hand has no probe posture (for that finger).
    InvalidMeshError
        If the mesh is not watertight.
    """

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh, *, finger: str | None = None) -> None:
        self._motion = GuardedMotion(hand, mesh, finger)
        self._hand = hand
        self._scene = ProbingScene(hand, mesh)

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
        passed, duration = course.free_points(probe), course.duration
        if course.met is None:
            return ProbeOutcome(probe, "missed", free_points=passed, duration=duration)
        patches = self._feel(course)
        if not patches:
            return ProbeOutcome(
                probe, "blocked", free_points=passed, duration=duration, reason=GRAZED
            )
        contacts = self._contacts(patches, course.until_contact)
        return ProbeOutcome(probe, "touched", contacts, passed, duration)

    def _feel(self, course: Course) -> list[Patch]:
        """Simulate the last of a course; return what is felt."""
        scene, posture = self._scene, course.approach.posture
        palm_to_base = self._hand.forward_kinematics(np.eye(4), posture.joint_positions)
        X_OB = course.X_OH @ palm_to_base[self._hand.base_link]
        X_WO = np.eye(4)
        X_WO[:3, :3] = rotation_to_x(course.direction)  # the motion is along W's +x
        scene.place(posture.joint_positions, X_WO @ X_OB, X_WO)
        start = max(course.travelled - _BEFORE, 0.0)
        scene.start_motion(start, SPEED)
        step = SPEED * scene.time_step
        end = course.travelled + min(_BEYOND, course.left)
        for n in range(1, int(np.ceil((end - start) / step)) + 1):
            scene.step(start + n * step, SPEED)
            felt = scene.felt(_FORCE_THRESHOLD)
            if felt:
                return felt
        return []

    def _contacts(self, patches: list[Patch], time: float) -> Contacts:
        R_WO = self._scene.X_WO[:3, :3]
        return Contacts(
            points=np.array([patch.point for patch in patches]) @ R_WO,
            normals=np.array([patch.normal for patch in patches]) @ R_WO,
            forces=np.array([patch.force for patch in patches]),
            fingers=tuple(patch.link for patch in patches),
            times=np.full(len(patches), time),
        )
