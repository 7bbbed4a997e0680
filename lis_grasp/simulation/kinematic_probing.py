"""Touch a fixed object by geometry alone: the hand moves until its first link meets the object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.grasping.hand import Hand
from lis_grasp.simulation.guarded_motion import GuardedMotion


class KinematicProber:
    """Probes as `DynamicProber` does, without forces and time steps: an order faster, no Drake.

    The hand moves until its first link touches, see `GuardedMotion`: every link is checked all the
    way. The contact is the object's point that the link meets first, with the normal of the
    triangle there; its force is not known.

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
        self._normals = np.array(mesh.face_normals)

    def probe(self, probe: Probe, known: KnownShape | None = None) -> ProbeOutcome:
        """Carry out one probe; see `Prober`."""
        course = self._motion.run(probe, known)
        if isinstance(course, str):
            return ProbeOutcome(probe, "blocked", reason=course)
        free_points, free_radii = self._motion.free_space(course, probe, known)
        missed = ProbeOutcome(
            probe,
            "missed",
            free_points=free_points,
            duration=course.duration,
            free_radii=free_radii,
        )
        if course.met is None:
            return missed
        contacts = Contacts(
            points=course.met.point[None],
            normals=self._normals[course.met.face][None],
            fingers=(course.met.link,),
            times=np.array([course.until_contact]),
            free_points=free_points,
            free_radii=free_radii,
        )
        return replace(missed, status="touched", contacts=contacts)
