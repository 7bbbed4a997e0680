"""Touch a fixed object with a hand's fingertip in Drake: guarded motion, and contacts out of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.grasping.hand import Hand, ProbePosture
from lis_grasp.simulation.patches import Patch
from lis_grasp.simulation.probe_motion import (
    NO_FREE_START,
    free_points,
    hand_at_start,
    object_at_start,
    probe_postures,
)
from lis_grasp.simulation.probing_scene import ProbingScene

FloatArray = npt.NDArray[np.float64]

# 0.2 mm a step of 2 ms: with the skin's stiffness, a touch passes the threshold by 1 N at the most.
_SPEED = 0.1  # [m/s]
_FORCE_THRESHOLD = 0.2  # [N]
# Free flight is skipped by strides of this length; dynamics take over a stride before contact, and
# no link of a hand is so thin that it could pass through a wall in one.
_STRIDE = 0.002  # [m]


class DynamicProber:
    """Probes with the whole hand in Drake: every link can touch, and what touches first is felt.

    The hand rides on an arm along the probe's direction at 0.1 m/s, one finger stretched out in its
    probe posture, the joints under PD control; the object is fixed. For each probe the hand is put
    at the start of the motion, with the first finger and roll about the direction that leave every
    link outside the object. As long as nothing is near, nothing acts on the hand: that part of the
    motion is exact without integration, and is skipped. From 2 mm before the first contact on, the
    motion is simulated, until a contact's normal force passes 0.2 N.

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
        The leading finger; None takes, for each probe, the first one with a free start.

    Raises
    ------
    InvalidHandError
        If the hand has no probe posture (for that finger).
    InvalidMeshError
        If the mesh is not watertight.
    """

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh, *, finger: str | None = None) -> None:
        self._postures = probe_postures(hand, finger)
        if not mesh.is_watertight:
            raise InvalidMeshError("touching needs a watertight mesh: load it with `shapes.load`")
        self._hand = hand
        self._scene = ProbingScene(hand, mesh)

    def probe(self, probe: Probe) -> ProbeOutcome:
        """Carry out one probe; see `Prober`.

        Raises
        ------
        SimulationError
            If Drake's solver fails.
        """
        posture = self._find_free_start(probe)
        if posture is None:
            return ProbeOutcome(probe, "blocked", reason=NO_FREE_START)
        patches, travelled = self._advance(probe.standoff + probe.overshoot)
        duration = travelled / _SPEED
        passed = free_points(probe, posture, travelled)
        if not patches:
            return ProbeOutcome(probe, "missed", free_points=passed, duration=duration)
        contacts = self._contacts(patches, passed, duration)
        return ProbeOutcome(probe, "touched", contacts, passed, duration)

    def _find_free_start(self, probe: Probe) -> ProbePosture | None:
        """Put hand and object at the start of the motion; None if no finger and roll are free."""
        for posture in self._postures:
            palm_to_base = self._hand.forward_kinematics(np.eye(4), posture.joint_positions)
            X_WB = hand_at_start(self._hand, posture) @ palm_to_base[self._hand.base_link]
            for k, X_WO in enumerate(object_at_start(probe)):
                self._scene.place(posture.joint_positions, X_WB, X_WO)
                if self._scene.is_free():
                    return posture
                # The leading sphere is on the line of motion, however the hand is rolled.
                leading_center = np.array([-posture.radius, 0.0, 0.0])
                if k == 0 and self._scene.clearance(leading_center) < posture.radius:
                    break
        return None

    def _advance(self, length: float) -> tuple[list[Patch], float]:
        """Move along `length` [m] until something is felt; return that, and how far it was."""
        scene, near = self._scene, 0.0
        while near < length and not scene.touches_at(min(near + _STRIDE, length)):
            near = min(near + _STRIDE, length)
        if near >= length:
            return [], length
        start = max(near - _STRIDE, 0.0)
        scene.start_motion(start, _SPEED)
        step = _SPEED * scene.time_step
        count = int(np.ceil((length - start) / step))
        for n in range(1, count + 1):
            scene.step(start + n * step, _SPEED)
            felt = scene.felt(_FORCE_THRESHOLD)
            if felt:
                return felt, start + n * step
        return [], length

    def _contacts(self, patches: list[Patch], passed: FloatArray, duration: float) -> Contacts:
        X_WO = self._scene.X_WO
        R_WO, p_WO = X_WO[:3, :3], X_WO[:3, 3]
        return Contacts(
            points=np.array([R_WO.T @ (patch.point - p_WO) for patch in patches]),
            normals=np.array([R_WO.T @ patch.normal for patch in patches]),
            forces=np.array([patch.force for patch in patches]),
            fingers=tuple(patch.link for patch in patches),
            times=np.full(len(patches), duration),
            free_points=passed,
        )
