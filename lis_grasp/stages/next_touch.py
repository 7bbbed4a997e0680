"""Next touch of an object, given its contacts: probe, hand pose and reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidOptionError, require_positive
from lis_grasp.exploration import (
    STEP_FRACTION,
    ExplorationState,
    ExplorationStrategy,
    Observation,
    Probe,
    ProbeOutcome,
    Region,
    TactilePerception,
    Workspace,
    advance,
    begin,
    choose,
)
from lis_grasp.exploration.strategy import MOST_BLOCKED, sought_ends
from lis_grasp.probing.approach_planner import Approach
from lis_grasp.probing.probe_planner import ProbePlanner
from lis_grasp.robots.hand import Hand
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.touch import exploration_rng, make_perception, make_strategy
from lis_grasp.surfaces.contact_checks import require_table_below
from lis_grasp.task.task import plain_value

NO_TABLE = "no table is known"
"""Start of warnings about an assumed table."""

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
    blocked: int  #: earlier choices that no finger could approach
    sought: str = ""  #: ends of the object that are not found yet, in words

    def __repr__(self) -> str:
        return f"NextTouch({self.approach.posture.finger}, {self.why()})"

    def why(self) -> str:
        """Return the reason in words."""
        passed = f"; {self.blocked} others cannot be approached" if self.blocked else ""
        passed += f"; not found yet: {self.sought}" if self.sought else ""
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
            **({"slides": self.probe.slides.tolist()} if len(self.probe.slides) else {}),
        }


@dataclass(frozen=True, slots=True)
class ObjectPlace:
    """The known place of an object, beside contacts.

    Parameters
    ----------
    center
        Shape (3,) [m], centre of the object; None for the contacts' centre, or without contacts
        the origin, or half the size above the table.
    size
        Largest extent of the object [m]; None for 1.2 extents of the contacts.
    support
        Height of the table in O [m]; None if it is unknown.
    held
        Whether the object is held in the air, without a table.
    region
        Lengths of the box on the table z = 0 that contains the object [m]; replaces all others.
    """

    center: Sequence[float] | None = None
    size: float | None = None
    support: float | None = None
    held: bool = False
    region: Sequence[float] | None = None

    def table(self, contacts: Contacts) -> float | None:
        """Return the height of the table in O [m], the lowest contact's if it is unknown.

        None for an object that is held. Raises `InvalidOptionError` without contacts.
        """
        if self.region is not None:
            return 0.0
        if len(contacts):
            require_table_below(self.support, float(contacts.bounds[1, 2]), "contacts")
        if self.support is not None or self.held:
            return self.support
        if not len(contacts):
            raise InvalidOptionError(
                "without contacts nothing shows where the table is: give its height by `support`,"
                " or `support` none for an object that is held in the air",
                option="support",
            )
        return float(contacts.bounds[0, 2])

    def doubt(self, contacts: Contacts) -> str:
        """Return what was assumed about the table, in words; empty if it is known."""
        if self.region is not None or self.support is not None or self.held:
            return ""
        return (
            f"{NO_TABLE}: the hand stays above the lowest contact, z ="
            f" {1e3 * contacts.bounds[0, 2]:.1f} mm, unless `support` gives the table's height"
        )

    def space(self, contacts: Contacts) -> Workspace | Region:
        """Return the region, or else the workspace that the contacts show.

        Raises `InvalidOptionError` if fewer than two contacts leave the size unknown, or no contact
        shows the table.
        """
        if self.region is not None:
            return Region(self.region)
        if self.size is None and not contacts.extent:
            felt = "contacts at one place" if len(contacts) else "no contact yet"
            message = f"the object's size is unknown ({felt}): give it by `size`, or a `region`"
            raise InvalidOptionError(message, option="size")
        if self.size is not None:
            require_positive(size=self.size)
        size = _BEYOND_CONTACTS * contacts.extent if self.size is None else self.size
        table = self.table(contacts)
        if self.center is not None:
            center = np.array(self.center)
        elif len(contacts):
            center = contacts.bounds.mean(axis=0)
        else:
            center = np.array([0.0, 0.0, 0.0 if table is None else table + 0.5 * size])
        is_sized = self.size is not None or not self.held
        return Workspace(STEP_FRACTION * size, center, size, table, is_sized=is_sized)


def next_touch(agent: Agent, contacts: Contacts, recorded: Sequence[Observation] = ()) -> NextTouch:
    """Return the next touch that the agent's policy chooses and its hand can approach.

    It continues the recorded exploration, here without a limit of contacts.

    Parameters
    ----------
    agent
        Its hand needs a probe posture. In a region without contacts, the touch is a search motion.
        Its cloud is not used: it is part of the contacts.
    contacts
        Contacts made before the recorded probes, in O.
    recorded
        Observations by probes, if known: they make contacts too, and missed and blocked ones are
        not tried again.

    Raises
    ------
    EstimationError
        If no probe can be approached, or the policy has none left.
    """
    perception, strategy = make_perception(agent.perception, contacts), endless(agent)
    perception = replace(perception, beside=agent.known_bodies)
    state = begin(perception, strategy, recorded)
    return next_touch_after(agent, perception, strategy, state)


def endless(agent: Agent) -> ExplorationStrategy:
    """Return the agent's strategy without a wanted number of contacts."""
    return replace(make_strategy(agent), touches=None)


def next_touch_after(
    agent: Agent,
    perception: TactilePerception,
    strategy: ExplorationStrategy,
    state: ExplorationState,
) -> NextTouch:
    """Return the next touch in a state of an exploration; see `next_touch`."""
    hand, rng, policy = agent.hand, exploration_rng(agent), plain_value(agent.decide.policy)
    planner = ProbePlanner(hand, known=agent.surroundings)
    rng.spawn(len(state.observations) or len(state.prior))  # the generators of earlier probes
    blocked = 0
    while blocked < MOST_BLOCKED:
        chosen = choose(strategy, state, rng=rng.spawn(1)[0])
        if isinstance(chosen, str) or chosen.obstacles is None:
            break
        probe, so_far = chosen.probe, state.known
        approach = planner.approach(probe, chosen.obstacles)
        if isinstance(approach, Approach):
            distance = deviation = None
            if state.estimated is not None:
                distance = float(np.linalg.norm(so_far.points - probe.target, axis=1).min())
                deviation = float(state.estimated.uncertainty(probe.target[None])[0])
            sought = sought_ends(strategy, state)
            probe = planner.ended_before(approach, probe, chosen.obstacles)
            return NextTouch(probe, approach, policy, distance, deviation, blocked, sought)
        outcome = ProbeOutcome(probe, "blocked", reason=approach)
        state = advance(perception, state, outcome)
        blocked += 1
    raise EstimationError(
        f"the policy {policy} has no probe that the hand {hand.name} can approach, after"
        f" {blocked} tries: check `center`, `size`, `support` or `region`, or choose another policy"
    )
