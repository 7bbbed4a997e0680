"""What cameras saw of one object: calibrated with touches, and thinned together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidViewError
from lis_grasp.geometry import unit
from lis_grasp.records import Record
from lis_grasp.surfaces import FreeSpace
from lis_grasp.surfaces.contact_preparation import thin_contacts
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.views.depth_view import DepthView
from lis_grasp.views.hand_eye import Calibration, Sight, calibrate
from lis_grasp.views.lower_half import lower_half

# An implied contact deeper in seen free space is wrong [m]; free space ends so many deviations of
# the place of what is seen before it.
_CLEARLY_FREE, _DEVIATIONS = 0.004, 3.0
# A touch contradicts what a contour implies within this distance [m], on this side, this far off
# [m], or if a finger passed there, by [m].
_NEAR, _PARALLEL, _OFF, _PASSED = 0.03, 0.3, 0.008, 0.002
# A mirror image says more of the surface this near than a contour [m].
_SAID_BY_IMAGE = 0.012


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Views(Record):
    """What cameras saw of one object on a table.

    The views have the poses of their cameras as given. `given` corrects them by the table and by
    touches: contacts, guesses and free space follow the corrected poses.

    Parameters
    ----------
    views
        Each with a mask.
    support_height
        Height of the table in W [m].

    Examples
    --------
    Contacts for an estimator, after some touches:

    ```
    seen = Views((view,), support_height=0.0).given(touches)
    contacts = touches + seen.contacts(400 - len(touches)) + seen.guesses(touches)
    ```
    """

    views: tuple[DepthView, ...]
    support_height: float
    calibrations: tuple[Calibration, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "views", tuple(self.views))
        for view in self.views:
            if view.mask is None:
                raise InvalidViewError(
                    "each of the views needs the mask of the object: segment_object(view,"
                    " support_height) finds it above the table",
                    field="mask",
                )
        if not self.calibrations:
            of = [
                Calibration(view.X_WC, np.diag(view.hand_eye.deviations**2)) for view in self.views
            ]
            object.__setattr__(self, "calibrations", tuple(of))

    def given(self, touches: Contacts) -> Views:
        """Return the views with poses corrected by the table and by touches, in W.

        It starts from the poses as given: the same touches have the same result, however often.
        Views that touches contradict are dropped (`is_dropped`).
        """
        calibrations = tuple(
            calibrate(view, sight, touches, self.support_height)
            for view, sight in zip(self.views, self._sights, strict=True)
        )
        corrected = replace(self, calibrations=calibrations)
        corrected.__dict__["_sights"] = self._sights  # they depend on the views as given only
        return corrected

    @cached_property
    def _sights(self) -> tuple[Sight, ...]:
        return tuple(Sight.of(view, self.support_height) for view in self.views)

    @property
    def is_dropped(self) -> bool:
        """Whether touches contradict all views: then they show nothing; see `reason`."""
        return bool(self.views) and not len(self.believed)

    @property
    def reason(self) -> str:
        """Why views are dropped; empty if none is."""
        texts = [
            f"touches contradict camera {k} ({c.contradicting} of {c.touches}): its pose is"
            " wrong, or the object was moved"
            for k, c in enumerate(self.calibrations)
            if c.is_refuted
        ]
        return "; ".join(texts)

    @cached_property
    def believed(self) -> tuple[tuple[DepthView, Calibration], ...]:
        """The corrected views that touches do not contradict, and their calibrations."""
        pairs = zip(self.corrected, self.calibrations, strict=True)
        return tuple((view, c) for view, c in pairs if not c.is_refuted)

    @cached_property
    def corrected(self) -> tuple[DepthView, ...]:
        """The views with the poses that `given` estimated."""
        return tuple(
            view if np.array_equal(view.X_WC, c.X_WC) else view.posed(c.X_WC)
            for view, c in zip(self.views, self.calibrations, strict=True)
        )

    @property
    def posterior(self) -> FloatArray:
        """Covariance (6, 6) of the first camera's pose: rotation [rad] and translation [m] in C."""
        return self.calibrations[0].covariance

    @cached_property
    def displacement(self) -> float:
        """Standard deviation of the place of the seen surface [m], the largest of all views."""
        return max(
            (c.displacement(v.contacts.points) for v, c in self.believed if len(v.contacts)),
            default=0.0,
        )

    def contacts(self, most: int) -> Contacts:
        """Return at most `most` contacts of all views together, thinned by positions and normals.

        Their noise is that of single pixels' planes, because neighbouring pixels have a common
        error, with the uncertainty of the camera's pose along each normal.
        """
        if most < 1:
            return Contacts.empty()
        parts = [
            _with_pose_noise(view.contacts, calibration) for view, calibration in self.believed
        ]
        together = sum(parts, Contacts.empty())
        if len(together) <= most:
            return together
        means = thin_contacts(together, most)
        _, near = cKDTree(together.points).query(means.points)
        assert together.position_noise is not None
        assert together.normal_noise is not None
        return replace(
            means,
            position_noise=together.position_noise[near],
            normal_noise=together.normal_noise[near],
        )

    def guesses(self, touches: Contacts) -> Contacts:
        """Return what views and touches imply of unseen surface, less what touches contradict.

        That is what the contours imply, and the lower half of an object that is alike above and
        below (`lower_half`). They are no measurements: an estimator takes them as weak contacts,
        and nothing saves them.
        """
        implied, images = self._implied, self._lower_half(touches)
        if len(images):
            away, _ = cKDTree(images.points).query(implied.points)
            implied = implied.subset(away > _SAID_BY_IMAGE).append(images)
        return implied.subset(~_contradicted(implied, touches))

    def _lower_half(self, touches: Contacts) -> Contacts:
        """Return the mirror images of what is seen and touched, where nothing is seen."""
        views = tuple(view for view, _ in self.believed)
        seen = sum((view.contacts for view in views), Contacts.empty())
        eyes = np.array([view.X_WC[:3, 3] for view in views]).reshape(-1, 3)
        # An error of a camera's pose moves seen surface and free space alike: no margin for it.
        return lower_half(seen, touches, eyes, FreeViews(views, 0.0), self.support_height)

    @cached_property
    def _implied(self) -> Contacts:
        """What the contours imply, where no view shows free space."""
        parts = [view.guesses(self.support_height) for view, _ in self.believed]
        implied = sum(parts, Contacts.empty())
        if not len(implied):
            return implied
        seen_free, _ = self.free.depths(implied.points)
        return implied.subset(seen_free < _CLEARLY_FREE)

    @cached_property
    def free(self) -> FreeViews:
        """The space that any of the views shows to be free."""
        return FreeViews(tuple(view for view, _ in self.believed), self.displacement)


