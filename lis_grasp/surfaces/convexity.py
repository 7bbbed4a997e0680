"""Local convexity of each contact towards each direction (Ottenhaus et al. 2016, eqs. 11-15)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.surfaces._kernel_mean import NEGLIGIBLE
from lis_grasp.typing import FloatArray, IndexArray

# Bound of |beta*|: at 1, f between two exactly opposite contacts would be 0, a false surface.
MAX_CONVEXITY = 0.98

# Floor of the angular width, eq. 13, which otherwise underflows to 0 a few sigma off the plane.
_MIN_WIDTH = 1e-3

# A neighbour this near to a contact's normal (sine of the angle) has no direction in its plane.
_ON_AXIS = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Convexity:
    """beta*_i(phi) of every contact: -1 convex, 0 flat, 1 concave, towards the direction phi.

    The angle phi enters eqs. 11 and 15 through its cosine only, sin^2(phi / 2) = (1 - cos phi) / 2,
    and the cosine is the product of two unit vectors in the contact's tangent plane. So no local
    axes are needed and no angle is computed.
    """

    # (N + 1,): contact i owns the rows starts[i]:starts[i + 1] below, one for each neighbour j
    starts: IndexArray
    # (P, 3), unit: from c_i to c_j in the tangent plane of i; 0 if c_j is straight above or below
    directions: FloatArray
    log_heights: FloatArray  # (P,) log sigma_h of eq. 12
    # (P,) 1 / (4 sigma_w^2) of eq. 13: the kernel is exp(-sharpness (1 - cos phi))
    sharpness: FloatArray
    sines: FloatArray  # (P,) sin(alpha_ij)

    @classmethod
    def from_contacts(cls, points: FloatArray, normals: FloatArray, sigma: float) -> Convexity:
        """Prepare every pair of contacts that is not negligible; shapes (N, 3), sigma in metres."""
        owners, others = _visible_pairs(points, normals, sigma)
        offsets = points[others] - points[owners]  # (P, 3)
        distances = np.linalg.norm(offsets, axis=1)
        heights = np.einsum("pk,pk->p", offsets, normals[owners])  # y_i(c_j), eq. 8
        projected = offsets - heights[:, None] * normals[owners]
        lengths = np.linalg.norm(projected, axis=1)
        on_axis = lengths <= _ON_AXIS * distances
        return cls(
            starts=np.searchsorted(owners, np.arange(len(points) + 1)),
            directions=np.where(on_axis, 0.0, projected.T / np.where(on_axis, 1.0, lengths)).T,
            log_heights=-0.5 * (distances / sigma) ** 2,
            # Straight above: the same height in every direction.
            sharpness=np.where(on_axis, 0.0, _sharpness(heights, sigma)),
            sines=np.clip(heights / distances, -1.0, 1.0),
        )

    def evaluate(
        self, contacts: npt.ArrayLike, directions: FloatArray, *, with_slopes: bool = True
    ) -> tuple[FloatArray, FloatArray]:
        """Return beta* of contacts, shape (R,), and its slopes by direction, shape (R, 3).

        Eq. 15, clamped to the open interval (-1, 1), of one contact or (R,), towards unit
        directions (R, 3) in the tangent planes of the contacts.
        """
        values, slopes = np.zeros(len(directions)), np.zeros_like(directions)
        contacts = np.broadcast_to(np.asarray(contacts, dtype=np.intp), len(directions))
        counts = self.starts[contacts + 1] - self.starts[contacts]
        known = np.flatnonzero(counts)  # a lone contact is flat
        if not len(known):
            return values, slopes
        counts = counts[known]
        begins = np.cumsum(counts) - counts  # of each contact's terms
        owner = np.repeat(np.arange(len(known)), counts)  # (T,)
        rows = np.arange(len(owner)) + (self.starts[contacts[known]] - begins)[owner]
        pulls = np.take(self.sharpness[:, None] * self.directions, rows, axis=0)  # (T, 3)
        terms = np.einsum("tk,tk->t", pulls, np.take(directions, known[owner], axis=0))
        terms += (self.log_heights - self.sharpness)[rows]  # log of eq. 11
        terms -= np.maximum.reduceat(terms, begins)[owner]
        np.exp(terms, out=terms)
        terms /= np.add.reduceat(terms, begins)[owner]
        sines = self.sines[rows]
        means = np.add.reduceat(terms * sines, begins)  # eq. 15
        if with_slopes:
            pulls *= (terms * (sines - means[owner]))[:, None]
            free = np.abs(means) < MAX_CONVEXITY
            slopes[known] = np.where(free[:, None], np.add.reduceat(pulls, begins, axis=0), 0.0)
        values[known] = np.clip(means, -MAX_CONVEXITY, MAX_CONVEXITY)
        return values, slopes


def _sharpness(heights: FloatArray, sigma: float) -> FloatArray:
    """Return 1 / (4 sigma_w^2) of eq. 13."""
    return 0.25 / np.maximum(np.exp(-0.5 * (heights / sigma) ** 2), _MIN_WIDTH) ** 2


def _visible_pairs(
    points: FloatArray, normals: FloatArray, sigma: float
) -> tuple[IndexArray, IndexArray]:
    """Return contacts i and neighbours j, ordered, whose kernel (eq. 11) is not negligible.

    In any direction the logarithm of eq. 11 is between log sigma_h - 2 sharpness and log sigma_h.
    A neighbour whose upper limit is far below another one's lower limit is negligible. The upper
    limit falls with distance: a few nearest neighbours often suffice, or else more are queried.
    """
    tree = cKDTree(points)
    owners, others = [np.empty(0, np.intp)], [np.empty(0, np.intp)]
    pending = np.arange(len(points))
    neighbors = min(48, len(points) - 1)
    while len(pending):
        distances, index = tree.query(points[pending], k=np.arange(1, neighbors + 2))
        heights = np.einsum("ijk,ik->ij", points[index] - points[pending, None], normals[pending])
        upper = -0.5 * (distances / sigma) ** 2
        # Contacts that coincide have no angle between them.
        lower = np.where(distances > 0.0, upper - 2.0 * _sharpness(heights, sigma), -np.inf)
        visible = lower.max(axis=1) - NEGLIGIBLE
        done = (upper[:, -1] < visible) | (neighbors == len(points) - 1)
        row, column = np.nonzero((distances > 0.0) & (upper >= visible[:, None]) & done[:, None])
        owners.append(pending[row])
        others.append(index[row, column])
        pending = pending[~done]
        neighbors = min(4 * neighbors, len(points) - 1)
    i, j = np.concatenate(owners), np.concatenate(others)
    order = np.lexsort((j, i))
    return i[order], j[order]
