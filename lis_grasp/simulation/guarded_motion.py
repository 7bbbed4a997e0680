"""A probe's motion through the true scene: in from outside, along, and to the first contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.exploration.probe import Probe
from lis_grasp.grasping.collision import HandCollisionChecker, NearestLink
from lis_grasp.grasping.hand import Hand
from lis_grasp.simulation.approach import NO_FREE_START, NO_FREE_WAY, Approach, ApproachPlanner
from lis_grasp.winding import any_inside

FloatArray = npt.NDArray[np.float64]

SPEED = 0.1
"""Of a guarded motion [m/s]."""

FREE_POINT_SPACING = 0.01
"""Distance between places that a tip is recorded to have passed [m]."""

# On the way in, and back out the same way [m/s].
_TRANSIT_SPEED = 0.25
# Nearer than this counts as touching [m].
_TOUCHING = 2e-5


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """How far a hand came on a probe, by geometry alone: up to the first contact of any link.

    Parameters
    ----------
    approach
        Posture, and pose at the probe's start.
    X_OH
        Shape (4, 4): the palm where the last leg began: the way in, or the probe's own motion.
    direction
        Shape (3,), unit, in O: of that leg.
    came
        What was gone on the way in [m], the last leg included.
    travelled
        What was gone on the last leg [m].
    left
        What was left of it [m].
    met
        The link that touches the object, and where; None where nothing was met.
    """

    approach: Approach
    X_OH: FloatArray
    direction: FloatArray
    came: float
    travelled: float
    left: float
    met: NearestLink | None

    @property
    def _along(self) -> float:
        """How far the hand went along the probe's own motion [m]."""
        return 0.0 if self.came < self.approach.run_in else self.travelled

    @property
    def until_contact(self) -> float:
        """Time of the motion to where it ended [s]."""
        return self.came / _TRANSIT_SPEED + self._along / SPEED

    @property
    def duration(self) -> float:
        """Time of the motion, there and back the same way [s]."""
        return self.until_contact + (self.came + self._along) / _TRANSIT_SPEED

    def free_points(self, probe: Probe) -> FloatArray:
        """Return places that the leading sphere's centre passed, shape (K, 3) [m], in O."""
        start = probe.start - self.approach.posture.radius * probe.direction
        outside = start - self.approach.run_in * self.approach.axis
        way_in = outside + _steps(self.came) * self.approach.axis
        return np.vstack([way_in, start + _steps(self._along) * probe.direction])


class GuardedMotion:
    """Moves a hand through the true scene until a link touches.

    By conservative advancement (Mirtich 1996): as far as the distance between any of the links and
    the object allows, over and over. Distances are python-fcl's, on the exact mesh.

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

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh, finger: str | None) -> None:
        self._planner = ApproachPlanner(hand, finger)
        if not mesh.is_watertight:
            raise InvalidMeshError("touching needs a watertight mesh: load it with `shapes.load`")
        self._mesh = mesh
        self._checker = HandCollisionChecker(hand, mesh)
        self._poses = {
            name: self._checker.poses_in_hand(posture.joint_positions)
            for name, posture in hand.probe_postures.items()
        }

    def run(self, probe: Probe, known: KnownShape | None) -> Course | str:
        """Carry a probe out up to the first contact, or say why it cannot be.

        With `known`, the hand comes in from outside of the object's ball, past what is known, and
        may meet what is not. Without, it starts wherever no link touches the true object.
        """
        if known is None:
            approach = self._free_start(probe)
            if approach is None:
                return NO_FREE_START
        else:
            approach = self._planner.plan(probe, known)
            if approach is None:
                return NO_FREE_WAY
            if self._place(approach, approach.X_OH_outside):
                return NO_FREE_START
            if approach.run_in > 0.0:
                met, came = self._advance(approach.axis, approach.run_in)
                if met is not None:
                    left, outside = approach.run_in - came, approach.X_OH_outside
                    return Course(approach, outside, approach.axis, came, came, left, met)
        self._place(approach, approach.X_OH)
        length = probe.standoff + probe.overshoot
        met, gone = self._advance(probe.direction, length)
        return Course(
            approach, approach.X_OH, probe.direction, approach.run_in, gone, length - gone, met
        )

    def _place(self, approach: Approach, X_OH: FloatArray) -> bool:
        """Put the hand somewhere; tell whether a link touches the object's surface."""
        return self._checker.place(X_OH, self._poses[approach.posture.finger])

    def _free_start(self, probe: Probe) -> Approach | None:
        inside: dict[float, bool] = {}  # by the tip's radius
        for approach in self._planner.starts(probe):
            radius = approach.posture.radius
            if radius not in inside:
                # No link can leave the object without passing its surface: one point tells for all.
                center = probe.start - radius * probe.direction
                inside[radius] = any_inside(self._mesh, center[None])
            if not inside[radius] and not self._place(approach, approach.X_OH):
                return approach
        return None

    def _advance(self, direction: FloatArray, length: float) -> tuple[NearestLink | None, float]:
        """Move the placed hand until a link touches; return which, and how far that was [m]."""
        travelled = 0.0
        while True:
            nearest = self._checker.nearest(travelled * direction)
            if nearest.distance < _TOUCHING:
                return nearest, travelled
            if travelled >= length:
                return None, length
            travelled = min(travelled + nearest.distance, length)


def _steps(length: float) -> FloatArray:
    return np.arange(0.0, length, FREE_POINT_SPACING)[:, None]  # (K, 1)
