"""Checks of policies and hands: the package's own pass, and each fault fails its own check."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lis_grasp.exceptions import FailedCheckError
from lis_grasp.exploration import POLICIES, Probe
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import HAND_NAMES
from lis_grasp.testing import (
    Check,
    _policy_claims,
    check_hand,
    check_policy,
    hand_checks,
    policy_checks,
)

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_package"
sys.path.insert(0, str(EXAMPLE))
from lis_grasp_example.from_above import FromAbove  # noqa: E402


class Sound(FromAbove):
    """The policy whose answers the faults change."""

    def next_probe(self, contacts: Any, surface: Any, *, outcomes: Any, rng: Any) -> Any:
        return super().next_probe(contacts, surface, outcomes=outcomes, rng=rng)


Change = Callable[..., Any]


def fault(change: Change, **limits: int) -> Any:
    """Return a policy whose answer is ``change(probe, space, contacts, outcomes, rng)``."""

    class Faulty(Sound):
        def next_probe(self, contacts: Any, surface: Any, *, outcomes: Any, rng: Any) -> Any:
            probe = super().next_probe(contacts, surface, outcomes=outcomes, rng=rng)
            return change(probe, self._space, contacts, outcomes, rng)

    return Faulty


def when(condition: Callable[..., Any], change: Change) -> Any:
    """Return a policy that changes its answer on a condition."""
    return fault(lambda p, *known: change(p, *known) if condition(*known) else p)


def fail(*_: Any) -> Any:
    raise ValueError("not foreseen")


def far(probe: Probe, *_: Any) -> Probe:
    return replace(probe, target=probe.target + [5.0, 0.0, 0.0])


def first_again(probe: Probe, _: Any, __: Any, outcomes: Any, ___: Any) -> Probe:
    return outcomes[-1].probe if outcomes and outcomes[-1].status != "touched" else probe


class Counting(Sound):
    """Moves its target by its own count."""

    count = 0

    def next_probe(self, contacts: Any, surface: Any, *, outcomes: Any, rng: Any) -> Any:
        probe = super().next_probe(contacts, surface, outcomes=outcomes, rng=rng)
        self.count += 1
        return replace(probe, target=probe.target + [1e-6 * self.count, 0.0, 0.0])


class FirstRemembered(Sound):
    """Keeps the first direction that it drew."""

    _kept = None

    def next_probe(self, contacts: Any, surface: Any, *, outcomes: Any, rng: Any) -> Any:
        probe = super().next_probe(contacts, surface, outcomes=outcomes, rng=rng)
        self._kept = probe if self._kept is None else self._kept
        return replace(probe, standoff=self._kept.standoff + 1e-3 * self._kept.target[0])


def at_origin(probe: Probe, space: Any, *_: Any) -> Probe:
    return replace(probe, target=probe.target - space.center, standoff=0.08, overshoot=0.03)


def busy(probe: Probe, space: Any, contacts: Any, *_: Any) -> Probe:
    end = time.process_time() + (0.3 if len(contacts) > 100 else 0.0)
    while time.process_time() < end:
        pass
    return probe


def drawing(probe: Probe, *_: Any) -> Probe:
    np.random.random()  # noqa: NPY002
    return probe


def popping(probe: Probe, space: Any, contacts: Any, outcomes: Any, rng: Any) -> Probe:
    if isinstance(outcomes, list) and outcomes:
        outcomes.pop()
    return probe


FAULTS: dict[str, Any] = {
    "makes_a_policy": lambda space: 3,
    "first_probe": when(lambda s, contacts, outcomes, rng: not outcomes, lambda *_: None),
    "every_answer": when(lambda s, c, outcomes, r: len(outcomes) == 3, lambda *_: "left"),
    "repeatable": fault(
        lambda p, *_: replace(p, overshoot=p.overshoot + 1e-3 * np.random.default_rng().random())
    ),
    "keeps_no_state": FirstRemembered,
    "keeps_no_state at all": Counting,
    "global_generator": fault(drawing),
    "knowledge_unchanged": fault(popping),
    "outcomes_in_a_list": when(
        lambda s, c, outcomes, r: isinstance(outcomes, list) and outcomes, far
    ),
    "aims_at_the_object": fault(far),
    "starts_in_free_space": fault(lambda p, *_: replace(p, standoff=0.0)),
    "moves": fault(lambda p, *_: replace(p, standoff=0.0, overshoot=0.0)),
    "touches": fault(lambda p, s, *_: replace(p, target=s.center + [0.0, 0.045, 0.0])),
    "touches_different_places": fault(lambda p, s, *_: replace(p, target=s.center)),
    "blocked_probes": fault(first_again),
    "missed_probes": fault(first_again),
    "works_elsewhere": fault(at_origin),
    "works_at_another_size": fault(
        lambda p, s, *_: replace(p, target=s.center + [0.0, 0.025, 0.0])
    ),
    "works_without_a_table": when(lambda space, *_: space.support_height is None, fail),
    "one_contact": when(lambda s, contacts, o, r: len(contacts) == 1, fail),
    "contacts_from_elsewhere": when(lambda s, contacts, o, r: len(contacts) > len(o), fail),
    "lost_contacts": when(lambda s, contacts, o, r: len(o) > 10 and not len(contacts), fail),
    "many_contacts": fault(busy),
}
"""A fault for each check, named after it."""


def refuses(check: Check) -> str:
    """Return the sentence of a check that fails."""
    with pytest.raises(FailedCheckError) as caught:
        check()
    return caught.value.failures[str(check)]


_FAST = ("first_probe", "starts_in_free_space")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in _FAST else pytest.mark.slow) for n in FAULTS]
)
def test_a_faulty_policy_fails_its_check(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_policy_claims, "_SECONDS", 0.2)
    refuses({str(c): c for c in policy_checks(FAULTS[name])}[name.split()[0]])


def test_every_check_of_a_policy_has_a_fault() -> None:
    assert {str(check) for check in policy_checks(Sound)} == {n.split()[0] for n in FAULTS}


@pytest.mark.slow
def test_the_policy_whose_answers_are_changed_passes() -> None:
    check_policy(Sound)


@pytest.mark.slow
@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_of_the_package_passes(name: str) -> None:
    check_policy(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", HAND_NAMES)
def test_a_hand_of_the_package_passes(name: str) -> None:
    check_hand(name)


@pytest.mark.slow
def test_a_hand_of_another_package_passes() -> None:
    check_hand(EXAMPLE / "lis_grasp_example" / "square_jaw.yaml")


def without_room(hand: Hand) -> Hand:
    """Return a hand whose pads are too near each other for any block."""
    pads = [replace(pad, half_angle=0.01, axis_L=-pad.axis_L) for pad in hand.pads]
    return replace(hand, pads=tuple(pads))


def closed(hand: Hand) -> Hand:
    """Return a hand with its only pregrasp at the upper limits of its joints."""
    return replace(hand, pregrasps={"closed": hand.upper})


HAND_FAULTS: dict[str, Callable[[Hand], Any]] = {
    "loads": lambda hand: "no_such_hand",
    "masses": lambda hand: replace(hand, inertials={}),
    "efforts": lambda hand: replace(hand, effort_limits=1e4 * hand.effort_limits),
    "self_collisions": lambda _: closed(Hand.load("allegro")),
    "pads": lambda hand: replace(
        hand, pads=tuple(replace(pad, center_L=pad.center_L + 0.05) for pad in hand.pads)
    ),
    "opposition": without_room,
    "probe_postures": lambda hand: replace(
        hand,
        probe_postures={
            name: replace(posture, direction_H=-posture.direction_H)
            for name, posture in hand.probe_postures.items()
        },
    ),
    "forces": lambda hand: replace(hand, max_contact_force=1e4),
    "touches": lambda hand: replace(hand, probe_postures={}),
    "grasps": without_room,
}
"""A fault for each check of a hand that a change of its record can make."""


@pytest.mark.slow
@pytest.mark.parametrize("name", HAND_FAULTS)
def test_a_faulty_hand_fails_its_check(name: str) -> None:
    faulty = HAND_FAULTS[name](Hand.load("wsg50"))
    refuses({str(c): c for c in hand_checks(faulty)}[name])


def test_a_hand_with_wrong_jacobians_fails_its_check(monkeypatch: pytest.MonkeyPatch) -> None:
    hand = Hand.load("wsg50")
    right = type(hand).pad_centers
    monkeypatch.setattr(
        type(hand), "pad_centers", lambda self, X, q, *o: 1.001 * right(self, X, q, *o)
    )
    refuses({str(c): c for c in hand_checks(hand)}["jacobians"])


def test_a_check_returns_the_claims_that_hold() -> None:
    held = check_hand("wsg50")
    claims = [str(check) for check in hand_checks("wsg50")]
    assert (held.plugin, list(held)) == ("wsg50", claims)
    assert repr(held) == f"{len(claims)} of {len(claims)} claims hold"
