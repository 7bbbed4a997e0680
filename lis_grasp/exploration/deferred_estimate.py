"""Deferred estimate: the surface that guides touches, with what is derived from it."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, TypeVar, cast

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.prior import NOTHING, PriorKnowledge, estimated_from
from lis_grasp.surfaces import ImplicitSurface, carved
from lis_grasp.surfaces.carved_implicit_surface import without
from lis_grasp.surfaces.implicit_surface import DeferredSurface

T = TypeVar("T")


class DeferredEstimate(DeferredSurface):
    """Surface that guides touches: estimated at the first use, and kept while few contacts come.

    Values derived from it, such as the free space of its contacts, are computed once.

    Parameters
    ----------
    make
        Estimates a surface from contacts; see `estimated_from`.
    contacts
        At least one, in O, with the free space known then; the prior's are the first.
    margin
        Reduction of the radii of free space [m].
    prior
        What was known beside the touches then.
    """

    def __init__(
        self,
        make: Callable[..., ImplicitSurface],
        contacts: Contacts,
        margin: float = 0.0,
        prior: PriorKnowledge = NOTHING,
    ) -> None:
        super().__init__(partial(estimated_from, make, contacts, prior))
        self.contacts, self.margin, self.prior = contacts, margin, prior
        self._derived: dict[str, tuple[Hashable, Any]] = {}

    @classmethod
    def of(cls, surface: ImplicitSurface, contacts: Contacts) -> DeferredEstimate:
        """Return the surface itself if it is deferred, else as the estimate of the contacts."""
        return (
            surface if isinstance(surface, DeferredEstimate) else cls(lambda _: surface, contacts)
        )

    def derived(self, name: str, key: Hashable, make: Callable[[], T]) -> T:
        """Return a value derived from the estimate; make it again only when its key changes."""
        if name not in self._derived or self._derived[name][0] != key:
            self._derived[name] = key, make()
        return cast(T, self._derived[name][1])

    @cached_property
    def _carved(self) -> ImplicitSurface:
        surface = carved(self.surface, self.contacts, margin=self.margin)
        return without(surface, *self.prior.free)

    def without_free_space(self, contacts: Contacts) -> ImplicitSurface:
        """Return the estimate without the free space of the contacts so far; see `carved`."""
        return carved(self._carved, self.later(contacts), margin=self.margin)

    def later(self, contacts: Contacts) -> Contacts:
        """Return the contacts so far, but only the free space found after the estimate."""
        known = len(self.contacts.free_points)
        return replace(
            contacts,
            free_points=contacts.free_points[known:],
            free_radii=contacts.free_radii[known:],
        )
