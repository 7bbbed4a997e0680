"""Which of the places that may be touched is touched next: one function for each idea."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from lis_grasp.exploration.targets import Targets
from lis_grasp.surfaces import ImplicitSurface

# The frontier lies about one step from the nearest contact; in units of the step.
_BAND = (0.8, 1.2)
# What makes one frontier target better than another, against being exactly a step away: to be near
# a second contact too, and not to be near a place just found empty.
_SECOND_CONTACT, _EMPTINESS = 0.25, 0.5
# Chance, so that explorations differ, in the choice among targets about as good; in steps.
_LUCK = 0.1


class Choice(Protocol):
    """Chooses one of the targets, by its index; None where none is worth a touch."""

    def __call__(
        self, targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator
    ) -> int | None:
        """Return the index of the target to touch, or None."""
        ...


def frontier(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Choose where the estimate leaves the known, about a step from any contact.

    Where no frontier is left, the largest gap is filled: the point farthest from any contact.
    Ottenhaus et al. 2016, section IV.B, give the step (50 mm on objects of 20 cm) and that the
    next target follows from the contacts and the estimated surface; the rest is ours.
    """
    nearest, step = targets.nearest, targets.step
    # What the estimate has farther away is unconnected to what is known: seldom true, so last.
    connected = targets.new & (nearest <= _BAND[1] * step)
    candidates = np.flatnonzero(connected & (nearest >= _BAND[0] * step))
    if len(candidates):
        cost = np.abs(nearest - step)
        cost += _SECOND_CONTACT * np.minimum(targets.second, 2.0 * step)
        cost -= _EMPTINESS * np.minimum(targets.emptiness, step)
        cost += _LUCK * step * rng.random(len(cost))
        return int(candidates[np.argmin(cost[candidates])])
    if targets.new.any():
        left = np.flatnonzero(connected if connected.any() else targets.new)
        return int(left[np.argmax(nearest[left])])
    return None


def spread(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Choose the place farthest from any contact on its side.

    Farthest-first traversal: no placing of as few touches leaves gaps of less than half the size
    (Gonzalez 1985).
    """
    new = np.flatnonzero(targets.new)
    return int(new[np.argmax(targets.nearest[new])]) if len(new) else None


def swift(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Choose what covers most in a second of motion: the square of `spread`'s gap over the time.

    A touch covers about as much area as the square of the gap that it is in the middle of.
    """
    new = np.flatnonzero(targets.new)
    if not len(new):
        return None
    return int(new[np.argmax(targets.nearest[new] ** 2 / targets.seconds[new])])


def anywhere(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Choose at random: every place of the estimated surface is as likely."""
    new = np.flatnonzero(targets.new)
    return int(rng.choice(new)) if len(new) else None


def most_uncertain(
    targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator
) -> int | None:
    """Choose where the estimate's own standard deviation is greatest.

    With a Gaussian process this is the rule of active learning that exploration by touch mostly
    uses (Yi et al. 2016; Jamali et al. 2016).
    """
    new = np.flatnonzero(targets.new)
    if not len(new):
        return None
    return int(new[np.argmax(surface.uncertainty(targets.points[new]))])
