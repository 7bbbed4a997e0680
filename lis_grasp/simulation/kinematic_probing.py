"""Touch a fixed object by geometry alone: the hand moves until its first link meets the object."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.grasping.collision import HandCollisionChecker, NearestLink
from lis_grasp.grasping.hand import Hand, ProbePosture
from lis_grasp.simulation.probe_motion import (
    NO_FREE_START,
    free_points,
    hand_at_start,
    object_at_start,
    probe_postures,
)
from lis_grasp.winding import any_inside

FloatArray = npt.NDArray[np.float64]

_SPEED = 0.1  # [m/s], for the time that a probe would take
# Nearer than this counts as touching [m].
_TOUCHING = 2e-5


class KinematicProber:
    """Probes as `DynamicProber` does, without forces and time steps: an order faster, no Drake.

    The hand starts alike, and moves by conservative advancement (Mirtich 1996): as far as the
    distance between any of its links and the object allows, over and over, until a link touches.
    Every link is checked all the way; distances are python-fcl's, on the exact mesh. The contact is
    the object's point that the link meets first, with the normal of the triangle there; its force
    is not known.

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
        postures = probe_postures(hand, finger)
        if not mesh.is_watertight:
            raise InvalidMeshError("touching needs a watertight mesh: load it with `shapes.load`")
        self._mesh = mesh
        self._checker = HandCollisionChecker(hand, mesh)
        self._starts = [
            (
                posture,
                hand_at_start(hand, posture),
                self._checker.poses_in_hand(posture.joint_positions),
            )
            for posture in postures
        ]

    def probe(self, probe: Probe) -> ProbeOutcome:
        """Carry out one probe; see `Prober`."""
        posture = self._find_free_start(probe)
        if posture is None:
            return ProbeOutcome(probe, "blocked", reason=NO_FREE_START)
        met, travelled = self._advance(probe)
        duration = travelled / _SPEED
        passed = free_points(probe, posture, travelled)
        if met is None:
            return ProbeOutcome(probe, "missed", free_points=passed, duration=duration)
        contacts = Contacts(
            points=met.point[None],
            normals=np.array(self._mesh.face_normals[met.face])[None],
            fingers=(met.link,),
            times=np.array([duration]),
            free_points=passed,
        )
        return ProbeOutcome(probe, "touched", contacts, passed, duration)

    def _find_free_start(self, probe: Probe) -> ProbePosture | None:
        """Put the hand at the start of the motion; None if no finger and roll are free."""
        for posture, X_WH, poses in self._starts:
            # No link can leave the object without passing its surface, so one point tells for all.
            if any_inside(self._mesh, (probe.start - posture.radius * probe.direction)[None]):
                continue
            for X_WO in object_at_start(probe):
                if not self._checker.place(np.linalg.inv(X_WO) @ X_WH, poses):
                    return posture
        return None

    def _advance(self, probe: Probe) -> tuple[NearestLink | None, float]:
        """Move until a link touches; return which, and how far that was [m]."""
        length, travelled = probe.standoff + probe.overshoot, 0.0
        while True:
            nearest = self._checker.nearest(travelled * probe.direction)
            if nearest.distance < _TOUCHING:
                return nearest, travelled
            if travelled >= length:
                return None, length
            travelled = min(travelled + nearest.distance, length)
