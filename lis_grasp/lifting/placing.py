"""Placing of a held object: carried above the place, lowered until contact is felt, let go."""

from __future__ import annotations

import logging
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import inverse_pose
from lis_grasp.lifting.closing import SETTLE_TIME
from lis_grasp.lifting.grip import Grip
from lis_grasp.lifting.object_in_hand import ObjectInHand
from lis_grasp.lifting.place_plan import (
    PlaceOutcome,
    PlacePlan,
    PlaceReason,
    errors_of_place,
    reason_of_place,
)
from lis_grasp.lifting.pose_in_hand import PoseInHand
from lis_grasp.lifting.scene import BodyHitError, LiftingScene, Steps
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.wrist_path import WristPath, displaced, line, rest_at
from lis_grasp.typing import FloatArray

_LOG = logging.getLogger(__name__)

# Largest speeds of the wrist that carries [m/s, rad/s], and of one that feels for the table [m/s].
_SPEED, _TURN_SPEED, _FEELING_SPEED = 0.2, 1.0, 0.02
# Height above the band of the expected contact at which it begins to feel [m].
_FEELING_HEIGHT = 0.005
# Contact is felt when the table carries this fraction of what the hand felt before, averaged over a
# number of commands at the beginning, and now.
_CARRIED, _FELT_BEFORE, _FELT_NOW = 0.5, 10, 3
_FELT_FORCE = 0.5  # [N] of the hand itself on the table, at which it stops, too
_LET_GO_TIME, _RETREAT_TIME = 0.5, 0.5  # [s]
# Times of settling in which a released object comes to rest, and motion in one that is rest [m].
_WAITS, _AT_REST = 20, 5e-5


