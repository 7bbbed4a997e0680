"""Use of an arm's limits in a simulated motion, and the error that ends such a motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from lis_grasp.exceptions import counted

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

    Unwanted are contacts of the arm's links with anything; of the hand with a body beside the
    object, and with the table, except of fingertips that a lift plans to slide on it; of the object
    with links other than fingertips and pads; and, on a transit or the approach to a grasp, of the
    object with any link of the hand.
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
    #: where each was met first: on a transit, in a touch, or in a lift
    stages: dict[str, str] = field(default_factory=dict)
    shakes: list[ArmShake] = field(default_factory=list)


def violations(uses: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return what the plain values of `ArmUse` violate, in words: contacts, efforts and speeds."""
    touched: dict[str, int] = {}
    forces: dict[str, float] = {}
    on: dict[str, str] = {}
    limits = []
    for use in uses:
        for pair, stage in use.get("stages", {}).items():
            on.setdefault(pair, f" of a {stage}")
        for pair, force in use.get("forces", {}).items():  # older reports have none
            forces[pair] = max(force, forces.get(pair, 0.0))
        for pair, steps in use["contacts"].items():
            touched[pair] = touched.get(pair, 0) + steps
        if use["effort"] >= EFFORT_LIMIT:
            limits.append(f"{use['effort_joint']} at its largest effort")
        if use["speed"] > 1.0:
            limits.append(f"{use['speed_joint']} at {100 * use['speed']:.0f} % of its speed")
    contacts = [
        f"{pair} in {counted(steps, 'step')}{on.get(pair, '')}"
        + (f" with up to {forces[pair]:.2g} N" if pair in forces else "")
        for pair, steps in sorted(touched.items())
    ]
    return [*contacts, *dict.fromkeys(limits)]


ArmReason = Literal[
    "no_arm_motion",  # There is no collision-free path of the arm to the grasp.
    "out_of_arm_reach",  # The arm cannot follow the palm's path within its joint limits.
    "torque_limit",  # A joint of the arm needed more than its largest effort.
    "arm_collision",  # A link of the arm touched the object, the table or the hand.
]


class ArmStoppedError(Exception):
    """The arm cannot go on, for a reason that ends the trial."""

    def __init__(self, reason: ArmReason) -> None:
        super().__init__(reason)
        self.reason: ArmReason = reason
