"""Thinning of point clouds: local averages that keep the information of many noisy contacts."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import drop_repetitions
from lis_grasp.surfaces.contact_noise import noise_of_means, precisions_of
from lis_grasp.typing import FloatArray, IndexArray

# Normals that differ by this much are as far apart as contacts one cell apart.
_NORMAL_CELL = 0.5

# A more precise contact is a cell of its own at this fraction of the distance at most.
_MOST_PRECISE = 4.0

# Contacts whose normals are further apart than this from the cell's mean are not on one plane.
_LEAST_COSINE = 0.3


def thin_contacts(contacts: Contacts, most: int) -> Contacts:
    """Return at most `most` contacts, each the mean of those near it with similar normals.

    Centres are chosen by farthest-first traversal (Gonzalez 1985) of positions and normals
    together, precise contacts before others; every contact joins its nearest centre. Means are
    weighted by inverse variances and carry their own, smaller noise; set unknown noise first, or
    cells of many contacts count as much as those of few. The mean of points on a curved surface is
    inside of it: each contact predicts the height of its cell's mean by the plane halfway between
    both normals, which is exact on spheres.

    Returns `contacts` if there are few enough, else points, normals and noise only. The result
    follows rigid motions and scaling, and does not depend on the order of contacts (but for ties).
    """
    if len(contacts) <= most:
        return contacts
    distinct = drop_repetitions(contacts)
    if len(distinct) <= most:
        return distinct
    precision = precisions_of(distinct.position_noise, len(distinct))
    cell = _cell_size(distinct.points, most)
    rows = np.hstack([distinct.points / cell, distinct.normals / _NORMAL_CELL])  # (N, 6)
    centers = _farthest_first(rows, np.minimum(np.sqrt(precision), _MOST_PRECISE), most)
    _, group = cKDTree(rows[centers]).query(rows)
    return _means(distinct, np.asarray(group, dtype=np.intp), precision)


def _cell_size(points: FloatArray, most: int) -> float:
    """Return the distance [m] between `most` of the points if they were evenly spread."""
    sizes = np.linalg.norm(points - points.mean(axis=0), axis=1)
    return float(np.sqrt(4.0 * np.pi / most) * np.sqrt(np.mean(sizes**2)))


def _farthest_first(rows: FloatArray, factors: FloatArray, most: int) -> IndexArray:
    """Return at most `most` rows, each the farthest from all before, distances times factors."""
    chosen = np.empty(most, dtype=np.intp)
    distances = factors * np.linalg.norm(rows - rows.mean(axis=0), axis=1)
    nearest = np.full(len(rows), np.inf)
    for k in range(most):
        chosen[k] = np.argmax(nearest if k else distances)
        offsets = rows - rows[chosen[k]]
        nearest = np.minimum(nearest, factors**2 * np.einsum("nk,nk->n", offsets, offsets))
    return chosen


def _means(contacts: Contacts, group: IndexArray, precision: FloatArray) -> Contacts:
    """Return the mean of each group on the surface, with its noise."""

    def sums(weights: FloatArray, values: FloatArray) -> FloatArray:
        columns = [np.bincount(group, weights * column) for column in values.T]
        return np.column_stack(columns).astype(np.float64)

    points, normals = contacts.points, contacts.normals
    centers = sums(precision, points) / np.bincount(group, precision)[:, None]
    upright = sums(precisions_of(contacts.normal_noise, len(group)), normals)
    upright /= np.linalg.norm(upright, axis=1, keepdims=True)
    halfway = 0.5 * (normals + upright[group])
    cosines = np.einsum("nk,nk->n", halfway, upright[group])
    heights = np.einsum("nk,nk->n", halfway, points - centers[group])
    heights /= np.maximum(cosines, _LEAST_COSINE)
    height = np.bincount(group, precision * heights) / np.bincount(group, precision)
    return Contacts(
        centers + height[:, None] * upright,
        upright,
        position_noise=noise_of_means(contacts.position_noise, group),
        normal_noise=noise_of_means(contacts.normal_noise, group),
    )
