"""Preparation of contacts for every estimator: distinct, each of known noise, and not too many."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist
from trimesh.graph import connected_component_labels

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import TooManyBadContactsError
from lis_grasp.geometry import unit
from lis_grasp.surfaces._contact_noise import (
    filled,
    likeliest_noise,
    noise_of,
    noise_of_means,
    precisions_of,
)
from lis_grasp.surfaces._contradictions import FLIPPED, SOUND, find_contradictions
from lis_grasp.surfaces.contact_places import (
    ContactPlaces,
    box_of,
    farthest_point_order,
    resolution_of,
    spacing_of,
)
from lis_grasp.surfaces.queries import require_contacts
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

MOST_CONTACTS = 400
"""More contacts are thinned by default: the time of estimates grows with the cube of their number.
"""

# More bad contacts than this fraction leave unknown what is true.
_MOST_BAD = 0.25

# Contacts this close (of the contacts' extent) whose normals agree this well are one contact.
_SAME_PLACE = 1e-3
_SAME_NORMAL = np.cos(np.deg2rad(15.0))

# A fingertip was outside so far before its contact, in extents.
_BEFORE = 1e-3

# Two touches of one place are rarely more than this many standard deviations of a position apart.
_NOISE_REACH = 6.0

# Normals that differ by this much are as far apart as contacts one cell apart.
_NORMAL_CELL = 0.5

# A more precise contact is a cell of its own at this fraction of the distance at most.
_MOST_PRECISE = 4.0

# Contacts whose normals are further apart than this from the cell's mean are not on one plane.
_LEAST_COSINE = 0.3


@dataclass(frozen=True, eq=False)
class PreparedContacts:
    """Contacts as estimators use them, and what follows from them. Made by `prepare_contacts`."""

    contacts: Contacts  # N distinct ones, in O
    position_noise: FloatArray  # (N,) [m], one standard deviation along the normal
    normal_noise: FloatArray  # (N,) [rad], one of each component of the normal
    estimated: BoolArray  # (2, N): whether the noise of positions, of normals is an estimate

    @cached_property
    def spacing(self) -> float:
        """Median distance between neighbouring contacts [m], or a default for a lone place."""
        return spacing_of(self.contacts)

    @cached_property
    def scale(self) -> float:
        """Largest distance between two contacts [m]; the spacing of a lone place."""
        largest = float(pdist(self.contacts.points).max(initial=0.0))
        return largest if largest > resolution_of(self.contacts) else self.spacing

    @cached_property
    def bounds(self) -> FloatArray:
        """The box in which estimates are valid, shape (2, 3) [m]."""
        return box_of(self.contacts, self.places)

    @cached_property
    def places(self) -> ContactPlaces:
        """Contacts that cover the touched surface evenly."""
        return ContactPlaces.of(self.contacts.points)

    def with_noise(self, position: FloatArray, normal: FloatArray) -> PreparedContacts:
        """Return the same contacts with other noise, (N,) [m] and (N,) [rad]."""
        return replace(self, position_noise=position, normal_noise=normal)

    def thinned(self, most: int) -> PreparedContacts:
        """Return at most `most` local averages of the contacts, see `thin_contacts`."""
        if len(self.contacts) <= most:
            return self
        contacts = replace(
            self.contacts, position_noise=self.position_noise, normal_noise=self.normal_noise
        )
        group = _cells(contacts, most)
        means = _surface_means(contacts, group)
        estimated = np.stack([np.bincount(group, row) > 0.0 for row in self.estimated])
        return PreparedContacts(means, *_noise(means), estimated)


def prepare_contacts(
    contacts: Contacts | PreparedContacts,
    position_noise: float | None = None,
    normal_noise: float | None = None,
    *,
    most: int | None = MOST_CONTACTS,
) -> PreparedContacts:
    """Prepare contacts, at least one, for an estimator.

    Parameters
    ----------
    contacts
        Measured on the object. Repeated ones become one (`merge_duplicates`). Those that the others
        contradict are turned or left out, unless `Contacts.judged` (see `judge_contacts`). Prepared
        contacts are returned as they are.
    position_noise, normal_noise
        One standard deviation along the normal [m] and of each component of the normal [rad], for
        contacts whose own noise is unknown. None estimates it from these contacts
        (`estimate_noise`); it is 0 where they do not determine it.
    most
        Contacts beyond this number are thinned to local averages (`thin_contacts`); None for no
        thinning.

    Raises
    ------
    InvalidContactsError
        If there is no contact.
    InvalidOptionError
        If a noise is out of range.
    TooManyBadContactsError
        If more than a quarter of the contacts is bad.
    """
    if isinstance(contacts, PreparedContacts):
        return contacts
    merged = merge_duplicates(contacts, position_noise, normal_noise)
    unknown = np.isnan(_noise(merged))
    position, normal = np.nan_to_num(_noise(with_noise(merged)))
    if not contacts.judged:
        codes, _ = find_contradictions(in_free_space_of(contacts, merged), position, normal)
        if np.any(codes != SOUND):
            credible = repaired(merged, codes)
            return prepare_contacts(credible, position_noise, normal_noise, most=most)
    prepared = PreparedContacts(merged, position, normal, unknown)
    return prepared if most is None else prepared.thinned(most)


def repaired(contacts: Contacts, codes: IndexArray) -> Contacts:
    """Return the credible contacts (`ContactVerdicts.credible`), by codes of verdicts (N,)."""
    bad = int(np.count_nonzero(codes != SOUND))
    if bad > _MOST_BAD * len(contacts):
        raise TooManyBadContactsError(
            f"{bad} of {len(contacts)} contacts contradict the others, too many to know which are"
            " true: if the signs of normals are unknown, load them with `normals` unsigned or the"
            " place of the sensor, `viewpoint` X Y Z (lis-grasp estimate, load_contacts); if all"
            " contacts are right, `keep_all` believes them",
            bad=bad,
            count=len(contacts),
        )
    signs = np.where(codes == FLIPPED, -1.0, 1.0)[:, None]
    turned = replace(contacts, normals=signs * contacts.normals, judged=True)
    return turned if not bad else turned.subset((codes == SOUND) | (codes == FLIPPED))


def in_free_space_of(contacts: Contacts, merged: Contacts) -> Contacts:
    """Return merged contacts with the free space of the original contacts."""
    free = contacts.free_points, contacts.free_radii
    return replace(merged, free_points=free[0], free_radii=free[1])


def with_approach(contacts: Contacts, approach: FloatArray) -> Contacts:
    """Return contacts with free space where the fingertip was just before each of them.

    `approach` (N, 3) are the directions of its motion, of any length, 0 where unknown. The free
    points are evidence for the sides of normals (`judge_contacts`, `orient_normals`).
    """
    lengths = np.linalg.norm(approach, axis=1)
    known = np.flatnonzero(lengths > 0.0)
    back = _BEFORE * contacts.extent / lengths[known, None] * approach[known]
    return replace(
        contacts,
        free_points=np.vstack([contacts.free_points, contacts.points[known] - back]),
        free_radii=np.concatenate([contacts.free_radii, np.zeros(len(known))]),
    )


def with_noise(
    contacts: Contacts, position_noise: float | None = None, normal_noise: float | None = None
) -> Contacts:
    """Return contacts with the noise of each: its own, else what is given, else the estimate.

    It stays unknown where the contacts do not determine it. Those of unknown noise are assumed to
    come from one sensor.
    """
    position, normal = noise_of(contacts, position_noise, normal_noise)
    unknown = np.isnan(position) | np.isnan(normal)
    if unknown.any():
        estimates = estimate_noise(contacts.subset(unknown))
        position = filled(position, estimates[0], len(contacts))
        normal = filled(normal, estimates[1], len(contacts))
    return replace(contacts, position_noise=position, normal_noise=normal)


def estimate_noise(contacts: Contacts) -> tuple[float, float]:
    """Return the standard deviations of positions [m] and normals [rad] of a set of contacts.

    Around each contact a quadric h + n.d + d'Qd / 2 explains the heights and normals of up to six
    neighbours on the same smooth patch. h and n have the noise as prior, Q a broad one; they are
    integrated out (Bayesian linear regression). The noise maximises the product of the marginal
    likelihoods (composite likelihood), in which each quadric is a mixture of departures of
    surfaces from quadrics: an edge among the neighbours says little about noise.

    Positions have noise along the normal, normals in each component perpendicular to it. Exact
    repetitions count once. Where quadrics do not resolve the shape, its departure from them would
    count as noise: a smooth surface through up to 100 contacts may show that there is less. The
    noise of positions is uncertain where the noise of normals, times the contacts' spacing, is ten
    times larger. Both are NaN if fewer than six contacts have four neighbours on their patch: so
    few contacts do not determine the noise.
    """
    return likeliest_noise(_drop_repetitions(contacts))


def merge_duplicates(
    contacts: Contacts, position_noise: float | None = None, normal_noise: float | None = None
) -> Contacts:
    """Replace repeated contacts of one place by their mean, in order of each place's first contact.

    Between two touches of one place the angle of eq. 11 (Ottenhaus et al. 2016) is meaningless, and
    eq. 9 gives both together the weight of one. Contacts at one place with different normals (the
    two faces of a corner) stay separate. An exact repetition, in point and normal, is the same
    measurement again and counts once. Only points, normals and noise are kept.

    Noise, one standard deviation of positions [m] and normals [rad], is each contact's own, or what
    is given. It weights the means by inverse variances, and the means carry theirs. It also moves
    repeated contacts apart: where the spacing is no more than noise explains, contacts within the
    noise are merged too, if that leaves places that are clearly farther apart.
    """
    require_contacts(contacts)
    distinct = _drop_repetitions(contacts)
    position, normal = noise_of(distinct, position_noise, normal_noise)
    known = Contacts(
        distinct.points, distinct.normals, position_noise=position, normal_noise=normal
    )
    merged = _merged(known, max(_SAME_PLACE * known.extent, resolution_of(known)))
    if known.position_noise is None:
        return merged
    reaches = _NOISE_REACH * np.nan_to_num(known.position_noise)  # (N,)
    reach = float(np.median(reaches))
    if len(merged) < 2 or not merged.spacing < reach < np.inf:
        return merged
    places = _merged(known, reaches)
    # Chains of contacts, as in a cloud, are no place.
    farthest = cKDTree(places.points).query(known.points)[0].max()
    return places if places.spacing > 2.0 * reach >= 2.0 * farthest else merged


def thin_contacts(contacts: Contacts, most: int) -> Contacts:
    """Return at most `most` contacts, each the mean of those near it with similar normals.

    Centres are chosen by farthest-first traversal (Gonzalez 1985) of positions and normals
    together, precise contacts before others; every contact joins its nearest centre. Means are
    weighted by inverse variances and carry their own, smaller noise; set unknown noise first, or
    a cell of many contacts counts as much as a cell of few. The mean of points on a curved surface
    is inside of it: each contact predicts the height of its cell's mean by the plane halfway
    between both normals, which is exact on spheres.

    Returns `contacts` if there are few enough, else points, normals and noise only. The result
    follows rigid motions and scaling, and does not depend on the order of contacts.
    """
    if len(contacts) <= most:
        return contacts
    distinct = _drop_repetitions(contacts)
    if len(distinct) <= most:
        return distinct
    return _surface_means(distinct, _cells(distinct, most))


def _noise(contacts: Contacts) -> tuple[FloatArray, FloatArray]:
    """Return the contacts' own noise, NaN where it is unknown, (N,) [m] and (N,) [rad]."""
    return noise_of(contacts, None, None)


