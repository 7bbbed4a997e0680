"""Options and outcome of a simulated lift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Literal

import numpy as np

from lis_grasp.arms.use import ArmReason, ArmUse
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, require_at_least, require_positive
from lis_grasp.lifting.place_plan import PlaceOutcome
from lis_grasp.lifting.pose_in_hand import PoseInHand
from lis_grasp.motion import OBJECT, Motion
from lis_grasp.records import Record
from lis_grasp.typing import FloatArray

Reason = Literal[
    "held",  # The object was lifted and shaken and is still in the hand.
    "unstable",  # The object does not rest on the table by itself.
    "collision_on_approach",  # The open hand pushed the object, or did not arrive at its goal.
    "no_contact",  # Fewer than two fingers, or no cup, touched the object.
    "no_seal",  # The lip of the suction cup does not lie on the object all around.
    "aborted",  # The tactile check rejected the grasp, and the hand opened and retreated.
    "set_down",  # The object slipped at the start of the lift: the hand set it down and retreated.
    "ejected",  # Closing or squeezing pushed the object out of the hand.
    "not_lifted",  # The hand rose without the object.
    "pulled_off",  # The lip of the suction cup came off, and the vacuum was lost.
    "dropped",  # The object was lost after it had been lifted.
    "slipped",  # The object is still in the hand but moved too far in it.
    "turned",  # The object is still in the hand and has not slipped, but turned too far in it.
    "hit_body",  # A body beside the object was pushed with more than `LARGEST_FORCE_BESIDE`.
    "diverged",  # The simulation failed.
    ArmReason,
]

LOST_GRASPS = frozenset(
    {"aborted", "collision_on_approach", "no_contact", "set_down", "ejected", "not_lifted"}
    | {"no_seal", "pulled_off", "dropped", "slipped", "turned", "hit_body"}
)
"""Reasons after which a hand with a tactile check lets go and retreats, to try again."""


LARGEST_FORCE_BESIDE = 2.0
"""Force on a body beside the object [N] above which a lift stops, and has failed."""


@dataclass(frozen=True, slots=True)
class LiftOptions:
    """Options of a simulated lift: lengths [m], times [s], and what counts as held."""

    standoff: float = 0.12  #: length of the straight approach
    approach_time: float = 0.6
    squeeze_time: float = 0.3  #: after closing, which takes as long as the fingers need
    lift_time: float = 1.0
    hold_time: float = 3.0  #: at most: holding ends once the object rests in the hand
    lift_height: float = 0.10  #: rise of the wrist
    #: peak accelerations of the wrist in successive shakes, increasing [m/s^2]; each is applied
    #: along x, y and z of W, in both directions, and then as rotations about x, y and z
    shake_accelerations: tuple[float, ...] = (4.905, 9.81)
    #: distance from the axis of a rotation at which it accelerates by as much: an arm that reaches
    #: 0.65 m turns its palm by at most 15 rad/s^2 while it accelerates it by 1 g
    turn_arm: float = 0.65
    shake_frequency: float = 4.0  #: [Hz]
    shake_cycles: int = 2  #: periods along one axis
    #: sum of the fingers' normal forces over what the largest shake needs by Coulomb's law,
    #: ``m (g + a) / friction``, or by the load that the planned grasp carries per newton, its
    #: quality ``"load_per_grip"``: a robot measures the weight with its wrist
    grip_margin: float = 3.0
    least_grip_force: float = 6.0  #: of that sum [N]; it is limited by efforts and contact force
    #: Coulomb coefficient with which the grip forces are planned; None for the true one. When the
    #: object slips over the pads in the first centimetre of the lift, the grip force is raised
    assumed_friction: float | None = None
    #: mass with which they are planned until the hand has weighed the object, at one centimetre
    #: [kg]; None for the true one
    assumed_mass: float | None = None
    search_distance: float = 0.02  #: of a finger beyond its planned contact to find the object
    largest_slip: float = 0.02  #: of a held object's centre of mass in the palm after the grasp
    largest_turn: float = float(np.deg2rad(15.0))  #: of a held object in the palm [rad]
    #: motion of the object in a collision-free approach; the palm arrives as near to its goal
    largest_push: float = 0.01
    time_step: float = 0.005  #: of the simulation
    frame_rate: float = 30.0  #: of the recorded motion [Hz]
    #: standard deviations of the object's place before the lift, as known: of x and y [m], and of
    #: its turn about the vertical [rad]
    place_deviations: tuple[float, float] = (0.001, 0.02)

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

    @property
    def shake_directions(self) -> FloatArray:
        """Directions (6, 6) of the shakes: displacements along x, y, z, and turns about them."""
        return np.diag(np.repeat([1.0, 1.0 / self.turn_arm], 3))


@dataclass(frozen=True, slots=True, eq=False)
class LiftOutcome(Record):
    """Outcome of a simulated lift.

    In the hand is an object that at least two fingers or a cup touch, and that has moved and
    turned in the palm frame less than `LiftOptions.largest_slip` and `largest_turn`.
    """

    lifted: bool  #: after the lift it was in the hand, off the table by at least half the lift
    held: bool  #: whether it was so after shaking and holding too
    #: motion of its centre of mass in the palm frame, from the closed grasp to the end [m]; 0 if
    #: the grasp never closed, or the simulation diverged
    slip: float
    turn: float  #: angle of its rotation in the palm frame in the same time [rad]
    reason: Reason  #: why the trial ended
    acceleration_survived: float  #: largest shake after which it was held [m/s^2]; 0 for none
    duration: float  #: simulated time [s]
    motion: Motion  #: of hand and object, in the frame W in which the grasp was planned
    closed: bool  #: whether the fingers closed; if not, the trial ended before
    #: first contacts with the object, in W: of the closed fingers, at most one each, tagged with
    #: the finger; on an approach that was stopped, of the links, tagged with the link
    measured_contacts: Contacts
    #: with the space inside the hand's links then, which is free
    X_WO: FloatArray  #: (4, 4), final pose of the object; the last recorded one if it diverged
    weighed: float | None = None  #: mass of the object by the forces on the hand [kg]
    #: grip force by that which just carries the weighed mass in the largest shake, as planned
    grip_margin: float | None = None
    arm: ArmUse | None = None  #: what was demanded of the arm; None for a hand on a free wrist
    #: largest force of hand, arm and object on each body beside the object that they touched [N]
    forces: Mapping[str, float] = field(default_factory=dict)
    #: (4, 4), final poses of the free bodies beside the object, in W like all of this
    X_EB: Mapping[str, FloatArray] = field(default_factory=dict)
    place: PlaceOutcome | None = None  #: of an object that was held and then placed
    #: pose of a lifted object in the palm as the hand felt it, after the last phase in which it was
    #: in the hand; O is the frame in which the grasp was planned
    pose_in_hand: PoseInHand | None = None
    #: its distance [m] and angle [rad] from the true one
    pose_error: tuple[float, float] | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)  #: of each phase, in order [s]

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
