"""Ball prober: touch a fixed object with a ball alone, without a hand and without forces."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidMeshError, require_positive
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.probe_motions import PROBE_SPEED
from lis_grasp.exploration.workspace import TIP_RADIUS, ObstacleModel
from lis_grasp.probing.guarded_motion import AT_TABLE, TOUCHING
from lis_grasp.shapes.mesh_distance import InsideTest, MeshTree
from lis_grasp.typing import FloatArray

# Least step of an advance [m], so that grazing motions end.
_LEAST_STEP = 5e-5


class BallProber:
    """Probes with a ball that moves in a straight line: a prober for thousands of touches.

    Conservative advancement (Mirtich 1996): the ball moves as far as its distance from the object
    allows, repeatedly. The contact is the point of the object that it touches, with the normal of
    the triangle there.

    Parameters
    ----------
    mesh
        The true object in O [m].
    radius
        Of the ball [m]; its leading point moves along a probe.
    support_height
        Height of a table in O, which ends a motion [m]; None for an object that is held.

    Raises
    ------
    InvalidMeshError
        If the mesh is not watertight.
    InvalidOptionError
        If the radius is not positive.
    """

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        *,
        radius: float = TIP_RADIUS,
        support_height: float | None = None,
    ) -> None:
        require_positive(radius=radius)
        if not mesh.is_watertight:
            raise InvalidMeshError("touching needs a watertight mesh: load it with `shapes.load`")
        self._tree, self._inside = MeshTree(mesh), InsideTest(mesh)
        self._normals = np.asarray(mesh.face_normals)
        self._radius, self._support_height = radius, support_height

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        """Carry out one probe; see `Prober`. The ball starts at the probe, without an approach."""
        along, first = probe.direction, probe.start - self._radius * probe.direction
        length, at_table = self._way(first, along, probe.standoff + probe.overshoot)
        if length < 0.0:
            return ProbeOutcome(probe, "blocked", reason="the table is at the start")
        if self._inside.any_inside(first[None]) or self._gap(first)[0] < 0.0:
            return ProbeOutcome(probe, "blocked", reason="the object is at the start")
        passed, touched = self._advance(first, along, length)
        steps = np.arange(0.0, max(passed, TOUCHING), self._radius)
        free_points = first + steps[:, None] * along
        free = {"free_points": free_points, "free_radii": np.full(len(steps), self._radius)}
        seconds = passed / PROBE_SPEED
        if touched is None:
            reason = AT_TABLE if at_table else ""
            status = "blocked" if at_table else "missed"
            return ProbeOutcome(probe, status, duration=seconds, reason=reason, **free)  # type: ignore[arg-type]
        face, point = touched
        contacts = Contacts(point[None], self._normals[[face]], times=np.array([seconds]))
        return ProbeOutcome(probe, "touched", contacts, duration=seconds, **free)  # type: ignore[arg-type]

    def _way(self, first: FloatArray, along: FloatArray, length: float) -> tuple[float, bool]:
        """Return how far the ball may move [m], below 0 if nowhere, and if the table ends it."""
        if self._support_height is None:
            return length, False
        room = float(first[2]) - self._radius - self._support_height
        if room < 0.0:
            return room, True
        until = room / -float(along[2]) if along[2] < 0.0 else np.inf
        return min(length, until), until < length

    def _advance(
        self, first: FloatArray, along: FloatArray, length: float
    ) -> tuple[float, tuple[int, FloatArray] | None]:
        """Return how far the ball moves [m], and the triangle and point that end it."""
        passed = 0.0
        while True:
            gap, face, point = self._gap(first + passed * along)
            if gap < TOUCHING:
                return passed, (face, point)
            if passed >= length:
                return length, None
            passed = min(passed + max(gap, _LEAST_STEP), length)

    def _gap(self, center: FloatArray) -> tuple[float, int, FloatArray]:
        """Return the distance of the ball from the surface [m], with its triangle and point."""
        squares, faces, points = self._tree.nearest(center[None])
        return float(np.sqrt(squares[0])) - self._radius, int(faces[0]), points[0]
