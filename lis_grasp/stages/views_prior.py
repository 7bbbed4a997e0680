"""Prior knowledge by depth cameras: what they saw of an object, corrected by its touches."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.prior import NOTHING, PriorKnowledge
from lis_grasp.records import Record, short_repr
from lis_grasp.surfaces.contact_preparation import MOST_CONTACTS
from lis_grasp.views import Views

# Seen contacts of an estimate are at least so many, however many touches there are.
_LEAST = 100


@dataclass(frozen=True, slots=True, eq=False)
class ViewsPrior(Record):
    """What cameras saw of an object, and what was touched before.

    The poses of the cameras are corrected by all touches, each time from the poses as given. So
    the same touches give the same knowledge, in whatever order an exploration was resumed.
    """

    views: Views
    touched: Contacts = field(default_factory=Contacts.empty)  #: judged with the touches

    __repr__ = short_repr

    def given(self, touches: Contacts) -> PriorKnowledge:
        """Return what is known beside some touches; see `Prior`."""
        return replace(_seen(self.views, self.touched.append(touches)), touched=self.touched)


@lru_cache(maxsize=8)
def _seen(views: Views, touches: Contacts) -> PriorKnowledge:
    """Return what the views show, given touches; nothing if these contradict them.

    Seen contacts are thinned to leave room for the touches, and for a wall below each, among the
    contacts that an estimator takes without thinning.
    """
    without_free = replace(touches, free_points=np.empty((0, 3)), free_radii=np.empty(0))
    corrected = _corrected(views, without_free)
    if corrected.is_dropped:
        return NOTHING
    guesses = corrected.guesses(touches)
    most = max(MOST_CONTACTS - 2 * len(touches) - len(guesses), _LEAST)
    return PriorKnowledge(seen=_thinned(corrected, most), guesses=guesses, free=(corrected.free,))


@lru_cache(maxsize=8)
def _corrected(views: Views, touches: Contacts) -> Views:
    """Return the views with corrected poses, which do not depend on free space."""
    return views.given(touches)


@lru_cache(maxsize=8)
def _thinned(views: Views, most: int) -> Contacts:
    return views.contacts(most)
