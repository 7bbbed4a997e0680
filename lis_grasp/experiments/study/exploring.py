"""The contacts of a trial, made once for all its estimators and gone on with for larger budgets."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache

from lis_grasp import pipeline
from lis_grasp.contacts import Contacts
from lis_grasp.experiments.study.keys import file_digests
from lis_grasp.experiments.study.study import Setup, Trial, find_object, parse_noise
from lis_grasp.exploration import ProbeOutcome
from lis_grasp.hands.hand import Hand
from lis_grasp.pipeline.run_config import RunConfig


@dataclass(slots=True)
class _Explored:
    """How far an exploration has come: all outcomes, contacts asked for, time [s]."""

    outcomes: tuple[ProbeOutcome, ...] = ()
    touches: int = 0
    seconds: float = 0.0


# An exploration is a function of its arguments and of what is in their files: it does not matter
# which process makes it, and a process that runs a trial for several estimators makes it once. All
# choices in it depend on the past only, so that the contacts of a smaller budget are the first ones
# of a larger.
def contacts_of(trial: Trial, setup: Setup, explorer: str) -> tuple[Contacts, float]:
    """Return the contacts of a trial, explored with the estimator `explorer`, and the time [s].

    Goes on from what this process explored for a smaller budget of the same trial.
    """
    return _contacts_of(trial, setup, explorer, file_digests(trial.object, trial.hand))


@lru_cache(maxsize=4)
def _contacts_of(
    trial: Trial, setup: Setup, explorer: str, files: tuple[str, ...]
) -> tuple[Contacts, float]:
    known = _explored(replace(trial, touches=1), setup, explorer, files)
    if known.touches > trial.touches:  # the order of a study is from small to large
        known = _Explored()
    start = time.perf_counter()
    noise = parse_noise(trial.noise)
    config = RunConfig(
        object=trial.object,
        estimator=explorer,
        touches=trial.touches,
        seed=trial.seed,
        prober=setup.prober,
        policy=setup.policy,
        mass=setup.mass,
        friction=setup.friction,
        position_noise=noise.position,
        normal_noise=noise.normal,
    )
    exploration = pipeline.touch(
        find_object(trial.object, setup),
        Hand.load(trial.hand),
        config,
        recorded=known.outcomes,
    )
    known.outcomes, known.touches = exploration.outcomes, trial.touches
    known.seconds += time.perf_counter() - start
    return exploration.contacts, known.seconds


def forget() -> None:
    """Forget what was explored."""
    _contacts_of.cache_clear()
    _explored.cache_clear()


@lru_cache(maxsize=4)
def _explored(start: Trial, setup: Setup, explorer: str, files: tuple[str, ...]) -> _Explored:
    """Return the record of one exploration, which `contacts_of` goes on with."""
    return _Explored()
