"""Prior knowledge of an object beside its touches: what was seen, guessed, and found to be free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, runtime_checkable

from lis_grasp.contacts import Contacts
from lis_grasp.records import Record, short_repr
from lis_grasp.surfaces import FreeSpace, ImplicitSurface


@dataclass(frozen=True, slots=True, eq=False)
class PriorKnowledge(Record):
    """What is known of an object beside its touches, in their frame.

    Examples
    --------
    >>> PriorKnowledge(touched=contacts).contacts == contacts
    True
    """

    #: by touches or any sensor of the same kind, such as a point cloud: judged with the touches
    touched: Contacts = field(default_factory=Contacts.empty)
    seen: Contacts = field(default_factory=Contacts.empty)  #: by cameras: no evidence against touch
    #: likely contacts where nothing was seen, for estimates only: the surface there is not known
    guesses: Contacts = field(default_factory=Contacts.empty)
    free: tuple[FreeSpace, ...] = ()  #: seen to be free

    __repr__ = short_repr

    @property
    def contacts(self) -> Contacts:
        """What was measured: seen, then touched; touches go where both are missing."""
        return self.seen.append(self.touched)

    def given(self, touches: Contacts) -> PriorKnowledge:
        """Return the same knowledge: it does not depend on touches."""
        return self


@runtime_checkable
class Prior(Protocol):
    """Prior knowledge that may depend on the touches, as the pose of a camera does."""

    def given(self, touches: Contacts) -> PriorKnowledge:
        """Return what is known beside some touches; a pure function of these."""
        ...


NOTHING = PriorKnowledge()
"""No prior knowledge."""


def as_prior(prior: Prior | Contacts | None) -> Prior:
    """Return prior knowledge; contacts are judged with the touches, as those of a point cloud."""
    if prior is None:
        return NOTHING
    return PriorKnowledge(touched=prior) if isinstance(prior, Contacts) else prior


def with_touched(prior: Any, touched: Contacts) -> Any:
    """Return prior knowledge with these touched contacts in place of its own."""
    return replace(prior, touched=touched)


def estimated_from(
    make: Callable[..., ImplicitSurface], contacts: Contacts, prior: PriorKnowledge
) -> ImplicitSurface:
    """Estimate the surface of all measured contacts, of which the first are the prior's.

    An estimator is called with the contacts alone, unless some were seen or guessed: then with
    those that were not seen, and ``prior``.
    """
    if not len(prior.seen) and not len(prior.guesses):
        return make(contacts)
    return make(contacts[len(prior.seen) :], prior=prior)