class Placing:
    """The phases of placing, from the place `here` (6,) of the palm in the grasp, raised by `rise`.

    `X_WO` (4, 4) is the true pose before the lift: the plan moves the object from there. The object
    is believed to be in the hand at the `pose` that it felt, or as it was when the fingers closed.
    """

    def __init__(
        self,
        scene: LiftingScene,
        setup: LiftSetup,
        plan: PlacePlan,
        *,
        steps: Steps,
        control: Grip,
        held: ObjectInHand,
        pose: PoseInHand | None,
    ) -> None:
        self._scene, self._setup, self._plan = scene, setup, plan
        self._steps, self._control, self._object, self._pose = steps, control, held, pose
        self._felt: float | None = None

    def run(self, here: FloatArray, rise: FloatArray, retreat: FloatArray) -> PlaceOutcome:
        """Carry, lower, let go and retreat by `retreat` (6,); return what became of the object."""
        try:
            reason = self._place(here, rise, retreat)
        except BodyHitError:
            reason = "collided"
        return self._judged(reason)

    def _place(self, here: FloatArray, rise: FloatArray, retreat: FloatArray) -> PlaceReason | None:
        """Run the phases; return why they failed, None if the object has been let go."""
        goal = placed_wrist(self._setup.X_WB, self._held_at(here), self._plan.motion)
        carry = _up(self._plan.carry)
        _LOG.info("carry")
        way = [here + rise, here + carry, goal + carry, self._above(goal)]
        for start, end in pairwise(way):
            self._move(start, end)
        if not self._object.is_touched():
            return "lost"
        arrived = displaced(self._setup.X_WB, way[-1])[:3, 3]
        X_WB = self._scene.X_WL(self._setup.hand.base_link)
        if np.linalg.norm(X_WB[:3, 3] - arrived) > self._setup.options.largest_push:
            return "not_reached"
        _LOG.info("lower")
        here = self._lower(goal)
        _LOG.info("let go")
        self._release(here, retreat, goal)
        return "not_released" if self._object.touching_links() else None

    def _held_at(self, here: FloatArray) -> FloatArray:
        """Return the pose (4, 4) of the hand's base link in the object as it is held."""
        if self._pose is None:
            return displaced(self._setup.X_WB, here)
        return inverse_pose(self._setup.hand.X_LH @ self._pose.X_HO)

    def _move(self, start: FloatArray, end: FloatArray) -> None:
        """Carry the object along a straight line of displacements (6,)."""
        way = end - start
        duration = max(
            float(np.linalg.norm(way[:3])) / _SPEED, float(np.abs(way[3:]).max()) / _TURN_SPEED
        )
        if duration > 0.0:
            # A minimum-jerk line is at most 15/8 times as fast as its mean.
            duration *= 15.0 / 8.0
            self._steps.advance(duration, line(start, end, duration), self._hold)

    def _lower(self, goal: FloatArray) -> FloatArray:
        """Lower the object until the table carries a part of it; return the place of the palm."""
        begin, end = self._above(goal), goal - _up(self._plan.band)
        path, duration = _at_speed(begin, end, _FEELING_SPEED)
        forces: list[float] = []
        stopped = duration

        def feel(time: float) -> bool:
            nonlocal stopped
            self._control.hold()
            forces.append(sum(contact.force[2] for contact in self._scene.contacts()))
            before, now = np.mean(forces[:_FELT_BEFORE]), np.mean(forces[-_FELT_NOW:])
            stands = len(forces) > _FELT_BEFORE and now < (1.0 - _CARRIED) * before
            on_table = -sum(contact.force[2] for contact in self._scene.contacts("table"))
            if not stands and on_table < _FELT_FORCE:
                return False
            stopped = time
            self._felt = float(path(time)[0][2] - goal[2])
            return True

        self._steps.advance(duration, path, feel)
        here = path(stopped)[0]
        self._steps.advance(SETTLE_TIME, rest_at(here), self._hold)
        return here

    def _above(self, goal: FloatArray) -> FloatArray:
        """Return where the hand begins to feel for the table."""
        return goal + _up(_FEELING_HEIGHT + self._plan.band)

    def _release(self, here: FloatArray, retreat: FloatArray, goal: FloatArray) -> None:
        """Open the hand, retreat, and wait until the object rests."""

        def open_hand(time: float) -> bool:
            self._control.open(time / _LET_GO_TIME)
            return False

        self._control.release()
        self._steps.advance(_LET_GO_TIME + SETTLE_TIME, rest_at(here), open_hand)
        back = np.append(self._plan.motion[:3, :3] @ retreat[:3], np.zeros(3))
        self._steps.advance(_RETREAT_TIME, line(here, here + back, _RETREAT_TIME))
        before = self._scene.X_WO
        for _ in range(_WAITS):
            self._steps.advance(SETTLE_TIME, rest_at(here + back))
            if float(np.abs(self._scene.X_WO - before).max()) < _AT_REST:
                break
            before = self._scene.X_WO

    def _hold(self, time: float) -> bool:
        self._control.hold()
        return False

    def _judged(self, reason: PlaceReason | None) -> PlaceOutcome:
        mesh = self._setup.mesh
        planned = self._plan.motion @ self._setup.X_WO
        errors = errors_of_place(self._scene.X_WO, planned, np.asarray(mesh.center_mass))
        return PlaceOutcome(reason or reason_of_place(*errors), self._plan, *errors, self._felt)


def placed_wrist(X_WB: FloatArray, X_OB: FloatArray, motion: FloatArray) -> FloatArray:
    """Return the displacement (6,) of the wrist that a motion (4, 4) of the object takes it to.

    X_WB (4, 4) is the hand's base link in the planned grasp, X_OB (4, 4) in the held object.
    """
    end = motion @ X_OB
    turn = Rotation.from_matrix(end[:3, :3] @ X_WB[:3, :3].T).as_euler("xyz")
    return np.concatenate([end[:3, 3] - X_WB[:3, 3], turn])


def _up(height: float) -> FloatArray:
    return np.array([0.0, 0.0, height, 0.0, 0.0, 0.0])


def _at_speed(start: FloatArray, end: FloatArray, speed: float) -> tuple[WristPath, float]:
    """Return a straight path at a constant speed [m/s], and its duration [s]."""
    duration = float(np.linalg.norm(end[:3] - start[:3])) / speed
    rate = (end - start) / duration

    def path(time: float) -> tuple[FloatArray, FloatArray]:
        part = min(time, duration)
        return start + part * rate, rate * (time < duration)

    return path, duration
