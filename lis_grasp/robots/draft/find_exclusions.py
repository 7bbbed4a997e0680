"""Pairs of links that collide by design, found by sampling postures."""

from __future__ import annotations

from collections import Counter

import numpy as np

from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_parts import joints_to

_SAMPLES = 200
# A pair may touch if it collides in this fraction of random postures: near in the tree, and any.
_OFTEN_NEAR, _OFTEN = 0.1, 0.4
_NEAR = 3  # movable joints between two links that are near in the tree
_CHAINED = 2  # movable joints between two links of one chain whose limits keep them apart


def find_exclusions(
    hand: Hand, checker: HandCollisionChecker, *, rng: np.random.Generator
) -> frozenset[tuple[str, str]]:
    """Return the pairs of links that collide in so many postures that they must do so by design.

    These are pairs that collide in 40 % of random postures, and in 10 % if at most three movable
    joints are between them. Links of one chain with two joints between them may touch wherever they
    do: the limits of two joints keep the real links apart, so that only their hulls overlap. Of a
    hand with two fingers every pair that collides at all counts,
    since its fingers close on each other and its linkages overlap.
    """
    q = rng.uniform(hand.lower, hand.upper, size=(_SAMPLES, len(hand.joint_names)))
    q[0] = np.clip(0.0, hand.lower, hand.upper)
    ends = rng.spawn(1)[0].uniform(-0.5, 1.5, size=q.shape).clip(0.0, 1.0)  # many at limits
    chained = {
        pair
        for posture in hand.lower + ends * (hand.upper - hand.lower)
        for pair in checker.self_collisions(posture)
        if _are_chained(hand, *pair)
    }
    found = Counter(pair for posture in q for pair in checker.self_collisions(posture))
    excluded = set(chained)
    for pair, count in found.items():
        often = _OFTEN_NEAR if _joints_between(hand, *pair) <= _NEAR else _OFTEN
        if (
            len(hand.pads) == 2
            or count >= often * _SAMPLES
            or pair in checker.self_collisions(q[0])
        ):
            excluded.add(pair)
    return frozenset(excluded)


def _joints_between(hand: Hand, first: str, second: str) -> int:
    return len(_movers(hand, first) ^ _movers(hand, second))


def _are_chained(hand: Hand, first: str, second: str) -> bool:
    """Return whether one link carries the other, with two movable joints between them at most."""
    movers = _movers(hand, first), _movers(hand, second)
    in_one_chain = movers[0] <= movers[1] or movers[1] <= movers[0]
    return in_one_chain and len(movers[0] ^ movers[1]) <= _CHAINED


def _movers(hand: Hand, link: str) -> set[str]:
    return {joint.name for joint in joints_to(hand.joints, link) if joint.index >= 0}
