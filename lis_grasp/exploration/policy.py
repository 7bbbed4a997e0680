"""The role of whatever chooses what to touch next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.surfaces import ImplicitSurface


class Policy(Protocol):
    """Chooses the next probe from everything known; keeps no state of its own.

    Equal knowledge and an equal generator give an equal probe, so that an exploration can be
    repeated, or taken up again from its record.
    """

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe | None:
        """Return the next probe, or None where no other is worth making.

        Parameters
        ----------
        contacts
            Felt so far, in O; may be empty.
        surface
            Estimated from these contacts; None as long as there are none.
        outcomes
            Every probe so far and what came of it, in order.
        rng
            Decides between what is equally good.
        """
        ...
