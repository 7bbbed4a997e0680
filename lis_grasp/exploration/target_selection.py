"""Selection of the next target to touch: one function for each strategy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lis_grasp.exploration.targets import Targets
from lis_grasp.surfaces import ImplicitSurface

# Distance of the frontier from the nearest contact, in steps.
_FRONTIER = (0.8, 1.2)
# Weights of a frontier target's cost besides its distance to the nearest contact: the distance to
# the second contact, and the distance to free space.
_SECOND_WEIGHT, _FREE_WEIGHT = 0.25, 0.5
# Random part of the cost, so that explorations differ, in steps.
_RANDOM_WEIGHT = 0.1


TargetSelector = Callable[..., "int | None"]
"""Returns the index of the next target, or None to select none; called as `frontier`."""


def frontier(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Select a target about one step from the nearest contact.

    Without a frontier, select the target farthest from any contact. Ottenhaus et al. 2016, section
    IV.B, give the step (50 mm on objects of 20 cm) and derive the next target from the contacts
    and the estimated surface; the rest is ours.
    """
    nearest, step = targets.nearest, targets.step
    # Surface farther away is not connected to the contacts and seldom true, so it comes last.
    connected = targets.eligible & (nearest <= _FRONTIER[1] * step)
    candidates = np.flatnonzero(connected & (nearest >= _FRONTIER[0] * step))
    if len(candidates):
        cost = np.abs(nearest - step)
        cost += _SECOND_WEIGHT * np.minimum(targets.second, 2.0 * step)
        cost -= _FREE_WEIGHT * np.minimum(targets.free_distance, step)
        cost += _RANDOM_WEIGHT * step * rng.random(len(cost))
        return int(candidates[np.argmin(cost[candidates])])
    if targets.eligible.any():
        left = np.flatnonzero(connected if connected.any() else targets.eligible)
        return int(left[np.argmax(nearest[left])])
    return None


def farthest(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Select the target farthest from any contact on its side.

    Farthest-first traversal: no placement of as few touches leaves gaps of less than half the size
    (Gonzalez 1985).
    """
    return _best(targets, targets.nearest)


def fastest(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Select the target that covers the most area per second of motion.

    A touch covers about the square of its distance to the nearest contact.
    """
    return _best(targets, targets.nearest**2 / targets.seconds)


def most_uncertain(
    targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator
) -> int | None:
    """Select the target with the greatest standard deviation of the estimate.

    With a Gaussian process this is the usual active learning rule of tactile exploration (Yi et al.
    2016; Jamali et al. 2016).
    """
    eligible = np.flatnonzero(targets.eligible)
    if not len(eligible):
        return None
    return int(eligible[np.argmax(surface.uncertainty(targets.points[eligible]))])


def uniform(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Select a target uniformly at random."""
    eligible = np.flatnonzero(targets.eligible)
    return int(rng.choice(eligible)) if len(eligible) else None


def _best(targets: Targets, score: np.ndarray) -> int | None:
    eligible = np.flatnonzero(targets.eligible)
    return int(eligible[np.argmax(score[eligible])]) if len(eligible) else None
