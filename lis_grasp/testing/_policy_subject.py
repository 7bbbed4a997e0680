"""The policy under test, and explorations of a block that it made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.workspace import STEP_FRACTION, Workspace
from lis_grasp.probing.ball_prober import BallProber
from lis_grasp.surfaces.estimators import ESTIMATORS
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.testing._known_surfaces import HALF
from lis_grasp.typing import FloatArray

PROBES = 20
"""Of an exploration."""

_SEED = 7
_TIP = 0.006  # radius of the ball [m]


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What a policy was told, and what it chose."""

    contacts: Contacts
    outcomes: tuple[ProbeOutcome, ...]
    seed: int
    chosen: Any


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class PolicySubject:
    """What makes a policy of a workspace, and its explorations."""

    made_by: Any

    def policy(self, space: Workspace) -> Policy:
        """Return a new policy."""
        policy: Policy = self.made_by(space)
        return policy

    @cached_property
    def on_table(self) -> list[Step]:
        """An exploration of a block on a table at the origin."""
        return self.explored(space_of(np.zeros(3)))

    def explored(self, space: Workspace) -> list[Step]:
        """Return the steps of an exploration of the block of `HALF` at the centre of a space."""
        steps: list[Step] = []
        policy = self.policy(space)
        prober, scale = prober_in(space), space.size / (2.0 * HALF.max())
        contacts, outcomes = Contacts.empty(), list[ProbeOutcome]()
        for seed in range(PROBES):
            chosen = ask(policy, contacts, tuple(outcomes), seed)
            steps.append(Step(contacts, tuple(outcomes), seed, chosen))
            if not isinstance(chosen, Probe):
                break
            outcome = prober.probe(chosen)
            outcomes.append(outcome)
            new = outcome.contacts
            if len(new) and not is_known(new, contacts, 1e-3 * scale):
                contacts = contacts.append(Contacts(new.points, new.normals))
        return steps


def space_of(center: FloatArray, *, scale: float = 1.0, table: bool = True) -> Workspace:
    """Return what is known of the block at a place [m], by default on a table."""
    size = float(scale * 2.0 * HALF.max())
    height = float(center[2] - scale * HALF[2]) if table else None
    return Workspace(STEP_FRACTION * size, center, size, height, tip_radius=scale * _TIP)


def prober_in(space: Workspace) -> BallProber:
    """Return the prober of the block in its space."""
    mesh = trimesh.creation.box(HALF / HALF.max() * space.size)
    mesh.apply_translation(space.center)
    return BallProber(mesh, radius=space.tip_radius, support_height=space.support_height)


def is_known(new: Contacts, contacts: Contacts, near: float) -> bool:
    """Return whether the first of new contacts is near one that is known [m]."""
    gaps = np.linalg.norm(contacts.points - new.points[0], axis=1)
    return bool((gaps < near).any())


def surface_of(contacts: Contacts) -> ImplicitSurface | None:
    """Return the estimate that a policy gets; None without contacts."""
    return ESTIMATORS["lis"](contacts) if len(contacts) else None


def ask(policy: Policy, contacts: Contacts, outcomes: Sequence[ProbeOutcome], seed: int) -> Any:
    """Return what a policy chooses, with a generator of its own."""
    rng = np.random.default_rng([_SEED, seed])
    return policy.next_probe(contacts, surface_of(contacts), outcomes=outcomes, rng=rng)


def same(first: Any, second: Any) -> bool:
    """Return whether two choices are the same probe, or both are none."""
    if not (isinstance(first, Probe) and isinstance(second, Probe)):
        return first is second
    return all(
        np.array_equal(getattr(first, name), getattr(second, name))
        for name in ("target", "direction", "standoff", "overshoot")
    )
