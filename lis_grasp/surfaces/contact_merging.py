"""Merging of duplicate contacts, and the spacing and bounds of what is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from trimesh.graph import connected_component_labels

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_noise import noise_of, noise_of_means, precisions_of
from lis_grasp.surfaces.queries import require_contacts
from lis_grasp.typing import FloatArray, IndexArray

# Spacing of a lone contact [m]: the average exploration step of Ottenhaus et al. 2016, IV.B.
LONE_CONTACT_SPACING = 0.05

# Contacts closer than 1 nm, or than rounding at their distance from the origin, are at one place.
SMALLEST = 1e-9
_ROUNDING = 1e-12

# Contacts this close (of the contacts' extent) whose normals agree this well are one contact.
_SAME_PLACE = 1e-3
_SAME_NORMAL = np.cos(np.deg2rad(15.0))

# Two touches of one place are rarely more than this many standard deviations of a position apart.
_NOISE_REACH = 6.0


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
    known = _with_noise(drop_repetitions(contacts), position_noise, normal_noise)
    merged = _merged(known, max(_SAME_PLACE * known.extent, resolution_of(known)))
    if known.position_noise is None:
        return merged
    reaches = _NOISE_REACH * np.nan_to_num(known.position_noise)  # (N,)
    reach = float(np.median(reaches))
    if len(merged) < 2 or not merged.spacing < reach < np.inf:
        return merged
    places = _merged(known, reaches)
    # Chains of contacts, as of a cloud, are no place.
    farthest = cKDTree(places.points).query(known.points)[0].max()
    return places if places.spacing > 2.0 * reach >= 2.0 * farthest else merged


def drop_repetitions(contacts: Contacts) -> Contacts:
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


def _with_noise(
    contacts: Contacts, position_noise: float | None, normal_noise: float | None
) -> Contacts:
    """Return points, normals and noise, NaN where it is neither known nor given."""
    position, normal = noise_of(contacts, position_noise, normal_noise, default=(np.nan, np.nan))
    return Contacts(contacts.points, contacts.normals, position_noise=position, normal_noise=normal)


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
    return average_groups(contacts, connected_component_labels(pairs, count))


def average_groups(contacts: Contacts, group: IndexArray) -> Contacts:
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
        sums(contacts.points, weights) / sums(np.ones((len(contacts), 1)), weights),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        position_noise=noise_of_means(contacts.position_noise, group),
        normal_noise=noise_of_means(contacts.normal_noise, group),
    )


def spacing_of(contacts: Contacts) -> float:
    """Return the contacts' spacing [m], or a default where there is only one place."""
    spacing = contacts.spacing
    return spacing if spacing > resolution_of(contacts) else LONE_CONTACT_SPACING


def resolution_of(contacts: Contacts) -> float:
    """Return the distance [m] up to which two contacts are at one place."""
    farthest = float(np.abs(contacts.points).max(initial=0.0))
    return max(SMALLEST, _ROUNDING * farthest)


def padded_bounds(contacts: Contacts, margin: float) -> FloatArray:
    """Return the contacts' bounding box grown by a margin [m] on all sides, shape (2, 3) [m]."""
    return contacts.bounds + margin * np.array([[-1.0], [1.0]])
