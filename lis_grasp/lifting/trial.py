"""Phases of a simulated lift: settle, approach, close, squeeze, lift, shake, hold."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import SimulationError
from lis_grasp.geometry import apply_inverse, apply_pose
from lis_grasp.lifting.finger_control import SEARCH_SPEED, FingerControl, SlipWatch
from lis_grasp.lifting.outcome import LOST_GRASPS, LiftOutcome, Reason
from lis_grasp.lifting.scene import ArmStoppedError, CarrierMotion, LiftingScene
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.wrist_path import WristPath, line, rest_at, shake_about
from lis_grasp.motion import OBJECT, Motion
from lis_grasp.robots.hand import SEATING
from lis_grasp.robots.pose_filter import balls_inside
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.typing import FloatArray

_LOG = logging.getLogger(__name__)

# Fingers are commanded at this rate, the wrist in each time step.
_CONTROL_RATE = 100.0  # [Hz]
_SETTLE_TIME = 0.1  # [s]
# An object that settles by more than this [m] may be falling: it gets the time of a fall [s].
_SETTLED = 0.001
_FALL_TIME = 0.5
# Times of settling in which an object that the hand let go comes to rest.
_FALLS = 20
_CLOSING_LIMIT = 4.0  # [s], longer than any finger needs
_LEAST_FORCE = 0.05  # [N] of a link that counts as touching
_LOST = 0.05  # [m] of slip that only a lost object has
# Rise [m] until which slip over the pads raises the grip force by the factor. An object that slips
# more until then is set down [m].
_WATCHED_RISE = 0.01
_GRIP_FACTOR = 1.5
# Margin of the grip below which an object is set down that is so many times as heavy as assumed.
_LEAST_MARGIN, _HEAVIER = 0.55, 1.25
# Commands over which a weight is averaged, and the least mass that is weighed [kg].
_WEIGHED_STEPS, _LEAST_MASS = 9, 0.005
_SLIP_LIMIT = 0.006

# An object that moves less than this in the hand [m] in this time [s] rests.
_AT_REST = 5e-5
_REST_TIME = 0.5
_UNEXPECTED_FORCE = 0.5  # [N] at which an approach with a tactile check stops
# A guarded descent begins before the planned place [m], and ends as far behind it after a time [s],
# or when the table pushes the hand with a force [N]. When fingers that close along the table push
# it with more [N], the palm yields at a speed [m/s], at most as far, and returns when they do not.
_GUARDED, _GUARDED_TIME = 0.001, 0.5
_FELT_FORCE, _LARGEST_FORCE, _YIELD_SPEED = 0.3, 2.0, 0.02
_RETREAT_TIME = 0.4  # [s]
# A tactile check decides after a push with this fraction of the grip force for this time [s].
_PRESS_FRACTION = 0.2
_PRESS_TIME = 0.2
_DIRECTIONS = ("x", "y", "z", "roll", "pitch", "yaw")

# Time since the phase's start [s] -> whether the phase is over.
_FingerCommand = Callable[[float], bool]

# Contacts of the closed fingers, before they squeeze -> whether to continue.
AcceptGrasp = Callable[[Contacts], bool]


class LiftTrial:
    """One simulated lift in a scene of any simulator; see `simulate_lift`."""

    def __init__(
        self,
        scene: LiftingScene,
        setup: LiftSetup,
        accept_grasp: AcceptGrasp | None,
        control: FingerControl | None = None,
    ) -> None:
        self._setup, self._options = setup, setup.options
        self._accept_grasp = accept_grasp
        self._scene = scene
        self._control = control or FingerControl(scene, setup)
        grasp = setup.grasp
        retreat = -self._options.standoff * np.asarray(grasp.approach_O, dtype=np.float64)
        self._retreat = np.append(retreat, np.zeros(3))
        self._rise = np.array([0.0, 0.0, self._options.lift_height, 0.0, 0.0, 0.0])
        self._goal = np.asarray(grasp.X_OH, dtype=np.float64)[:3, 3]
        # Displacements of the palm: where the approach ends, and where the hand closes.
        self._arrival = np.zeros(6)
        if setup.hand.fixed_fingers:
            self._arrival = self._retreat * min(SEATING / self._options.standoff, 1.0)
        self._here = np.zeros(6)
        self._slides = setup.slides_on_table
        self._scene.place_hand(self._retreat, np.asarray(grasp.pregrasp_positions))
        self._closed, self._measured = False, Contacts.empty()
        self._hull = np.asarray(setup.mesh.convex_hull.vertices)  # the lowest one is a hull vertex
        self._p_OC = np.asarray(setup.mesh.center_mass)
        self._start = self._center()
        # Object's centre of mass (3,) and rotation (3, 3) in the palm, once the grasp has closed.
        self._grasped: tuple[FloatArray, FloatArray] | None = None
        self._lost_after: tuple[float, float] | None = None  # slip [m] and turn [rad]
        self._lifted = False
        self._weighed: float | None = None  # [kg]
        self._margin: float | None = None  # of the grip
        self._survived = 0.0
        self._times: list[float] = []
        self._poses: dict[str, list[FloatArray]] = {}

    def run(self) -> LiftOutcome:
        """Run the phases until one fails or all are done."""
        self._record()
        try:
            reason = self._run_phases()
        except ArmStoppedError as stopped:
            reason = stopped.reason
        except SimulationError:
            reason = "diverged"
        poses = {name: np.array(X) for name, X in self._poses.items()}
        diverged = reason == "diverged"  # then the simulation's state means nothing
        slip, turn = (0.0, 0.0) if diverged else self._lost_after or (self._slip(), self._turn())
        return LiftOutcome(
            lifted=self._lifted,
            held=reason == "held",
            slip=slip,
            turn=turn,
            reason=reason,
            acceleration_survived=self._survived,
            duration=self._scene.time,
            motion=Motion(np.array(self._times), poses),
            closed=self._closed,
            measured_contacts=self._measured,
            X_WO=poses[OBJECT][-1] if diverged else self._scene.X_WO,
            weighed=self._weighed,
            grip_margin=self._margin,
            arm=self._scene.carrier.use,
        )

    def _run_phases(self) -> Reason:
        phases = (self._settle, self._approach, self._close, self._lift, self._shake, self._hold)
        for phase in phases:
            _LOG.info("%s", phase.__name__.strip("_"))
            failure = phase()
            if failure is not None:
                if self._accept_grasp is not None and failure in LOST_GRASPS:
                    self._let_go()
                return failure
        return "held"

    def _settle(self) -> Reason | None:
        carrier = self._scene.carrier
        self._move(carrier.wait(self._retreat, _SETTLE_TIME))
        if self._moved() > _SETTLED:
            self._move(carrier.wait(self._retreat, _FALL_TIME))
        self._scene.rest_object()
        return "unstable" if self._pushed() else None

    def _approach(self) -> Reason | None:
        transit = self._scene.carrier.bring()
        if transit is not None:
            self._move(transit)
        duration, end = self._options.approach_time, self._arrival
        if self._slides:
            end = _GUARDED / self._options.standoff * self._retreat
        stop = self._stop_at_contact if self._accept_grasp is not None else None
        self._advance(duration, line(self._retreat, end, duration), stop)
        self._here = self._arrival.copy()
        if self._slides and not len(self._measured):
            self._descend(end, stop)
        if len(self._measured):
            return "aborted"
        self._advance(_SETTLE_TIME, rest_at(self._here))
        error = float(np.linalg.norm(self._displacement() - self._arrival))
        blocked = error > self._options.largest_push or self._pushed()
        return "collision_on_approach" if blocked else None

    def _descend(self, above: FloatArray, stop: _FingerCommand | None) -> None:
        """Go on along the approach until fingertips feel the table, and close there."""

        def felt(time: float) -> bool:
            return self._force_on_table() > _FELT_FORCE or (stop is not None and stop(time))

        self._advance(_GUARDED_TIME, line(above, -above, _GUARDED_TIME), felt)
        self._here = self._displacement()

    def _force_on_table(self) -> float:
        """Return the force with which the hand pushes the table down [N]."""
        return -float(sum(contact.force[2] for contact in self._scene.contacts("table")))

    def _close(self) -> Reason | None:
        self._scene.carrier.expect_contact()
        if self._setup.hand.fixed_fingers:
            self._seat()
        interval, floor = 1.0 / _CONTROL_RATE, self._here[2]

        def close(time: float) -> bool:
            if self._slides:
                force, way = self._force_on_table(), _YIELD_SPEED * interval
                rise = way * ((force > _LARGEST_FORCE) - (force < _FELT_FORCE))
                self._here[2] = np.clip(self._here[2] + rise, floor, floor + _GUARDED)
            return self._control.close(time, interval)

        self._advance(_CLOSING_LIMIT, lambda _: (self._here, np.zeros(6)), close)
        here = rest_at(self._here)
        if self._accept_grasp is not None and len(self._control.touching) >= 2:
            self._advance(_PRESS_TIME, here, self._press)
        self._closed, self._measured = True, self._felt(self._control.measured_contacts())
        if self._accept_grasp is not None and not self._accept_grasp(self._measured):
            return "aborted"
        if len(self._measured) < 2:
            return "no_contact"
        duration = self._options.squeeze_time

        def squeeze(time: float) -> bool:
            self._control.squeeze(min(time / duration, 1.0))
            return False

        self._advance(duration + _SETTLE_TIME, here, squeeze)
        self._grasped = self._object_in_hand(), self._rotation_in_hand()
        return "ejected" if self._touching_links() < 2 else None

    def _seat(self) -> None:
        """Move the wrist until the fixed jaw touches: to the grasp, then on against its normal."""

        def touches(_: float) -> bool:
            return self._control.touches_fixed_jaw()

        beyond = self._options.search_distance * self._control.way_to_fixed_jaw()
        for start, end in (
            (self._arrival, np.zeros(6)),
            (np.zeros(6), np.append(beyond, np.zeros(3))),
        ):
            if not touches(0.0):
                duration = float(np.linalg.norm(end - start)) / SEARCH_SPEED
                self._advance(duration, line(start, end, duration), touches)
        self._here = self._displacement()

    def _displacement(self) -> FloatArray:
        """Return the displacement of the palm, which has not turned, from the grasp, (6,)."""
        return np.append(self._scene.X_WH[:3, 3] - self._goal, np.zeros(3))

    def _press(self, time: float) -> bool:
        """Push gently: a flat pad that touched with an edge first comes to rest on its face."""
        self._control.squeeze(_PRESS_FRACTION * min(time / _PRESS_TIME, 1.0))
        return False

    def _lift(self) -> Reason | None:
        duration = self._options.lift_time
        watch, given_up = SlipWatch(self._scene, self._control), False
        felt: list[tuple[float, float]] = []  # vertical force [N] and rise [m] of the hand

        def hold(time: float) -> bool:
            nonlocal given_up
            rise = self._displacement()[2] - self._here[2]
            felt.append((sum(contact.force[2] for contact in self._scene.contacts()), rise))
            if self._weighed is None:
                given_up = self._accept_grasp is not None and watch.total > _SLIP_LIMIT
                if rise >= _WATCHED_RISE:
                    given_up |= self._weigh(felt) and self._accept_grasp is not None
                elif watch.has_slipped():
                    self._control.grip_harder(_GRIP_FACTOR)
            # Before another attempt, an object that is lost already is not lifted higher.
            lost = self._accept_grasp is not None and self._has_moved()
            return self._hold_grip(time) or given_up or lost

        self._advance(duration, line(self._here, self._here + self._rise, duration), hold)
        if given_up:
            return "set_down"
        self._lifted = self._in_hand()
        if self._lifted:
            self._weigh(felt)
        return None if self._lifted else self._failure("not_lifted")

    def _weigh(self, felt: list[tuple[float, float]]) -> bool:
        """Weigh the object by the vertical force on the rising hand, and carry it.

        Returns whether it is heavier than assumed, and the grip too small for it.
        """
        forces, rises = np.array(felt[-_WEIGHED_STEPS:]).T
        times = np.arange(len(rises)) / _CONTROL_RATE
        acceleration = 2.0 * np.polyfit(times, rises, 2)[0] if len(rises) > 2 else 0.0
        mass = float(forces.mean()) / max(GRAVITY + acceleration, 0.5 * GRAVITY)
        self._weighed = max(mass, _LEAST_MASS)
        self._control.carry(self._weighed)
        self._margin = self._control.exerted / self._setup.needed_force(self._weighed)
        assumed = self._options.assumed_mass or self._setup.mass
        return self._margin < _LEAST_MARGIN and self._weighed > _HEAVIER * assumed

    def _shake(self) -> Reason | None:
        options = self._options
        directions = np.diag(np.repeat([1.0, 1.0 / options.turn_arm], 3))
        for acceleration in options.shake_accelerations:
            for name, direction in zip(_DIRECTIONS, directions, strict=True):
                path_at = partial(self._shake_path, direction)
                motion = self._scene.carrier.shake(path_at, acceleration, options.shake_time, name)
                self._move(motion, self._hold_grip)
                if not self._in_hand():
                    return self._failure("dropped")
            self._survived = acceleration
        return None

    def _shake_path(self, direction: FloatArray, acceleration: float) -> WristPath:
        options = self._options
        return shake_about(
            self._here + self._rise,
            direction,
            acceleration,
            frequency=options.shake_frequency,
            cycles=options.shake_cycles,
        )

    def _hold(self) -> Reason | None:
        checked, before = 0.0, self._object_in_hand()

        def hold_until_rest(time: float) -> bool:
            nonlocal checked, before
            if time - checked >= _REST_TIME:
                moved = np.linalg.norm(self._object_in_hand() - before)
                checked, before = time, self._object_in_hand()
                if moved < _AT_REST:
                    return True
            return self._hold_grip(time)

        self._advance(self._options.hold_time, rest_at(self._here + self._rise), hold_until_rest)
        return None if self._in_hand() else self._failure("dropped")

    def _stop_at_contact(self, time: float) -> bool:
        """Record contacts of the hand with the object on the approach; return whether to stop."""
        contacts = [c for c in self._scene.contacts() if c.strength >= _UNEXPECTED_FORCE]
        if contacts:
            measured = Contacts(
                np.array([contact.point for contact in contacts]),
                np.array([contact.normal for contact in contacts]),
                fingers=tuple(contact.link for contact in contacts),
            )
            self._measured = self._felt(measured)
        return bool(contacts)

    def _felt(self, measured: Contacts) -> Contacts:
        """Return contacts with the balls inside the hand's links, where no object is."""
        for link in self._setup.hand.link_geometries:
            centers, radii = balls_inside(link)
            centers = apply_pose(self._scene.X_WL(link.link) @ link.X_LG, centers)
            free = replace(Contacts.empty(), free_points=centers, free_radii=radii)
            measured = measured.append(free)
        return measured

    def _let_go(self) -> None:
        """Lower what is still in the hand, open it, retreat, and wait until the object rests."""
        self._lost_after = self._slip(), self._turn()
        here = self._displacement()

        def lower(time: float) -> bool:
            self._control.hold()
            return self._clearance() < _SETTLED  # the wrist feels the table

        if self._grasped is not None and self._touching_links() >= 2:
            self._advance(_RETREAT_TIME, line(here, self._here, _RETREAT_TIME), lower)
            here = self._displacement()

        def open_hand(time: float) -> bool:
            self._control.open(time / _RETREAT_TIME)
            return False

        if self._closed:
            self._control.release()
            self._advance(_RETREAT_TIME + _SETTLE_TIME, rest_at(here), open_hand)
        if self._grasped is not None:  # along the approach, at the height of the hand
            self._advance(_RETREAT_TIME, line(here, here + self._retreat, _RETREAT_TIME))
            here = here + self._retreat
        self._advance(_RETREAT_TIME, line(here, self._retreat, _RETREAT_TIME))
        before = self._scene.X_WO
        for _ in range(_FALLS):
            self._advance(_SETTLE_TIME, rest_at(self._retreat))
            moved = float(np.abs(self._scene.X_WO - before).max())
            if moved < _AT_REST:
                break
            before = self._scene.X_WO
        homeward = self._scene.carrier.go_home()
        if homeward is not None:
            self._move(homeward)

    def _hold_grip(self, time: float) -> bool:
        self._control.hold()
        return self._slip() > _LOST

    def _advance(
        self, duration: float, path: WristPath, fingers: _FingerCommand | None = None
    ) -> None:
        """Move the palm along a path; see `_move`."""
        self._move(self._scene.carrier.follow(path, duration), fingers)

    def _move(self, motion: CarrierMotion, fingers: _FingerCommand | None = None) -> None:
        """Step until the motion is over, or `fingers` returns that the phase is."""
        step = self._options.time_step
        command_every = max(1, round(1.0 / (_CONTROL_RATE * step)))
        record_every = max(1, round(1.0 / (self._options.frame_rate * step)))
        for count in range(round(motion.duration / step)):
            if fingers is not None and count % command_every == 0 and fingers(count * step):
                break
            motion.command((count + 1) * step)
            self._scene.step()
            if self._scene.steps % record_every == 0:
                self._record()

    def _record(self) -> None:
        self._times.append(self._scene.time)
        for name, X in self._scene.poses().items():
            self._poses.setdefault(name, []).append(X)

    def _moved(self) -> float:
        """Return the displacement of the object's centre of mass from the start [m]."""
        return float(np.linalg.norm(self._center() - self._start))

    def _center(self) -> FloatArray:
        """Return the object's centre of mass, shape (3,) [m]."""
        return apply_pose(self._scene.X_WO, self._p_OC)

    def _pushed(self) -> bool:
        return self._moved() > self._options.largest_push

    def _object_in_hand(self) -> FloatArray:
        """Return the object's centre of mass in the palm frame, shape (3,) [m]."""
        return apply_inverse(self._scene.X_WH, self._center())

    def _rotation_in_hand(self) -> FloatArray:
        """Return the object's rotation in the palm frame, shape (3, 3)."""
        return np.asarray(self._scene.X_WH[:3, :3].T @ self._scene.X_WO[:3, :3])

    def _slip(self) -> float:
        """Return the motion of the object's centre of mass in the hand [m]."""
        if self._grasped is None:
            return 0.0
        return float(np.linalg.norm(self._object_in_hand() - self._grasped[0]))

    def _turn(self) -> float:
        """Return the angle by which the object has turned in the hand [rad]."""
        if self._grasped is None:
            return 0.0
        between = Rotation.from_matrix(self._grasped[1].T @ self._rotation_in_hand())
        return float(between.magnitude())

    def _touching_links(self) -> int:
        return len({c.link for c in self._scene.contacts() if c.strength >= _LEAST_FORCE})

    def _clearance(self) -> float:
        """Return the distance of the object's lowest point from the table [m]."""
        X_WO = self._scene.X_WO
        bottom = float((self._hull @ X_WO[2, :3]).min() + X_WO[2, 3])
        return bottom - self._setup.support_height

    def _carried(self) -> bool:
        """Return whether the object has risen by half as much as the hand, which touches it."""
        rise = min(float(self._displacement()[2] - self._here[2]), self._options.lift_height)
        return self._clearance() >= 0.5 * rise and self._touching_links() >= 2

    def _has_moved(self) -> bool:
        """Return whether the object has moved or turned too far in the hand."""
        options = self._options
        return self._slip() >= options.largest_slip or self._turn() >= options.largest_turn

    def _in_hand(self) -> bool:
        return self._carried() and not self._has_moved()

    def _failure(self, lost: Reason) -> Reason:
        """Return "slipped" or "turned" for an object that is still carried, else `lost`."""
        if not self._carried():
            return lost
        return "slipped" if self._slip() >= self._options.largest_slip else "turned"