def _drop_repetitions(contacts: Contacts) -> Contacts:
    """Return contacts without exact repetitions, in order; the least noise of equal ones counts."""
    rows = np.hstack([contacts.points, contacts.normals]) + 0.0  # -0.0 becomes 0.0
    _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(contacts):
        return contacts
    order = np.argsort(first)

    def least(noise: FloatArray | None) -> FloatArray | None:
        if noise is None:
            return None
        smallest = np.full(len(first), np.nan)
        np.fmin.at(smallest, which.ravel(), noise)
        return smallest[order]

    return replace(
        contacts.subset(first[order]),
        position_noise=least(contacts.position_noise),
        normal_noise=least(contacts.normal_noise),
    )


def _merged(contacts: Contacts, reach: float | FloatArray) -> Contacts:
    """Return the weighted means of linked contacts: nearer than `reach` [m], of similar normals.

    A `reach` of each contact, shape (N,), links a pair within the larger of both.
    """
    count = len(contacts)
    if count < 2:
        return contacts
    points, normals = contacts.points, contacts.normals
    pairs = cKDTree(points).query_pairs(float(np.max(reach)), output_type="ndarray")
    if np.ptp(reach):
        reaches = np.max(np.asarray(reach)[pairs], axis=1)
        pairs = pairs[np.linalg.norm(np.diff(points[pairs], axis=1)[:, 0], axis=1) <= reaches]
    cosines = np.einsum("pk,pk->p", normals[pairs[:, 0]], normals[pairs[:, 1]])
    pairs = pairs[cosines > _SAME_NORMAL]  # (P, 2)
    if not len(pairs):
        return contacts
    return _means(contacts, connected_component_labels(pairs, count))


