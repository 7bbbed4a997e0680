"""One grasp trial, phase after phase: settle, approach, close, squeeze, lift, shake, hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import SimulationError
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.hands.hand import Hand
from lis_grasp.lifting.lift_outcome import LiftOptions, LiftOutcome, Reason
from lis_grasp.lifting.wrist_trajectory import WristPath, line, rest_at, shake_about
from lis_grasp.motion import OBJECT, Motion
from lis_grasp.simulation.lift_control import FingerControl
from lis_grasp.simulation.lift_scene import LiftScene
from lis_grasp.typing import FloatArray

_GRAVITY = 9.81  # [m/s^2]
# Fingers are commanded at this rate, the wrist in each time step.
_CONTROL_RATE = 100.0  # [Hz]
_SETTLE_TIME = 0.1  # [s]
# What has moved by more than this [m] when it should have settled may be falling: it is given as
# long as a fall takes [s].
_SETTLED, _FALL_TIME = 0.001, 0.5
_CLOSING_LIMIT = 4.0  # [s], longer than any finger needs
_LEAST_FORCE = 0.05  # [N] of a link that counts as touching
_LOST = 0.05  # [m] that an object moves in the hand only when it is lost
# A finger's spring gives its whole effort when its joint is this far off: soft enough to yield to
# an object that is not where the estimate has it, stiff enough to carry it.
_FULL_EFFORT_ANGLE = 0.1  # [rad]
_FULL_EFFORT_DISTANCE = 0.01  # [m]
_DAMPING_TIME = 0.035  # [s], damping by stiffness

# An object that moves less than this in the hand [m] while this time [s] passes has come to rest.
_AT_REST = 5e-5
_REST_TIME = 0.5
_UNEXPECTED_FORCE = 0.5  # [N] at which a hand that feels its way stops
_RETREAT_TIME = 0.4  # [s]

# Time since the phase's start [s] -> whether the phase is over.
_FingerCommand = Callable[[float], bool]

# What the fingers feel when they have closed, before they squeeze -> whether to go on.
AcceptGrasp = Callable[[Contacts], bool]


class LiftTrial:
    """A grasp trial; arguments as `simulate_lift`, which checks them."""

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        hand: Hand,
        grasp: Grasp,
        *,
        support_height: float,
        mass: float,
        friction: float,
        options: LiftOptions,
        accept_grasp: AcceptGrasp | None,
        X_WO: FloatArray | None,
    ) -> None:
        self._options = options
        self._accept_grasp = accept_grasp
        self._support_height = support_height
        stiffness = hand.effort_limits / _full_effort_errors(hand)
        self._scene = LiftScene(
            mesh,
            hand,
            np.asarray(grasp.X_OH, dtype=np.float64),
            support_height=support_height,
            mass=mass,
            friction=friction,
            stiffness=stiffness,
            damping=_DAMPING_TIME * stiffness,
            time_step=options.time_step,
            X_WO=X_WO,
        )
        load = mass * (_GRAVITY + max(options.shake_accelerations, default=0.0))
        self._control = FingerControl(
            self._scene,
            hand,
            grasp,
            friction=friction,
            grip_force=max(options.grip_margin * load / friction, options.least_grip_force),
            search_distance=options.search_distance,
        )
        retreat = -options.standoff * np.asarray(grasp.approach_O, dtype=np.float64)
        self._retreat = np.append(retreat, np.zeros(3))
        self._rise = np.array([0.0, 0.0, options.lift_height, 0.0, 0.0, 0.0])
        self._goal = np.asarray(grasp.X_OH, dtype=np.float64)[:3, 3]
        self._scene.place_hand(retreat, np.asarray(grasp.pregrasp_positions))
        self._closed, self._felt = False, Contacts.empty()
        self._start = self._scene.object_center
        self._center_in_hand: FloatArray | None = None  # once the grasp has closed
        self._lifted = False
        self._survived = 0.0
        self._times: list[float] = []
        self._poses: dict[str, list[FloatArray]] = {}

    def run(self) -> LiftOutcome:
        """Run the phases until one fails, or all are done."""
        self._record()
        try:
            reason = self._run_phases()
        except SimulationError:
            reason = "diverged"
        poses = {name: np.array(X) for name, X in self._poses.items()}
        diverged = reason == "diverged"  # then nothing is where the simulation has it
        return LiftOutcome(
            lifted=self._lifted,
            held=reason == "held",
            slip=0.0 if diverged else self._slip(),
            reason=reason,
            acceleration_survived=self._survived,
            duration=self._scene.time,
            motion=Motion(np.array(self._times), poses),
            closed=self._closed,
            felt=self._felt,
            X_WO=poses[OBJECT][-1] if diverged else self._scene.X_WO,
        )

    def _run_phases(self) -> Reason:
        phases = (self._settle, self._approach, self._close, self._lift, self._shake, self._hold)
        for phase in phases:
            failure = phase()
            if failure is not None:
                return failure
        return "held"

    def _settle(self) -> Reason | None:
        self._advance(_SETTLE_TIME, rest_at(self._retreat))
        if self._moved() > _SETTLED:
            self._advance(_FALL_TIME, rest_at(self._retreat))
        self._scene.rest_object()
        return "unstable" if self._pushed() else None

    def _approach(self) -> Reason | None:
        duration = self._options.approach_time
        way = line(self._retreat, np.zeros(6), duration)
        self._advance(duration, way, self._feel if self._accept_grasp is not None else None)
        if len(self._felt):
            return self._decline()
        self._advance(_SETTLE_TIME, rest_at(np.zeros(6)))
        error = float(np.linalg.norm(self._scene.X_WH[:3, 3] - self._goal))
        blocked = error > self._options.largest_push or self._pushed()
        return "collision_on_approach" if blocked else None

    def _close(self) -> Reason | None:
        here = rest_at(np.zeros(6))
        interval = 1.0 / _CONTROL_RATE
        self._advance(_CLOSING_LIMIT, here, lambda time: self._control.close(time, interval))
        self._closed, self._felt = True, self._control.felt()
        if self._accept_grasp is not None and not self._accept_grasp(self._felt):
            return self._decline()
        if len(self._felt) < 2:
            return "no_contact"
        duration = self._options.squeeze_time

        def squeeze(time: float) -> bool:
            self._control.squeeze(min(time / duration, 1.0))
            return False

        self._advance(duration + _SETTLE_TIME, here, squeeze)
        self._center_in_hand = self._object_in_hand()
        return "ejected" if self._touching_links() < 2 else None

    def _lift(self) -> Reason | None:
        duration = self._options.lift_time
        self._advance(duration, line(np.zeros(6), self._rise, duration), self._hold_on)
        self._lifted = self._in_hand()
        return None if self._lifted else self._failure("not_lifted")

    def _shake(self) -> Reason | None:
        duration = self._options.shake_cycles / self._options.shake_frequency
        for acceleration in self._options.shake_accelerations:
            for direction in np.diag(np.repeat([1.0, 1.0 / self._options.turn_arm], 3)):
                path = shake_about(
                    self._rise,
                    direction,
                    acceleration=acceleration,
                    frequency=self._options.shake_frequency,
                    cycles=self._options.shake_cycles,
                )
                self._advance(duration, path, self._hold_on)
                if not self._in_hand():
                    return self._failure("dropped")
            self._survived = acceleration
        return None

    def _hold(self) -> Reason | None:
        checked, before = 0.0, self._object_in_hand()

        def hold_until_rest(time: float) -> bool:
            nonlocal checked, before
            if time - checked >= _REST_TIME:
                moved = np.linalg.norm(self._object_in_hand() - before)
                checked, before = time, self._object_in_hand()
                if moved < _AT_REST:
                    return True
            return self._hold_on(time)

        self._advance(self._options.hold_time, rest_at(self._rise), hold_until_rest)
        return None if self._in_hand() else self._failure("dropped")

    def _feel(self, time: float) -> bool:
        """Stop, and remember where, if the hand touches the object on its way."""
        touches = [t for t in self._scene.touches() if t.strength >= _UNEXPECTED_FORCE]
        if touches:
            self._felt = Contacts(
                np.array([touch.point for touch in touches]),
                np.array([touch.normal for touch in touches]),
                fingers=tuple(touch.link for touch in touches),
            )
        return bool(touches)

    def _decline(self) -> Reason:
        """Let go, and go back the way that the hand came."""
        self._control.open()
        here = np.append(self._scene.X_WH[:3, 3] - self._goal, np.zeros(3))
        self._advance(_RETREAT_TIME, rest_at(here))
        self._advance(_RETREAT_TIME, line(here, self._retreat, _RETREAT_TIME))
        return "aborted"

    def _hold_on(self, time: float) -> bool:
        self._control.hold()
        return self._slip() > _LOST

    def _advance(
        self, duration: float, path: WristPath, fingers: _FingerCommand | None = None
    ) -> None:
        """Step until `duration` [s] has passed or `fingers` says that the phase is over."""
        step = self._options.time_step
        command_every = max(1, round(1.0 / (_CONTROL_RATE * step)))
        record_every = max(1, round(1.0 / (self._options.frame_rate * step)))
        for count in range(round(duration / step)):
            if fingers is not None and count % command_every == 0 and fingers(count * step):
                break
            self._scene.command_wrist(*path((count + 1) * step))
            self._scene.step()
            if self._scene.steps % record_every == 0:
                self._record()

    def _record(self) -> None:
        self._times.append(self._scene.time)
        for name, X in self._scene.poses().items():
            self._poses.setdefault(name, []).append(X)

    def _moved(self) -> float:
        """Return how far the object's centre of mass is from where it was placed [m]."""
        return float(np.linalg.norm(self._scene.object_center - self._start))

    def _pushed(self) -> bool:
        return self._moved() > self._options.largest_push

    def _object_in_hand(self) -> FloatArray:
        """Return the object's centre of mass in the palm frame, shape (3,) [m]."""
        X_WH = self._scene.X_WH
        center: FloatArray = X_WH[:3, :3].T @ (self._scene.object_center - X_WH[:3, 3])
        return center

    def _slip(self) -> float:
        if self._center_in_hand is None:
            return 0.0
        return float(np.linalg.norm(self._object_in_hand() - self._center_in_hand))

    def _touching_links(self) -> int:
        touches = self._scene.touches()
        return len({t.link for t in touches if t.strength >= _LEAST_FORCE})

    def _carried(self) -> bool:
        """Tell whether the object is off the table, and the hand touches it."""
        clearance = self._scene.object_bottom - self._support_height
        return clearance >= 0.5 * self._options.lift_height and self._touching_links() >= 2

    def _in_hand(self) -> bool:
        return self._carried() and self._slip() < self._options.largest_slip

    def _failure(self, lost: Reason) -> Reason:
        """Name the failure of a grasp that is not in hand as it should be."""
        return "slipped" if self._carried() else lost


def _full_effort_errors(hand: Hand) -> FloatArray:
    turning = {joint.index: joint.kind == "revolute" for joint in hand.joints if joint.is_actuated}
    return np.array(
        [
            _FULL_EFFORT_ANGLE if turning[i] else _FULL_EFFORT_DISTANCE
            for i in range(len(hand.joint_names))
        ]
    )
