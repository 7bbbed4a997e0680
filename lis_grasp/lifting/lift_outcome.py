"""How a grasp trial is run and judged, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Literal

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.motion import Motion
from lis_grasp.typing import FloatArray

Reason = Literal[
    "held",  # lifted, shaken and still in the hand
    "unstable",  # the object does not stand on the table by itself
    "collision_on_approach",  # the opened hand pushed the object, or did not get where it should be
    "no_contact",  # fewer than two fingers found the object
    "aborted",  # what the hand felt foretold failure: it let go and came back
    "ejected",  # closing or squeezing drove the object away
    "not_lifted",  # the hand rose without it
    "dropped",  # it was lost after it had been lifted
    "slipped",  # still in the hand, but it moved too far in it
    "diverged",  # the simulation failed
]


@dataclass(frozen=True, slots=True)
class LiftOptions:
    """How a grasp trial is run and judged.

    Parameters
    ----------
    standoff
        Length of the straight approach [m].
    approach_time, squeeze_time, lift_time, hold_time
        Durations [s]; closing takes as long as the fingers need, and holding ends before its time
        once the object has come to rest in the hand.
    lift_height
        How far the wrist rises [m].
    shake_accelerations
        Largest wrist accelerations of the shakes, one after the other, increasing [m/s^2]; each is
        applied along x, y and z of W, in both directions, and then as turns about x, y and z.
    turn_arm
        Distance from the hand's base, which turns, at which a turn accelerates by as much [m].
    shake_frequency, shake_cycles
        Of the shaking along one axis [Hz].
    grip_margin
        The fingers' normal forces add up to `grip_margin` times what the largest shake needs by
        Coulomb's law, ``m (g + a) / friction``: a robot knows the weight from its wrist.
    least_grip_force
        Lower bound of that sum [N]; its upper bounds are the hand's efforts and contact force.
    search_distance
        How far a finger goes beyond its planned contact to find the object [m].
    largest_slip
        Motion of the object's centre of mass in the palm frame, from the closed grasp on, up to
        which the object counts as held [m].
    largest_push
        Motion of the object's centre of mass up to which the approach counts as free [m]; the palm
        has to arrive within the same distance of where it was sent.
    time_step
        Of the simulation [s].
    frame_rate
        Of the recorded motion [Hz].
    """

    standoff: float = 0.12
    approach_time: float = 0.6
    squeeze_time: float = 0.3
    lift_time: float = 1.0
    hold_time: float = 3.0
    lift_height: float = 0.10
    shake_accelerations: tuple[float, ...] = (4.905, 9.81)
    turn_arm: float = 0.1
    shake_frequency: float = 4.0
    shake_cycles: int = 2
    grip_margin: float = 3.0
    least_grip_force: float = 6.0
    search_distance: float = 0.02
    largest_slip: float = 0.02
    largest_push: float = 0.01
    time_step: float = 0.005
    frame_rate: float = 30.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            numbers = value if isinstance(value, tuple) else (value,)
            if not all(0.0 < number < float("inf") for number in numbers):
                raise InvalidOptionError(f"{item.name} must be positive; it is {value}")
        shakes = self.shake_accelerations
        if any(later <= sooner for sooner, later in pairwise(shakes)):
            raise InvalidOptionError(f"shake_accelerations must increase; they are {shakes}")
        if self.shake_cycles < 2:
            raise InvalidOptionError(f"shake_cycles must be at least 2; it is {self.shake_cycles}")


@dataclass(frozen=True, slots=True, eq=False)
class LiftOutcome:
    """What came of a grasp trial.

    Parameters
    ----------
    lifted
        After the lift the object was off the table by at least half the lift, touched by two links
        of the hand or more, and had moved less than `LiftOptions.largest_slip` in the hand.
    held
        The same after shaking and holding.
    slip
        Motion of the object's centre of mass in the palm frame from the closed grasp to the end
        of the trial [m]; 0 if the grasp never closed, or the simulation diverged.
    reason
        Why it ended as it did.
    acceleration_survived
        The largest shake after which the object was still held [m/s^2]; 0 for none.
    duration
        Simulated time [s].
    motion
        Poses of the hand's links and the object, in the frame that the grasp was planned in.
    closed
        Whether the fingers closed; if not, the hand did not come so far.
    felt
        Where the hand first felt the object, in the same frame: fingers that closed, at most once
        each by their names; before that, links by theirs.
    X_WO
        Shape (4, 4): where the object was in the end, in the same frame; if the simulation
        diverged, where it was last recorded.
    """

    lifted: bool
    held: bool
    slip: float
    reason: Reason
    acceleration_survived: float
    duration: float
    motion: Motion
    closed: bool
    felt: Contacts
    X_WO: FloatArray
