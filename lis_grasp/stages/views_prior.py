"""Prior knowledge by depth cameras: what they saw of an object, corrected by its touches."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

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
    corrected = views.given(touches)
    if corrected.is_dropped:
        return NOTHING
    guesses = corrected.guesses(touches)
    most = max(MOST_CONTACTS - 2 * len(touches) - len(guesses), _LEAST)
    return PriorKnowledge(seen=corrected.contacts(most), guesses=guesses, free=(corrected.free,))