def _cells(contacts: Contacts, most: int) -> IndexArray:
    """Return the cell of each contact, (N,), numbered from 0: at most `most` cells."""
    points, precision = contacts.points, precisions_of(contacts.position_noise, len(contacts))
    # The distance between that number of points if they were evenly spread.
    sizes = np.linalg.norm(points - points.mean(axis=0), axis=1)
    cell = float(np.sqrt(4.0 * np.pi / most) * np.sqrt(np.mean(sizes**2)))
    rows = np.hstack([points / cell, contacts.normals / _NORMAL_CELL])  # (N, 6)
    factors = np.minimum(np.sqrt(precision), _MOST_PRECISE)
    centers, _ = farthest_point_order(rows, most, factors=factors)
    return cKDTree(rows[centers]).query(rows)[1].astype(np.intp)


def _means(contacts: Contacts, group: IndexArray) -> Contacts:
    """Return the mean of each group of contacts, weighted by inverse variances where known.

    `group` (N,) are numbers from 0. Means carry their own noise; only points, normals and noise are
    kept.
    """

    def sums(rows: FloatArray, weights: FloatArray) -> FloatArray:
        columns = [np.bincount(group, weights * column) for column in rows.T]
        return np.column_stack(columns).astype(np.float64)

    weights = precisions_of(contacts.position_noise, len(contacts))
    normals = sums(contacts.normals, precisions_of(contacts.normal_noise, len(contacts)))
    return Contacts(
        sums(contacts.points, weights) / np.bincount(group, weights)[:, None],
        unit(normals),
        position_noise=noise_of_means(contacts.position_noise, group),
        normal_noise=noise_of_means(contacts.normal_noise, group),
    )


def _surface_means(contacts: Contacts, group: IndexArray) -> Contacts:
    """Return the mean of each group, moved along its normal to the surface."""
    means = _means(contacts, group)
    centers, upright = means.points[group], means.normals[group]
    halfway = 0.5 * (contacts.normals + upright)
    cosines = np.einsum("nk,nk->n", halfway, upright)
    heights = np.einsum("nk,nk->n", halfway, contacts.points - centers)
    heights /= np.maximum(cosines, _LEAST_COSINE)
    weights = precisions_of(contacts.position_noise, len(contacts))
    height = np.bincount(group, weights * heights) / np.bincount(group, weights)
    return replace(means, points=means.points + height[:, None] * means.normals)
