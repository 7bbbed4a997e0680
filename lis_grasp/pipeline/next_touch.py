"""Next touch of an object, from contacts so far: probe, hand pose and reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidOptionError, require_positive
from lis_grasp.exploration import (
    STEP_FRACTION,
    Probe,
    ProbeOutcome,
    Workspace,
    advance,
    begin,
    choose,
)
from lis_grasp.pipeline.known import Known
from lis_grasp.pipeline.stages import exploration_rng, exploration_setup
from lis_grasp.probing.approach_planner import Approach, ApproachPlanner
from lis_grasp.probing.guarded_motion import NO_FREE_APPROACH
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray

# Probes that cannot be approached, before the search is given up.
_MOST_BLOCKED = 20
# Size of an object in extents of its contacts, if it is not given.
_BEYOND_CONTACTS = 1.2


@dataclass(frozen=True, slots=True, eq=False)
class NextTouch:
    """The next probe, how the hand approaches it, and why it was chosen."""

    probe: Probe
    approach: Approach
    policy: str
    distance: float | None  #: from the target to the nearest contact [m]; None without contacts
    deviation: float | None  #: of the estimate at the target [m]; None without contacts
    blocked: int  #: probes before it that no finger could approach

    def __repr__(self) -> str:
        return f"NextTouch({self.approach.posture.finger}, {self.why()})"

    def why(self) -> str:
        """Return the reason in words."""
        passed = f"; {self.blocked} others cannot be approached" if self.blocked else ""
        if self.distance is None or self.deviation is None:
            return f"there are no contacts yet{passed}"
        return (
            f"the nearest contact is {1e3 * self.distance:.0f} mm away, the standard deviation of"
            f" the estimate is {1e3 * self.deviation:.1f} mm there (policy {self.policy}){passed}"
        )

    def facts(self, hand: Hand) -> dict[str, Any]:
        """Return the touch as plain values, in O, in metres and radians."""
        posture = self.approach.posture
        return {
            "target": self.probe.target.tolist(),
            "direction": self.probe.direction.tolist(),
            "start": self.probe.start.tolist(),
            "end": self.probe.end.tolist(),
            "finger": posture.finger,
            "X_OH_outside": self.approach.X_OH_outside.tolist(),
            "X_OH": self.approach.X_OH.tolist(),
            "joint_names": list(hand.joint_names),
            "joint_positions": posture.joint_positions.tolist(),
            "why": self.why(),
        }


def workspace_of(
    contacts: Contacts,
    *,
    center: FloatArray | None = None,
    size: float | None = None,
    support_height: float | None = None,
) -> Workspace:
    """Return the workspace of an object that is known by contacts so far.

    Parameters
    ----------
    contacts
        In O.
    center
        Shape (3,) [m], centre of the object; None for that of the contacts.
    size
        Largest extent of the object [m]; None for 1.2 extents of the contacts.
    support_height
        Height of the table in O [m]; None for none.

    Raises
    ------
    InvalidOptionError
        If fewer than two contacts leave the size unknown.
    """
    if size is None and not contacts.extent:
        raise InvalidOptionError(
            f"{len(contacts)} contacts do not show the object's size: give it by `size`",
            option="size",
        )
    if size is not None:
        require_positive(size=size)
    if center is None:
        center = contacts.bounds.mean(axis=0) if len(contacts) else np.zeros(3)
    size = _BEYOND_CONTACTS * contacts.extent if size is None else size
    return Workspace(STEP_FRACTION * size, center, size, support_height)


def next_touch(
    known: Known, contacts: Contacts, outcomes: Sequence[ProbeOutcome] = ()
) -> NextTouch:
    """Return the next touch that the known policy chooses and the hand can approach.

    It is the next touch of the exploration with these outcomes, which has no limit here.

    Parameters
    ----------
    known
        Its hand needs a probe posture. In a region without contacts, the touch is a search motion.
        Its cloud is not used: it is part of the contacts.
    contacts
        Those made before the outcomes, in O.
    outcomes
        Outcomes of probes, if known: they make contacts too, and missed and blocked ones are not
        tried again.

    Raises
    ------
    EstimationError
        If no probe can be approached, or the policy has none left.
    """
    hand, planner = known.hand, ApproachPlanner(known.hand)
    setup = exploration_setup(replace(known, cloud=None))
    setup = replace(setup, touches=None, prior=contacts)
    state, rng = begin(setup, outcomes), exploration_rng(known)
    rng.spawn(len(outcomes) or len(contacts))  # the generators of the probes so far
    blocked = 0
    while blocked < _MOST_BLOCKED:
        chosen = choose(setup, state, rng=rng.spawn(1)[0])
        if isinstance(chosen, str) or chosen.obstacles is None:
            break
        probe, so_far = chosen.probe, state.known
        approach = planner.plan(probe, chosen.obstacles)
        if approach is not None:
            distance = deviation = None
            if state.estimated is not None:
                distance = float(np.linalg.norm(so_far.points - probe.target, axis=1).min())
                deviation = float(state.estimated.uncertainty(probe.target[None])[0])
            return NextTouch(probe, approach, str(known.policy), distance, deviation, blocked)
        state = advance(setup, state, ProbeOutcome(probe, "blocked", reason=NO_FREE_APPROACH))
        blocked += 1
    raise EstimationError(
        f"the policy {known.policy} has no probe that the hand {hand.name} can approach, after"
        f" {blocked} tries: check `center`, `size`, `support` or `region`, or choose another policy"
    )
