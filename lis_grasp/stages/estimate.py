"""Estimate stage: the surface of an object from contacts, composed once for every caller.

    contacts -> judged -> and guesses -> estimator -> less free space -> above the table
        -> outside of other bodies

`SurfaceEstimate` has each of these parts, made at its first use.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    InvalidOptionError,
    TooManyBadContactsError,
    note,
    shown,
)
from lis_grasp.exploration import TactileSensor
from lis_grasp.exploration.prior import NOTHING, Prior, PriorKnowledge
from lis_grasp.guesses import advice_on_keyword
from lis_grasp.io.option import SPREAD
from lis_grasp.io.units import LARGEST
from lis_grasp.meshing import extract_mesh
from lis_grasp.plugins import qualified_name
from lis_grasp.records import Record
from lis_grasp.stages.views_prior import ViewsPrior
from lis_grasp.surfaces import ContactVerdicts, Estimator, ImplicitSurface, judge_contacts
from lis_grasp.surfaces.carved_implicit_surface import (
    above_table,
    carved,
    outside_bodies,
    walls_down_to,
    without,
)
from lis_grasp.surfaces.contact_checks import (
    NormalSide,
    doubt_of_low_table,
    doubt_of_side,
    doubt_of_table,
    require_table_below,
    turned_outward,
)
from lis_grasp.surfaces.contact_loading import ContactSource, load_contacts
from lis_grasp.surfaces.estimators import (
    ESTIMATORS,
    accepted_options,
    few_contacts,
    find_estimator,
    maker_of,
    require_noise_below_size,
    require_signs,
)
from lis_grasp.surfaces.least_uncertainty import LeastUncertainty
from lis_grasp.surfaces.measured_extents import measured_extents
from lis_grasp.task.decide import Decide
from lis_grasp.task.robot import Robot
from lis_grasp.typing import FloatArray
from lis_grasp.views import Views
from lis_grasp.world import KnownBodies

# The unseen side of a seen object is within this fraction of the size of what is known.
_UNSEEN = 0.25
# Below a table, so that its mesh is closed there and not by the bounds [m].
_BELOW = 0.002


@dataclass(frozen=True, eq=False, kw_only=True)  # no slots: for cached_property
class Perception:
    """The settings of an estimate from contacts.

    Examples
    --------
    >>> pipeline.Perception(estimator="gpis").free_space
    True
    """

    estimator: str | Estimator = "blend"  #: a name, or called with the contacts alone
    sensor: TactileSensor = field(default_factory=TactileSensor)  #: the estimator knows its noise
    free_space: bool = True  #: whether the contacts' free space is removed from the estimate
    keep_all: bool = False  #: whether contacts that the others contradict are believed
    support_height: float | None = None  #: of a table that closes the estimate from below [m]
    margin: float | None = None  #: by which free space shrinks [m]; None for the sensor's
    options: Mapping[str, Any] = field(default_factory=dict)  #: further keywords of the estimator
    normals: NormalSide | None = None  #: side to which normals point; None requires outward ones
    prior: Prior = NOTHING  #: known beside the contacts, such as views
    bodies: KnownBodies | None = None  #: beside the object, in the frame of the contacts

    @classmethod
    def of(
        cls,
        robot: Robot,
        decide: Decide,
        support_height: float | None,
        bodies: KnownBodies | None = None,
    ) -> Perception:
        """Return a robot's settings for an object on a table at a height [m], or without a table.

        Its contacts are simulated, or were checked when they were read: normals are outward.
        """
        return cls(
            estimator=decide.estimator,
            sensor=robot.sensor,
            free_space=decide.free_space,
            keep_all=decide.keep_all,
            support_height=support_height,
            normals="outward",
            bodies=bodies,
        )

    @cached_property
    def make(self) -> Estimator:
        """The estimator, given the sensor's noise.

        It estimates a noise of 0 from the contacts, or keeps its own default. An estimator that is
        not a name gets the further options only.
        """
        sensor, noise = self.sensor, dict(self.options)
        if not isinstance(self.estimator, str):
            make = maker_of(self.estimator, qualified_name(self.estimator))
            return partial(make, **noise) if noise else make
        known = {"position_noise": sensor.position_noise, "normal_noise": sensor.normal_noise}
        noise |= {kind: value for kind, value in known.items() if value}
        return partial(find_estimator(self.estimator), **noise)

    @property
    def noise(self) -> dict[str, float | None]:
        """Noise of contacts that do not carry their own, by the names of options; None: unknown."""
        return {
            name: self.options.get(name, getattr(self.sensor, name)) or None
            for name in ("position_noise", "normal_noise")
        }

    def judge(self, contacts: Contacts) -> ContactVerdicts:
        """Return the verdicts on contacts, given the sensor's noise; `keep_all` makes all sound."""
        return judge_contacts(
            replace(contacts, judged=True) if self.keep_all else contacts, **self.noise
        )


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class SurfaceEstimate(Record):
    """The estimate of at least one contact, or of a view; each part is made at its first use.

    Errors of a part are `EstimationError` and `InvalidContactsError`: no surface can be estimated
    from the contacts.

    Examples
    --------
    >>> estimate = pipeline.SurfaceEstimate(contacts, pipeline.Perception(estimator="gpis"))
    >>> estimate.mesh.is_watertight
    True
    """

    contacts: Contacts  #: in O, as touched
    perception: Perception = field(default_factory=Perception)

    @cached_property
    def outward(self) -> Contacts:
        """The contacts with normals that point out of the object."""
        return turned_outward(self.contacts, self.perception.normals)

    @cached_property
    def verdicts(self) -> ContactVerdicts:
        """The verdict on each contact, by touch alone: what was seen is no evidence against it."""
        return self.perception.judge(self.outward)

    @cached_property
    def credible(self) -> Contacts:
        """The contacts to estimate from, without those that were seen or guessed."""
        return self.verdicts.credible if len(self.contacts) else self.contacts

    @cached_property
    def given(self) -> PriorKnowledge:
        """What is known beside the contacts."""
        return self.perception.prior.given(self.contacts)

    @property
    def measured(self) -> Contacts:
        """What was seen, then the contacts."""
        return self.given.seen.append(self.contacts)

    @cached_property
    def guesses(self) -> Contacts:
        """Contacts that the table and the views imply; never measured ones."""
        height = self.perception.support_height
        walls = Contacts.empty() if height is None else walls_down_to(height, self.credible)
        return walls.append(self.given.guesses)

    @cached_property
    def solid(self) -> ImplicitSurface:
        """The surface before free space and what is below the table are removed."""
        return self._made(self.credible, self.guesses)

    @cached_property
    def guide(self) -> ImplicitSurface:
        """The surface that guides touches, which continue: of all contacts if too many are bad.

        Neither free space nor the table is part of it.
        """
        try:
            contacts = self.credible
        except TooManyBadContactsError:
            contacts = replace(self.outward, judged=True)
        return self._made(contacts, self.given.guesses)

    def _made(self, contacts: Contacts, guesses: Contacts) -> ImplicitSurface:
        """Return the surface of contacts with their verdict, what was seen, and guesses."""
        make, seen = self.perception.make, self.given.seen
        if not len(seen):
            return self._checked(make(contacts.append(guesses)), contacts)
        touched, implied, seen = (replace(c, judged=True) for c in (contacts, guesses, seen))
        surface = self._checked(make(touched.append(implied).append(seen)), touched)
        return LeastUncertainty(surface, touched.append(seen))

    def _checked(self, surface: ImplicitSurface, contacts: Contacts) -> ImplicitSurface:
        """Return a surface; raise `InvalidOptionError` if that of a function is inside out.

        Those of names are checked as they are made.
        """
        make = self.perception.estimator
        if not isinstance(make, str) and make not in ESTIMATORS.values():
            require_signs(surface, contacts, getattr(make, "__qualname__", str(make)))
        return surface

    @cached_property
    def surface(self) -> ImplicitSurface:
        """The surface, without free space and above the table."""
        known, surface = self.perception, self.solid
        if known.free_space:
            margin = known.sensor.free_margin if known.margin is None else known.margin
            if len(self.credible):
                surface = carved(surface, self.credible, margin=margin)
            measured = self.credible.append(self.given.seen)
            ends = measured_extents(self.solid, measured, **known.noise)
            surface = without(surface, *self.given.free, *ends)
        surface, bodies = above_table(surface, known.support_height), known.bodies
        return surface if bodies is None else outside_bodies(surface, bodies.distances, bodies.band)

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """The closed mesh of the surface, with the uncertainty of each vertex [m]."""
        return extract_mesh(self.surface, touched=self.measured.points, bounds=self.bounds)

    @property
    def bounds(self) -> FloatArray:
        """Box that contains the object, shape (2, 3) [m]: of a seen one, with its unseen side."""
        box, height = self.surface.bounds, self.perception.support_height
        if len(self.given.seen):
            size = float(np.ptp(box, axis=0).max())
            box = box + _UNSEEN * size * np.array([[-1.0], [1.0]])
            if height is not None:
                box[0, 2] = max(box[0, 2], height - _BELOW)
        return box


