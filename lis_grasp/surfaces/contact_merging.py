"""Merging of duplicate contacts, and the spacing and bounds of what is left."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.queries import require_contacts
from lis_grasp.typing import FloatArray

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


def merge_duplicates(contacts: Contacts, position_noise: float | None = None) -> Contacts:
    """Replace repeated contacts of one place by their mean, in order of each place's first contact.

    Between two touches of one place the angle of eq. 11 (Ottenhaus et al. 2016) is meaningless, and
    eq. 9 gives both together the weight of one. Contacts at one place with different normals (the
    two faces of a corner) stay separate. Only points and normals are kept.

    Noise, one standard deviation of positions [m], moves repeated contacts apart. Where the spacing
    is no more than noise explains, contacts within the noise are merged too, if that leaves places
    that are clearly farther apart.
    """
    require_contacts(contacts)
    merged = _merged(contacts, max(_SAME_PLACE * contacts.extent, resolution_of(contacts)))
    reach = _NOISE_REACH * (position_noise or 0.0)
    if len(merged) < 2 or not merged.spacing < reach < np.inf:
        return merged
    places = _merged(contacts, reach)
    return places if places.spacing > 2.0 * reach else merged


def _merged(contacts: Contacts, reach: float) -> Contacts:
    """Return the means of contacts linked by a distance of `reach` [m] and similar normals."""
    if len(contacts) < 2:
        return Contacts(contacts.points, contacts.normals)
    pairs = cKDTree(contacts.points).query_pairs(reach, output_type="ndarray")
    cosines = np.einsum("pk,pk->p", contacts.normals[pairs[:, 0]], contacts.normals[pairs[:, 1]])
    pairs = pairs[cosines > _SAME_NORMAL]  # (P, 2)
    count = len(contacts)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    places, place = connected_components(links, directed=False)
    if places == count:
        return Contacts(contacts.points, contacts.normals)
    members = np.bincount(place)
    points = np.column_stack([np.bincount(place, c) for c in contacts.points.T]) / members[:, None]
    normals = np.column_stack([np.bincount(place, c) for c in contacts.normals.T])
    return Contacts(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


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
