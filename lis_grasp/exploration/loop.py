"""The loop of an exploration: choose a probe, carry it out, perceive what it met."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from lis_grasp.exceptions import InvalidOptionError, note
from lis_grasp.exploration.neighbours import PlanningProber
from lis_grasp.exploration.observations import Observation
from lis_grasp.exploration.perception import TactilePerception, advance, begin
from lis_grasp.exploration.probe import MovingProber, Prober, end_at_home
from lis_grasp.exploration.states import Exploration, ExplorationState
from lis_grasp.exploration.strategy import ExplorationStrategy, choose, end
from lis_grasp.surfaces.contact_checks import doubt_of_side
from lis_grasp.typing import Seed


def explore(
    prober: Prober,
    perception: TactilePerception,
    strategy: ExplorationStrategy,
    *,
    rng: Seed = 0,
    recorded: Sequence[Observation] = (),
    record: Callable[[Observation], None] | None = None,
) -> Exploration:
    """Explore an object by touch; the surface estimated so far guides every probe.

    The exploration ends after `strategy.touches` contacts, when a stop rule applies, when the
    policy has no probe left, or after ``4 touches + 20`` probes. A resumed exploration makes the
    same probes as an uninterrupted one. A warning says once if normals seem to point inward.

    Parameters
    ----------
    prober
        Carries out probes; a `MovingProber` if the object is tracked.
    perception
        What is known beforehand, and how contacts become what is known.
    strategy
        How probes are chosen.
    rng
        Seed or generator, for every draw of policy and sensor.
    recorded
        Observations of an interrupted exploration, to resume.
    record
        Called with every new observation, before the next estimate, which may take long.
    """
    start = begin(perception, strategy, recorded)
    steps = explore_steps(prober, perception, strategy, rng=rng, start=start)
    state = next(steps)
    for state in steps:
        if record is not None and not state.ended:
            record(state.observations[-1])
    return state.result


def explore_steps(
    prober: Prober,
    perception: TactilePerception,
    strategy: ExplorationStrategy,
    *,
    rng: Seed = 0,
    start: ExplorationState | None = None,
) -> Iterator[ExplorationState]:
    """Explore as `explore` does; yield the state before the first probe, after each, and the end.

    `start` is the state to continue from; None for `begin`'s. The last state is `end`'s.
    """
    if perception.tracker is not None and not isinstance(prober, MovingProber):
        raise InvalidOptionError(
            "an object is tracked with a prober that has 'move_frame'; this one has none",
            option="tracker",
        )
    state = begin(perception, strategy) if start is None else start
    doubt, rng = "", np.random.default_rng(rng)
    rng.spawn(len(state.observations))  # the generators of the probes so far
    planning = prober if isinstance(prober, PlanningProber) and state.beside is not None else None
    reaches = None if planning is None else planning.reaches
    if planning is not None and state.beside is not None:
        planning.place_known(state.beside.poses)
    while True:
        yield state
        draws = rng.spawn(1)[0]
        chosen = choose(strategy, state, rng=draws, reaches=reaches)
        if isinstance(chosen, str):
            yield replace(end(strategy, state, chosen), homeward=end_at_home(prober))
            return
        outcome = prober.probe(chosen.probe, chosen.obstacles)
        if perception.sensor is not None:
            outcome = perception.sensor.report(outcome, rng=draws)
        state = advance(perception, state, outcome, chosen.refused)
        if not doubt and (doubt := doubt_of_side(state.known)):
            note(doubt)
        if isinstance(prober, MovingProber):
            for X_EF in state.frames:
                prober.move_frame(X_EF)
        if planning is not None and state.beside is not None and state.observations[-1].beside:
            planning.place_known(state.beside.poses)
