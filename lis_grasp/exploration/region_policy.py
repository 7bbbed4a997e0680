"""Policy of an object in a region: search, then touch around the first contact, then any policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.probe_motions import AXES, SAME_DIRECTION
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.search import search_probe
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface

# Directions of the probes around the first contact: all but from below the table.
_OPENING = np.array([axis for axis in AXES if axis[2] <= 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class RegionPolicy:
    """Find an object in a region, and explore it in the workspace that its contacts show.

    Until the first contact, it searches (`search_probe`). Then it touches the object from the
    other sides and from above, which shows its size. After that, a policy for the workspace of the
    contacts so far chooses.

    Parameters
    ----------
    region
        What is known before the first touch.
    make
        Makes the policy of a workspace.
    """

    region: Region
    make: Callable[[Workspace], Policy]

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe | None:
        """Return the next probe, or None if the object is nowhere; see `Policy`."""
        if not len(contacts):
            return search_probe(self.region, outcomes, rng=rng)
        space = self.region.grown(contacts)
        since = _since_first_contact(outcomes)
        if len(contacts) <= sum(len(outcome.contacts) for outcome in since):  # none of a camera
            opening = _opening_probe(space, since)
            if opening is not None:
                return opening
        return self.make(space).next_probe(contacts, surface, outcomes=outcomes, rng=rng)


def _since_first_contact(outcomes: Sequence[ProbeOutcome]) -> Sequence[ProbeOutcome]:
    first = next((k for k, outcome in enumerate(outcomes) if len(outcome.contacts)), None)
    return () if first is None else outcomes[first:]


def _opening_probe(space: Workspace, since: Sequence[ProbeOutcome]) -> Probe | None:
    """Return a probe along an axis through the centre, from the least probed side, or None."""
    probed = np.array([outcome.probe.direction for outcome in since])
    nearest = (_OPENING @ probed.T).max(axis=1)  # cosine to the most similar direction
    left = nearest <= SAME_DIRECTION
    if len(since) > len(_OPENING) or not left.any():
        return None
    direction = _OPENING[int(np.argmin(nearest))]
    target = space.center.copy()
    if any(outcome.status == "missed" for outcome in since):
        target[2] = min(target[2], space.level_height)  # a thin tip passed over a low object
    return Probe(target, direction, 0.6 * space.size + 0.5 * space.step, 0.25 * space.size)
