"""Options and outcome of a simulated lift, and what it demanded of an arm."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, counted, require_at_least, require_positive
from lis_grasp.motion import OBJECT, Motion
from lis_grasp.records import Record
from lis_grasp.typing import FloatArray

EFFORT_LIMIT = 0.999
"""Fraction of a joint's largest effort from which on it is at its limit: motors clip there."""

TABLE = "table"
"""Name of the table in `ArmUse.contacts`."""


@dataclass(frozen=True, slots=True)
class ArmShake:
    """Peak accelerations of one shake: asked for, and made by the arm's own motion [m/s^2].

    The rest acts on the object as forces, equivalent to it in the palm's frame.
    """

    direction: str
    asked: float
    by_motion: float


@dataclass(slots=True)
class ArmUse:
    """Largest use of an arm's limits in a simulated motion, checked at every step.

    Unwanted contacts are those of the arm's links with anything, of the hand with the table, but of
    fingertips that a lift plans to slide on it, of the object with any link but fingertips and
    pads in a lift, and of the object with any link of the hand on a transit or the approach to a
    grasp. In a touch every link of the hand may touch the object.
    """

    effort: float = 0.0  #: largest fraction of a joint's effort limit
    effort_joint: str = ""  #: the joint that came closest to it
    speed: float = 0.0  #: largest fraction of a joint's speed limit
    speed_joint: str = ""
    palm_error: float = 0.0  #: largest distance of the palm from its commanded place [m]
    contact_force: float = 0.0  #: largest force of a link of the hand on the object [N]
    steps: int = 0  #: that were checked
    #: steps with a contact of each unwanted pair, such as ``"palm with table"``
    contacts: dict[str, int] = field(default_factory=dict)
    #: largest force of each of them [N]
    forces: dict[str, float] = field(default_factory=dict)
    shakes: list[ArmShake] = field(default_factory=list)


def violations(uses: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return what the plain values of `ArmUse` violate, in words: contacts, efforts and speeds."""
    touched: dict[str, int] = {}
    forces: dict[str, float] = {}
    limits = []
    for use in uses:
        for pair, force in use.get("forces", {}).items():  # older reports have none
            forces[pair] = max(force, forces.get(pair, 0.0))
        for pair, steps in use["contacts"].items():
            touched[pair] = touched.get(pair, 0) + steps
        if use["effort"] >= EFFORT_LIMIT:
            limits.append(f"{use['effort_joint']} at its largest effort")
        if use["speed"] > 1.0:
            limits.append(f"{use['speed_joint']} at {100 * use['speed']:.0f} % of its speed")
    contacts = [
        f"{pair} in {counted(steps, 'step')}"
        + (f" with up to {forces[pair]:.2g} N" if pair in forces else "")
        for pair, steps in sorted(touched.items())
    ]
    return [*contacts, *dict.fromkeys(limits)]


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
    "slipped",  # The object is still in the hand but moved too far in it.
    "turned",  # The object is still in the hand and has not slipped, but turned too far in it.
    "diverged",  # The simulation failed.
    "no_arm_motion",  # There is no collision-free path of the arm to the grasp.
    "out_of_arm_reach",  # The arm cannot follow the palm's path within its joint limits.
    "torque_limit",  # A joint of the arm needed more than its largest effort.
    "arm_collision",  # A link of the arm touched the object, the table or the hand.
]

LOST_GRASPS = frozenset(
    {"aborted", "collision_on_approach", "no_contact", "set_down", "ejected", "not_lifted"}
    | {"dropped", "slipped", "turned"}
)
"""Reasons after which a hand with a tactile check lets go and retreats, to try again."""


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
    #: the fingers' normal forces add up to so many times what the largest shake needs, by Coulomb's
    #: law, ``m (g + a) / friction``, or by the load that the planned grasp carries per newton, its
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
class LiftOutcome(Record):
    """Outcome of a simulated lift.

    In the hand is an object that at least two links of the hand touch, and that has moved and
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