@dataclass(frozen=True, slots=True, eq=False)
class FreeViews(FreeSpace, Record):
    """Space that any of several views shows to be free, by a margin for their displacement."""

    views: tuple[DepthView, ...]
    displacement: float  #: standard deviation of the place of what is seen [m]

    def depths(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return depths (P,) [m] in free space, -inf where nothing is known, and slopes (P, 3)."""
        rows = np.asarray(points, np.float64)
        deepest, slopes = np.full(len(rows), -np.inf), np.zeros((len(rows), 3))
        for view in self.views:
            depths, gradients = view.depths(rows)
            deeper = depths > deepest
            deepest[deeper], slopes[deeper] = depths[deeper], gradients[deeper]
        return deepest - _DEVIATIONS * self.displacement, slopes


def _with_pose_noise(contacts: Contacts, calibration: Calibration) -> Contacts:
    if not len(contacts) or not calibration.covariance.any():
        return contacts
    covariance = calibration.displacement_covariance(contacts.points)
    along = np.einsum("ni,nij,nj->n", contacts.normals, covariance, contacts.normals)
    assert contacts.position_noise is not None
    return replace(contacts, position_noise=np.sqrt(contacts.position_noise**2 + along))


def _contradicted(implied: Contacts, touches: Contacts) -> BoolArray:
    """Return which implied contacts touches contradict, (N,)."""
    wrong = np.zeros(len(implied), dtype=bool)
    if len(touches):
        offsets = implied.points[:, None] - touches.points
        near = np.linalg.norm(offsets, axis=2) < _NEAR
        near &= implied.normals @ touches.normals.T > _PARALLEL
        # Across the chord of a circle through both: a surface may curve between them.
        across = unit(implied.normals[:, None] + touches.normals, least=_PARALLEL)
        off = np.abs(np.einsum("wtk,wtk->wt", offsets, across)) > _OFF
        wrong |= (near & off).any(axis=1)
    if len(touches.free_points):
        away = np.linalg.norm(implied.points[:, None] - touches.free_points, axis=2)
        wrong |= (away < touches.free_radii - _PASSED).any(axis=1)
    return wrong
