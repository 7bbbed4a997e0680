"""Options and outcome of a simulated lift."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Literal

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, require_at_least, require_positive
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.motion import OBJECT, Motion
from lis_grasp.typing import FloatArray

Reason = Literal[
    "held",  # The object was lifted and shaken and is still in the hand.
    "unstable",  # The object does not rest on the table by itself.
    "collision_on_approach",  # The open hand pushed the object, or did not arrive at its goal.
    "no_contact",  # Fewer than two fingers touched the object.
    "aborted",  # The tactile check rejected the grasp, and the hand opened and retreated.
    "set_down",  # The object slipped at the start of the lift: the hand set it down and retreated.
    "ejected",  # Closing or squeezing pushed the object out of the hand.
    "not_lifted",  # The hand rose without the object.
    "dropped",  # The object was lost after it had been lifted.
    "slipped",  # The object is still in the hand but moved or turned too far in it.
    "diverged",  # The simulation failed.
    "no_arm_motion",  # There is no collision-free path of the arm to the grasp.
    "out_of_arm_reach",  # The arm cannot follow the palm's path within its joint limits.
    "torque_limit",  # A joint of the arm needed more than its largest effort.
    "arm_collision",  # A link of the arm touched the object, the table or the hand.
]


@dataclass(frozen=True, slots=True)
class LiftOptions:
    """Options of a simulated lift.

    Parameters
    ----------
    standoff
        Length of the straight approach [m].
    approach_time, squeeze_time, lift_time, hold_time
        Durations [s]; closing takes as long as the fingers need, and holding ends early once the
        object rests in the hand.
    lift_height
        Rise of the wrist [m].
    shake_accelerations
        Peak accelerations of the wrist in successive shakes, increasing [m/s^2]; each is applied
        along x, y and z of W, in both directions, and then as rotations about x, y and z.
    turn_arm
        Distance from the axis of a rotation at which it accelerates by as much [m]: an arm that
        reaches 0.65 m turns its palm by at most 15 rad/s^2 while it accelerates it by 1 g.
    shake_frequency, shake_cycles
        Frequency and number of periods of the shaking along one axis [Hz, 1].
    grip_margin
        The fingers' normal forces add up to `grip_margin` times what the largest shake needs, by
        Coulomb's law, ``m (g + a) / friction``, or by the load that the planned grasp carries per
        newton, its quality ``"load_per_grip"``: a robot measures the weight with its wrist.
    least_grip_force
        Lower bound of that sum [N]; its upper bounds are the hand's efforts and contact force.
    assumed_friction
        Coulomb coefficient with which the grip forces are planned; None for the true one. When the
        object slips over the pads in the first centimetre of the lift, the grip force is raised.
    assumed_mass
        Mass with which the grip forces are planned until the hand has weighed the object, at one
        centimetre [kg]; None for the true one.
    search_distance
        Largest motion of a finger beyond its planned contact to find the object [m].
    largest_slip
        Largest motion in the palm frame, after the grasp has closed, of the centre of mass of an
        object that counts as held [m].
    largest_turn
        Largest rotation of such an object in the palm frame, after the grasp has closed [rad].
    largest_push
        Largest motion of the object's centre of mass in a collision-free approach [m]; the palm has
        to arrive within the same distance of its goal.
    time_step
        Time step of the simulation [s].
    frame_rate
        Frame rate of the recorded motion [Hz].
    """

    standoff: float = 0.12
    approach_time: float = 0.6
    squeeze_time: float = 0.3
    lift_time: float = 1.0
    hold_time: float = 3.0
    lift_height: float = 0.10
    shake_accelerations: tuple[float, ...] = (4.905, 9.81)
    turn_arm: float = 0.65
    shake_frequency: float = 4.0
    shake_cycles: int = 2
    grip_margin: float = 3.0
    least_grip_force: float = 6.0
    assumed_friction: float | None = None
    assumed_mass: float | None = None
    search_distance: float = 0.02
    largest_slip: float = 0.02
    largest_turn: float = float(np.deg2rad(15.0))
    largest_push: float = 0.01
    time_step: float = 0.005
    frame_rate: float = 30.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            for number in value if isinstance(value, tuple) else (value,):
                if number is None:
                    continue
                require_positive(**{item.name: number})
        shakes = self.shake_accelerations
        if any(later <= sooner for sooner, later in pairwise(shakes)):
            raise InvalidOptionError.out_of_range("shake_accelerations", shakes, "increasing")
        require_at_least(2, shake_cycles=self.shake_cycles)

    @property
    def shake_time(self) -> float:
        """Duration of one shake [s]."""
        return self.shake_cycles / self.shake_frequency


@dataclass(frozen=True, slots=True, eq=False)
class LiftOutcome:
    """Outcome of a simulated lift.

    Parameters
    ----------
    lifted
        Whether the object, after the lift, was off the table by at least half the lift, touched by
        two links of the hand or more, and had moved less than `LiftOptions.largest_slip` and turned
        less than `LiftOptions.largest_turn` in it.
    held
        Whether the same was true after shaking and holding.
    slip
        Motion of the object's centre of mass in the palm frame, from the closed grasp to the end
        [m]; 0 if the grasp never closed, or the simulation diverged.
    turn
        Angle of the object's rotation in the palm frame in the same time [rad].
    reason
        Why the trial ended; see `Reason`.
    acceleration_survived
        The largest shake after which the object was still held [m/s^2]; 0 for none.
    duration
        Simulated time [s].
    motion
        Poses of the hand's links and the object, in W: the frame in which the grasp was planned.
    closed
        Whether the fingers closed; if not, the trial ended before.
    measured_contacts
        First contacts with the object, in W: of the closed fingers, at most one each, tagged with
        the finger; on an approach that was stopped, of the links, tagged with the link.
    X_WO
        Shape (4, 4): final pose of the object; if the simulation diverged, the last recorded one.
    arm
        What was demanded of the arm; None for a hand on a free wrist.
    """

    lifted: bool
    held: bool
    slip: float
    turn: float
    reason: Reason
    acceleration_survived: float
    duration: float
    motion: Motion
    closed: bool
    measured_contacts: Contacts
    X_WO: FloatArray
    arm: ArmUse | None = None

    @classmethod
    def not_begun(cls, reason: Reason, X_WO: FloatArray) -> LiftOutcome:
        """Return the outcome of a lift that could not begin; the object is at X_WO (4, 4)."""
        return cls(
            lifted=False,
            held=False,
            slip=0.0,
            turn=0.0,
            reason=reason,
            acceleration_survived=0.0,
            duration=0.0,
            motion=Motion(np.zeros(1), {OBJECT: X_WO[None]}),
            closed=False,
            measured_contacts=Contacts.empty(),
            X_WO=X_WO,
        )
