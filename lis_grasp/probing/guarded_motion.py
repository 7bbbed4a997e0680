"""A probe's motion through the true scene: in from outside, along, and to the first contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.exploration.motion_time import PROBE_SPEED, TRANSIT_SPEED
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.hands.collision import HandCollisionChecker, NearestLink
from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_parts import ProbePosture
from lis_grasp.hands.pose_filter import balls_inside
from lis_grasp.probing.approach import NO_FREE_START, NO_FREE_WAY, Approach, ApproachPlanner
from lis_grasp.shapes.winding_number import any_inside
from lis_grasp.typing import FloatArray

FREE_POINT_SPACING = 0.01
"""Distance between places that the hand is recorded to have passed [m]."""

TOUCHING = 2e-5
"""Nearer than this counts as touching [m]."""

AT_TABLE = "the table ended the motion"


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
    arrived
        Whether the way in was gone to its end: the last leg is the probe's own motion.
    came
        What was gone on the way in [m], the last leg included.
    travelled
        What was gone on the last leg [m].
    left
        What was left of it [m].
    met
        The link that touches the object, and where; None where nothing was met.
    at_table
        Whether the table ended the motion before the probe's target.
    """

    approach: Approach
    X_OH: FloatArray
    direction: FloatArray
    arrived: bool
    came: float
    travelled: float
    left: float
    met: NearestLink | None
    at_table: bool = False

    @property
    def X_OH_end(self) -> FloatArray:
        """Pose (4, 4) of the palm where the motion ended."""
        X_OH = self.X_OH.copy()
        X_OH[:3, 3] += self.travelled * self.direction
        return X_OH

    @property
    def _along(self) -> float:
        """How far the hand went along the probe's own motion [m]."""
        return self.travelled if self.arrived else 0.0

    @property
    def until_contact(self) -> float:
        """Time of the motion to where it ended [s]."""
        return self.came / TRANSIT_SPEED + self._along / PROBE_SPEED

    @property
    def duration(self) -> float:
        """Time of the motion, there and back the same way [s]."""
        return self.until_contact + (self.came + self._along) / TRANSIT_SPEED

    def poses(self, probe: Probe) -> FloatArray:
        """Return poses of the palm on the way, shape (K, 4, 4), the end of each leg among them."""
        places = self.approach.X_OH_outside[:3, 3] + _steps(self.came) * self.approach.axis
        if self.arrived:  # where the way in ends, the probe's own motion begins
            along = self.approach.X_OH[:3, 3] + _steps(self._along) * probe.direction
            places = np.vstack([places[:-1], along])
        poses = np.tile(self.approach.X_OH, (len(places), 1, 1))
        poses[:, :3, 3] = places
        return poses


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
        self._balls = {
            name: _balls_in_hand(hand, posture) for name, posture in hand.probe_postures.items()
        }

    def nothing_felt(self, course: Course, probe: Probe, known: KnownShape | None) -> ProbeOutcome:
        """Return what came of a course if nothing was felt: the space that was found free."""
        free_points, free_radii = self._free_space(course, probe, known)
        return ProbeOutcome(
            probe,
            "blocked" if course.at_table else "missed",
            free_points=free_points,
            duration=course.duration,
            reason=AT_TABLE if course.at_table else "",
            free_radii=free_radii,
        )

    def _free_space(
        self, course: Course, probe: Probe, known: KnownShape | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return balls that a course has found free: centres (K, 3) in O, and radii (K,) [m].

        The leading sphere's come first, all the way. Then those inside all links, as far as they
        reach where the object can be.
        """
        balls = self._balls[course.approach.posture.finger]
        X_OH = course.poses(probe)
        centers = (balls[:, :3] @ X_OH[:, :3, :3].transpose(0, 2, 1)) + X_OH[:, None, :3, 3]
        tip, others = centers[:, 0], centers[:, 1:].reshape(-1, 3)
        radii = np.tile(balls[1:, 3], len(X_OH))
        if known is not None:
            apart = np.linalg.norm(others - known.space.center, axis=1)
            reaching = apart < known.space.radius + radii
            others, radii = others[reaching], radii[reaching]
        return (
            np.vstack([tip, others]),
            np.concatenate([np.full(len(tip), balls[0, 3]), radii]),
        )

    def run(self, probe: Probe, known: KnownShape | None) -> Course | str:
        """Carry a probe out up to the first contact, or say why it cannot be.

        With `known`, the hand comes in from outside of the object's ball, past what is known, and
        may meet what is not; it goes no deeper than the table. Without, it starts wherever no link
        touches the true object.
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
                    return Course(approach, outside, approach.axis, False, came, came, left, met)
        self._place(approach, approach.X_OH)
        wanted = probe.standoff + probe.overshoot
        length = min(wanted, self._above_table(approach, probe, known))
        met, gone = self._advance(probe.direction, length)
        return Course(
            approach=approach,
            X_OH=approach.X_OH,
            direction=probe.direction,
            arrived=True,
            came=approach.run_in,
            travelled=gone,
            left=length - gone,
            met=met,
            at_table=met is None and length < probe.standoff,
        )

    def _above_table(self, approach: Approach, probe: Probe, known: KnownShape | None) -> float:
        """Return how far the hand can go before it would enter the table [m]."""
        height = None if known is None else known.space.support_height
        if height is None or probe.direction[2] >= 0.0:
            return np.inf
        lowest = self._checker.lowest(approach.X_OH @ self._poses[approach.posture.finger])
        return max(lowest - height, 0.0) / -float(probe.direction[2])

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
            if nearest.distance < TOUCHING:
                return nearest, travelled
            if travelled >= length:
                return None, length
            travelled = min(travelled + nearest.distance, length)


def _balls_in_hand(hand: Hand, posture: ProbePosture) -> FloatArray:
    """Return balls inside the links, centres in H and radii [m], shape (S, 4); the leader first."""
    links = hand.forward_kinematics(np.eye(4), posture.joint_positions)
    leader = links[posture.link][:3, :3] @ posture.center_L + links[posture.link][:3, 3]
    balls = [np.append(leader, posture.radius)[None]]
    for geometry in hand.link_geometries:
        centers, radii = balls_inside(geometry)
        X_HG = links[geometry.link] @ geometry.X_LG
        inside = np.column_stack([centers @ X_HG[:3, :3].T + X_HG[:3, 3], radii])
        balls.append(inside[np.linalg.norm(inside - balls[0], axis=1) > TOUCHING])
    return np.concatenate(balls)


def _steps(length: float) -> FloatArray:
    """Return places on a way, its end among them, shape (K, 1) [m]."""
    return np.append(np.arange(0.0, length, FREE_POINT_SPACING), length)[:, None]
