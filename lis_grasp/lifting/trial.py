"""One simulated lift: the phases after the grasp has closed, a lost object, the outcome."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

from lis_grasp.arms.use import ArmStoppedError
from lis_grasp.exceptions import SimulationError
from lis_grasp.lifting.closing import SETTLE_TIME, SETTLED, AcceptGrasp, Closing
from lis_grasp.lifting.object_in_hand import SlipWatch
from lis_grasp.lifting.outcome import LOST_GRASPS, LiftOutcome, Reason
from lis_grasp.lifting.place_plan import PlaceOutcome
from lis_grasp.lifting.placing import Placing
from lis_grasp.lifting.pose_in_hand import PoseInHand
from lis_grasp.lifting.scene import CONTROL_RATE, BodyHitError, LiftingScene
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.wrist_path import WristPath, line, rest_at, shake_about
from lis_grasp.motion import OBJECT
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.typing import FloatArray

_LOG = logging.getLogger(__name__)

# Times of settling in which an object that the hand let go comes to rest.
_FALLS = 20
_LOST = 0.05  # [m] of slip that only a lost object has
# Rise [m] until which slip over the pads raises the grip force by the factor. An object that slips
# more until then is set down [m].
_WATCHED_RISE = 0.01
_GRIP_FACTOR = 1.5
# Commands over which a weight is averaged, and the least mass that is weighed [kg].
_WEIGHED_STEPS, _LEAST_MASS = 9, 0.005
# Least margin of the grip, below which an object is set down that is heavier than assumed by the
# factor.
_LEAST_MARGIN, _HEAVIER = 0.55, 1.25
_SLIP_LIMIT = 0.006

# An object that moves less than this in the hand [m] in this time [s] rests.
_AT_REST = 5e-5
_REST_TIME = 0.5
_RETREAT_TIME = 0.4  # [s]
_DIRECTIONS = ("x", "y", "z", "roll", "pitch", "yaw")


class LiftTrial:
    """One simulated lift in a scene of any simulator; see `simulate_lift`."""

    def __init__(
        self, scene: LiftingScene, setup: LiftSetup, accept_grasp: AcceptGrasp | None
    ) -> None:
        self._scene, self._setup, self._options = scene, setup, setup.options
        self._accept_grasp = accept_grasp
        self._closing = Closing(scene, setup, accept_grasp)
        self._control, self._steps = self._closing.control, self._closing.steps
        self._object, self._retreat = self._closing.object, self._closing.retreat
        self._felt = self._closing.felt
        self._rise = np.array([0.0, 0.0, self._options.lift_height, 0.0, 0.0, 0.0])
        self._lost_after: tuple[float, float] | None = None  # slip [m] and turn [rad]
        self._lifted = False
        self._weighed: float | None = None  # [kg]
        self._margin: float | None = None  # of the grip
        self._survived = 0.0
        self._place: PlaceOutcome | None = None
        self._pose: PoseInHand | None = None
        self._pose_error: tuple[float, float] | None = None
        self._seconds: dict[str, float] = {}  # by phase

    def run(self) -> LiftOutcome:
        """Run the phases until one fails or all are done."""
        try:
            reason = self._run_phases()
            if reason == "held":
                with self._timed("put_down"):
                    self._put_down()
        except ArmStoppedError as stopped:
            reason = stopped.reason
        except SimulationError:
            reason = "diverged"
        motion = self._steps.motion()
        diverged = reason == "diverged"  # then the simulation's state means nothing
        slip, turn = (0.0, 0.0) if diverged else self._lost_after or self._object.slip_and_turn()
        return LiftOutcome(
            lifted=self._lifted,
            held=reason == "held",
            slip=slip,
            turn=turn,
            reason=reason,
            acceleration_survived=self._survived,
            duration=self._scene.time,
            motion=motion,
            closed=self._closing.closed,
            measured_contacts=self._closing.measured,
            X_WO=motion.poses[OBJECT][-1] if diverged else self._scene.X_WO,
            weighed=self._weighed,
            grip_margin=self._margin,
            arm=self._scene.carrier.use,
            forces=dict(self._steps.forces_beside),
            X_EB={} if diverged else dict(self._scene.poses_beside()),
            place=self._place,
            pose_in_hand=self._pose,
            pose_error=self._pose_error,
            seconds=dict(self._seconds),
        )

    def _run_phases(self) -> Reason:
        before = self._closing
        for phase in (
            *(before.settle, before.approach, before.close),
            *(self._lift, self._shake, self._hold),
        ):
            name = phase.__name__.strip("_")
            _LOG.info("%s", name)
            failure: Reason | None
            try:
                with self._timed(name):
                    failure = phase()
            except BodyHitError:
                failure = "hit_body"
            if failure is not None:
                if self._accept_grasp is not None and failure in LOST_GRASPS:
                    with self._timed("let_go"):
                        return self._let_go(failure)
                return failure
        return "held"

    @contextmanager
    def _timed(self, phase: str) -> Iterator[None]:
        """Add the simulated time of a phase [s], however it ends."""
        begin = self._scene.time
        try:
            yield
        finally:
            self._seconds[phase] = self._scene.time - begin

    def _lift(self) -> Reason | None:
        self._felt.is_lifted, duration = True, self._options.lift_time
        watch, given_up = SlipWatch(self._scene, self._control), False
        felt: list[tuple[float, float]] = []  # vertical force [N] and rise [m] of the hand

        def hold(time: float) -> bool:
            nonlocal given_up
            rise = self._risen()
            felt.append((sum(contact.force[2] for contact in self._scene.contacts()), rise))
            if self._weighed is None:
                given_up = self._accept_grasp is not None and watch.total > _SLIP_LIMIT
                if rise >= _WATCHED_RISE:
                    given_up |= self._weigh(felt) and self._accept_grasp is not None
                elif watch.has_slipped():
                    self._control.grip_harder(_GRIP_FACTOR)
            # Before another attempt, an object that is lost already is not lifted higher.
            lost = self._accept_grasp is not None and self._object.has_moved()
            return self._hold_grip(time) or given_up or lost

        self._steps.advance(
            duration, line(self._closing.here, self._closing.here + self._rise, duration), hold
        )
        if given_up:
            return "set_down"
        loss = self._loss("not_lifted")
        self._lifted = loss is None
        if self._lifted:
            self._weigh(felt)
            self._locate()
        return loss

    def _locate(self) -> None:
        """Find the pose of the object in the palm by touch."""
        self._pose = self._felt.pose()
        self._pose_error = None if self._pose is None else self._felt.errors(self._pose)

    def _weigh(self, felt: list[tuple[float, float]]) -> bool:
        """Weigh the object by the vertical force on the rising hand, and carry it.

        Returns whether it is heavier than assumed, and the grip too small for it.
        """
        forces, rises = np.array(felt[-_WEIGHED_STEPS:]).T
        times = np.arange(len(rises)) / CONTROL_RATE
        acceleration = 2.0 * np.polyfit(times, rises, 2)[0] if len(rises) > 2 else 0.0
        mass = float(forces.mean()) / max(GRAVITY + acceleration, 0.5 * GRAVITY)
        self._weighed = max(mass, _LEAST_MASS)
        self._control.carry(self._weighed)
        self._margin = self._control.exerted / self._setup.needed_force(self._weighed)
        assumed = self._options.assumed_mass or self._setup.mass
        return self._margin < _LEAST_MARGIN and self._weighed > _HEAVIER * assumed

    def _shake(self) -> Reason | None:
        options = self._options
        for acceleration in options.shake_accelerations:
            for name, direction in zip(_DIRECTIONS, options.shake_directions, strict=True):
                path_at = partial(self._shake_path, direction)
                motion = self._scene.carrier.shake(path_at, acceleration, options.shake_time, name)
                self._steps.move(motion, self._hold_grip)
                if loss := self._loss("dropped"):
                    return loss
            self._survived = acceleration
        return None

    def _shake_path(self, direction: FloatArray, acceleration: float) -> WristPath:
        options = self._options
        return shake_about(
            self._closing.here + self._rise,
            direction,
            acceleration,
            frequency=options.shake_frequency,
            cycles=options.shake_cycles,
        )

    def _hold(self) -> Reason | None:
        checked, before = 0.0, self._object.place()

        def hold_until_rest(time: float) -> bool:
            nonlocal checked, before
            if time - checked >= _REST_TIME:
                moved = np.linalg.norm(self._object.place() - before)
                checked, before = time, self._object.place()
                if moved < _AT_REST:
                    return True
            return self._hold_grip(time)

        raised = rest_at(self._closing.here + self._rise)
        self._steps.advance(self._options.hold_time, raised, hold_until_rest)
        loss = self._loss("dropped")
        if loss is None:
            self._locate()
        return loss

    def _put_down(self) -> None:
        """Place the held object as planned, if it is: slip and turn are those of the lift."""
        if self._setup.place is None:
            return
        self._lost_after = self._object.slip_and_turn()
        placing = Placing(
            self._scene,
            self._setup,
            self._setup.place,
            steps=self._steps,
            control=self._control,
            held=self._object,
            pose=self._pose,
        )
        try:
            self._place = placing.run(self._closing.here, self._rise, self._retreat)
        except ArmStoppedError as stopped:
            hit = stopped.reason == "arm_collision"
            self._place = PlaceOutcome("collided" if hit else "not_reached", self._setup.place)
        except SimulationError:
            self._place = PlaceOutcome("diverged", self._setup.place)

    def _loss(self, lost: Reason) -> Reason | None:
        loss = self._object.loss(self._risen(), lost)
        return None if loss is None else self._control.reason_of(loss)

    def _risen(self) -> float:
        """Return how far the hand has risen since it closed [m]."""
        return float(self._steps.displacement[2] - self._closing.here[2])

    def _let_go(self, failure: Reason) -> Reason:
        """Let go of what is still in the hand, after a failure, and wait until the object rests.

        Returns the failure, or `hit_body` where the hand had to stop at a body beside the object.
        """
        self._lost_after = self._object.slip_and_turn()
        try:
            self._retreat_without_object()
            self._come_to_rest(self._retreat)
        except BodyHitError:  # once in a lift
            failure = "hit_body"
            self._come_to_rest(self._steps.displacement)
        return failure

    def _come_to_rest(self, here: FloatArray) -> None:
        """Wait `here` (6,) until the object rests; an arm goes home."""
        before = self._scene.X_WO
        for _ in range(_FALLS):
            self._steps.advance(SETTLE_TIME, rest_at(here))
            moved = float(np.abs(self._scene.X_WO - before).max())
            if moved < _AT_REST:
                break
            before = self._scene.X_WO
        homeward = self._scene.carrier.go_home()
        if homeward is not None:
            self._steps.move(homeward)

    def _retreat_without_object(self) -> None:
        """Lower what is still in the hand, open it, and retreat."""
        here = self._steps.displacement

        def lower(time: float) -> bool:
            self._control.hold()
            return self._object.clearance() < SETTLED  # the wrist feels the table

        if self._object.held is not None and self._object.is_touched():
            self._steps.advance(_RETREAT_TIME, line(here, self._closing.here, _RETREAT_TIME), lower)
            here = self._steps.displacement

        def open_hand(time: float) -> bool:
            self._control.open(time / _RETREAT_TIME)
            return False

        if self._closing.closed:
            self._control.release()
            self._steps.advance(_RETREAT_TIME + SETTLE_TIME, rest_at(here), open_hand)
        if self._object.held is not None:  # along the approach, at the height of the hand
            self._steps.advance(_RETREAT_TIME, line(here, here + self._retreat, _RETREAT_TIME))
            here = here + self._retreat
        self._steps.advance(_RETREAT_TIME, line(here, self._retreat, _RETREAT_TIME))

    def _hold_grip(self, time: float) -> bool:
        self._control.hold()
        return self._object.slip() > _LOST
