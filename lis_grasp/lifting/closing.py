"""Phases of a simulated lift until the grasp has closed: settle, approach, close, squeeze."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import apply_pose
from lis_grasp.lifting.felt_object import FeltObject
from lis_grasp.lifting.finger_control import SEARCH_SPEED
from lis_grasp.lifting.grip import grip_of
from lis_grasp.lifting.object_in_hand import ObjectInHand
from lis_grasp.lifting.outcome import Reason
from lis_grasp.lifting.scene import CONTROL_RATE, FingerCommand, LiftingScene, Steps
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.wrist_path import line, rest_at
from lis_grasp.robots.hand import SEATING
from lis_grasp.robots.link_bodies import balls_inside
from lis_grasp.typing import FloatArray

SETTLE_TIME = 0.1
"""Wait [s] until object and hand rest."""
SETTLED = 0.001
"""Motion of a settling object [m] beyond which it may be falling: it gets the time of a fall."""
_FALL_TIME = 0.5  # [s]
_CLOSING_LIMIT = 4.0  # [s], longer than any finger needs
_UNEXPECTED_FORCE = 0.5  # [N] at which an approach with a tactile check stops
# A guarded descent begins before the planned place [m], and ends as far behind it after a time [s],
# or when the table pushes the hand with a force [N]. When fingers that close along the table push
# it with more [N], the palm yields at a speed [m/s], at most as far, and returns when they do not.
_GUARDED, _GUARDED_TIME = 0.001, 0.5
_FELT_FORCE, _LARGEST_FORCE, _YIELD_SPEED = 0.3, 2.0, 0.02
# A tactile check decides after a push with this fraction of the grip force for this time [s].
_PRESS_FRACTION = 0.2
_PRESS_TIME = 0.2

# Contacts of the closed fingers, before they squeeze -> whether to continue.
AcceptGrasp = Callable[[Contacts], bool]


class Closing:
    """The phases of a lift until the grasp has closed, and the state in which they leave it."""

    def __init__(
        self, scene: LiftingScene, setup: LiftSetup, accept_grasp: AcceptGrasp | None
    ) -> None:
        self._scene, self._setup, self._options = scene, setup, setup.options
        self._accept_grasp = accept_grasp
        self.control = grip_of(scene, setup)
        retreat = -self._options.standoff * np.asarray(setup.grasp.approach_O, dtype=np.float64)
        self.retreat = np.append(retreat, np.zeros(3))
        # Displacements of the palm: where the approach ends, and where the hand closes.
        self._arrival, self.here = np.zeros(6), np.zeros(6)
        if setup.hand.seated_fingers:
            self._arrival = self.retreat * min(SEATING / self._options.standoff, 1.0)
        scene.place_hand(self.retreat, np.asarray(setup.grasp.pregrasp_positions))
        self.closed, self.measured = False, Contacts.empty()
        self.object, self.felt = ObjectInHand(scene, setup), FeltObject(scene, setup)
        self.steps = Steps(scene, setup, self.felt.update)

    def settle(self) -> Reason | None:
        """Wait until the object rests; return why the trial failed."""
        carrier = self._scene.carrier
        self.steps.move(carrier.wait(self.retreat, SETTLE_TIME))
        if self.object.moved() > SETTLED:
            self.steps.move(carrier.wait(self.retreat, _FALL_TIME))
        self._scene.rest_object()
        return "unstable" if self._pushed() else None

    def _pushed(self) -> bool:
        return self.object.moved() > self._options.largest_push

    def approach(self) -> Reason | None:
        """Move the open hand to the grasp; return why the trial failed."""
        transit = self._scene.carrier.bring()
        if transit is not None:
            self.steps.move(transit)
        duration, end = self._options.approach_time, self._arrival
        if self._setup.slides_on_table:
            end = _GUARDED / self._options.standoff * self.retreat
        stop = self._stop_at_contact if self._accept_grasp is not None else None
        self.steps.advance(duration, line(self.retreat, end, duration), stop)
        self.here = self._arrival.copy()
        if self._setup.slides_on_table and not len(self.measured):
            self._descend(end, stop)
        if len(self.measured):
            return "aborted"
        self.steps.advance(SETTLE_TIME, rest_at(self.here))
        error = float(np.linalg.norm(self.steps.displacement - self._arrival))
        blocked = error > self._options.largest_push or self._pushed()
        return "collision_on_approach" if blocked else None

    def _descend(self, above: FloatArray, stop: FingerCommand | None) -> None:
        """Go on along the approach until fingertips feel the table, and close there."""

        def felt(time: float) -> bool:
            return self._force_on_table() > _FELT_FORCE or (stop is not None and stop(time))

        self.steps.advance(_GUARDED_TIME, line(above, -above, _GUARDED_TIME), felt)
        self.here = self.steps.displacement

    def _force_on_table(self) -> float:
        """Return the force with which the hand pushes the table down [N]."""
        return -float(sum(contact.force[2] for contact in self._scene.contacts("table")))

    def close(self) -> Reason | None:
        """Close the hand and squeeze; return why the trial failed."""
        self._scene.carrier.expect_contact()
        self.felt.begin()
        if self._setup.hand.seated_fingers:
            self._seat()
        interval, floor = 1.0 / CONTROL_RATE, self.here[2]

        def close(time: float) -> bool:
            if self._setup.slides_on_table:
                force, way = self._force_on_table(), _YIELD_SPEED * interval
                rise = way * ((force > _LARGEST_FORCE) - (force < _FELT_FORCE))
                self.here[2] = np.clip(self.here[2] + rise, floor, floor + _GUARDED)
            return self.control.close(time, interval)

        self.steps.advance(_CLOSING_LIMIT, lambda _: (self.here, np.zeros(6)), close)
        here = rest_at(self.here)
        if self._accept_grasp is not None and len(self.control.touching) >= 2:
            self.steps.advance(_PRESS_TIME, here, self._press)
        self.closed, self.measured = True, self._felt(self.control.measured_contacts())
        refusal = self.control.refusal(self.measured, self._accept_grasp)
        if refusal is not None:
            return refusal
        duration = self._options.squeeze_time

        def squeeze(time: float) -> bool:
            self.control.squeeze(min(time / duration, 1.0))
            return False

        self.steps.advance(duration + SETTLE_TIME, here, squeeze)
        self.object.hold()
        return None if self.object.is_touched() else self.control.reason_of("ejected")

    def _seat(self) -> None:
        """Move the wrist until what it seats touches: to the grasp, then on against its normal."""

        def touches(_: float) -> bool:
            return self.control.is_seated()

        beyond = self._options.search_distance * self.control.way_to_seat()
        for start, end in (
            (self._arrival, np.zeros(6)),
            (np.zeros(6), np.append(beyond, np.zeros(3))),
        ):
            if not touches(0.0):
                duration = float(np.linalg.norm(end - start)) / SEARCH_SPEED
                self.steps.advance(duration, line(start, end, duration), touches)
        self.here = self.steps.displacement

    def _press(self, time: float) -> bool:
        """Push gently: a flat pad that touched with an edge first comes to rest on its face."""
        self.control.squeeze(_PRESS_FRACTION * min(time / _PRESS_TIME, 1.0))
        return False

    def _stop_at_contact(self, time: float) -> bool:
        """Record contacts of the hand with the object on the approach; return whether to stop."""
        contacts = [c for c in self._scene.contacts() if c.strength >= _UNEXPECTED_FORCE]
        if contacts:
            measured = Contacts(
                np.array([contact.point for contact in contacts]),
                np.array([contact.normal for contact in contacts]),
                fingers=tuple(contact.link for contact in contacts),
            )
            self.measured = self._felt(measured)
        return bool(contacts)

    def _felt(self, measured: Contacts) -> Contacts:
        """Return contacts with the balls inside the hand's links, where no object is."""
        for link in self._setup.hand.link_geometries:
            centers, radii = balls_inside(link)
            centers = apply_pose(self._scene.X_WL(link.link) @ link.X_LG, centers)
            free = replace(Contacts.empty(), free_points=centers, free_radii=radii)
            measured = measured.append(free)
        return measured