def estimate(
    contacts: Contacts | ContactSource,
    estimator: str | Estimator = "blend",
    *,
    support_height: float | None = None,
    free_space: bool = True,
    keep_all: bool = False,
    **options: Any,
) -> ImplicitSurface:
    """Estimate the surface of an object from contacts.

    The surface equals that of ``lis-grasp estimate``, of a run, and of `lis_grasp.drake`.

    Parameters
    ----------
    contacts
        Contacts of one object, in its frame O, or what `load_contacts` reads.
    estimator
        "blend", "smooth", "gpis", "lis", "patch", or a plug-in: its name, ``my.module:Class``,
        or a function of contacts.
    support_height
        Height of the table on which the object stands [m]; None for none. It closes the estimate
        from below, and walls that were touched near it continue down to it.
    free_space
        Whether the contacts' free space is removed from the estimate.
    keep_all
        Whether to believe all contacts, including contradicted ones.
    options
        ``views``, depth views of the object on the table, each a `DepthView` with a mask: then
        there may be no contact; ``margin``, by which balls of free space shrink [m]; ``normals``,
        the side to which they point, as in `load_contacts`: without it they must be outward; and
        the keywords of the estimator's `from_contacts`, such as ``position_noise`` [m] and
        ``normal_noise`` [rad].

    Raises
    ------
    InvalidOptionError
        If there is no such estimator, or an option is out of range.
    EstimationError, InvalidContactsError
        If no surface can be estimated from the contacts, or their normals point inward.

    Examples
    --------
    >>> surface = estimate(contacts, "gpis")
    >>> bool(abs(surface.evaluate([0.0, 0.0, 0.03])) < 1e-6)  # the surface is where this is 0
    True
    """
    normals, views = options.pop("normals", None), tuple(options.pop("views", ()))
    if not isinstance(contacts, Contacts):
        contacts = load_contacts(contacts, normals=normals)
    height, margin = options.pop("table", support_height), options.pop("margin", 0.0)
    if views and height is None:
        message = "views are of an object on a table: give its height, support_height"
        raise InvalidOptionError(message, option="support_height")
    if not isinstance(estimator, str) and not callable(estimator):
        message = (
            f"estimator must be a name or a function of contacts; it is {shown(estimator)}: points"
            " and their normals are the first argument together, estimate((points, normals))"
        )
        raise InvalidOptionError(message, option="estimator", value=estimator)
    if isinstance(estimator, str):
        make = find_estimator(estimator)
    else:
        make = maker_of(estimator, qualified_name(estimator))
    _require_accepted(make, str(estimator), options)
    require_noise_below_size(contacts, options.get("position_noise"))
    if isinstance(spread := options.get("normal_noise"), int | float):
        SPREAD("normal_noise", spread)
    if not views:
        note_doubts(contacts, height)
    if normals is None and (doubt := doubt_of_side(contacts)):
        note(doubt)
    known = Perception(
        estimator=make,
        free_space=free_space,
        keep_all=keep_all,
        support_height=height,
        margin=margin,
        options=options,
        normals=normals,
        prior=ViewsPrior(Views(views, height)) if views and height is not None else NOTHING,
    )
    return SurfaceEstimate(contacts, known).surface


def note_doubts(contacts: Contacts, support_height: float | None = None) -> None:
    """Warn of contacts that are not in metres, too few, or far above or below the table [m].

    Raises `InvalidOptionError` if all are below it.
    """
    if len(contacts):
        require_table_below(support_height, float(contacts.bounds[1, 2]), "contacts")
    if contacts.extent > LARGEST:
        note(f"contacts are in metres, and these are {contacts.extent:.3g} m apart: check the unit")
    few = few_contacts(contacts)
    low = "" if few else doubt_of_low_table(contacts, support_height)
    for doubt in filter(None, (few, low, doubt_of_table(contacts, support_height))):
        note(doubt)


def _require_accepted(make: Callable[..., Any], name: str, options: Mapping[str, Any]) -> None:
    """Raise `TypeError` for the first option that an estimator has no keyword for."""
    for option in sorted(options.keys() - accepted_options(make, options).keys()):
        accepted = {*inspect.signature(make).parameters, *inspect.signature(estimate).parameters}
        accepted -= {"contacts", "options"}
        end = advice_on_keyword(option, accepted)
        raise TypeError(f"estimate with {name} has no option '{option}'{end}")
