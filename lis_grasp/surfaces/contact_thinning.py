"""Thinning of many contacts to fewer, spread evenly over the touched surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import average_groups
from lis_grasp.surfaces.contact_places import box_area, farthest_point_order


def thin_contacts(contacts: Contacts, most: int) -> Contacts:
    """Return at most so many contacts, each the mean of those near it with like normals.

    The groups are those of the first `most` contacts of the farthest-point order. Distances are of
    position and normal together: normals that differ by 1 are as far apart as neighbouring groups.
    Means are weighted by inverse variances and carry their own noise; only points, normals and
    noise are kept.

    The mean of points on a curved surface is off the surface, by half the mean of n_i . (p_i - p)
    to second order: it is moved back.
    """
    if len(contacts) <= most:
        return contacts
    apart = np.sqrt(box_area(contacts.points) / most)
    features = np.hstack([contacts.points, apart * contacts.normals])  # (N, 6)
    chosen, _ = farthest_point_order(features, most)
    _, group = cKDTree(features[chosen]).query(features)
    group = group.astype(np.intp)
    means = average_groups(contacts, group)
    offsets = contacts.points - means.points[group]
    heights = np.einsum("nk,nk->n", contacts.normals, offsets)
    sagittas = 0.5 * np.bincount(group, heights) / np.bincount(group)
    return replace(means, points=means.points + sagittas[:, None] * means.normals)
