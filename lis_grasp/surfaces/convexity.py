"""Local convexity of each contact as a function of direction (Ottenhaus et al. 2016, eqs. 11-15)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[np.float64]

# Terms below exp(-30) = 1e-13 of the largest one cannot be seen in a sum and are left out.
NEGLIGIBLE = 30.0

# |beta*| stays below 1: at 1 the inside of a contact with another one straight opposite would be
# exactly 0, which a mesher takes for surface.
MAX_CONVEXITY = 0.98

# Floor of the angular width, eq. 13, which otherwise underflows to 0 a few sigma off the plane.
_MIN_WIDTH = 1e-3

# A neighbour this near to a contact's normal axis (sine of the angle) has no direction in its plane.
_ON_AXIS = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Convexity:
    """beta*_i(phi) of every contact: -1 convex, 0 flat, 1 concave, towards the direction phi.

    The angle phi enters eqs. 11 and 15 through its cosine only, sin^2(phi / 2) = (1 - cos phi) / 2,
    and the cosine is the product of two unit vectors in the contact's tangent plane. So no local
    axes are needed and no angle is computed.

    Parameters
    ----------
    starts
        Shape (N + 1,): contact i owns the rows starts[i]:starts[i + 1] of the arrays below, one
        row for each neighbour j that matters.
    directions
        Shape (P, 3), from c_i to c_j projected on the tangent plane of i, unit; 0 where c_j is
        straight above or below and has no direction.
    log_heights
        Shape (P,), log sigma_h of eq. 12.
    sharpness
        Shape (P,), 1 / (4 sigma_w^2) of eq. 13: the kernel is exp(-sharpness (1 - cos phi)).
    sines
        Shape (P,), sin(alpha_ij).
    """

    starts: npt.NDArray[np.intp]
    directions: FloatArray
    log_heights: FloatArray
    sharpness: FloatArray
    sines: FloatArray

    @classmethod
    def from_contacts(cls, points: FloatArray, normals: FloatArray, sigma: float) -> Convexity:
        """Prepare every pair of contacts that matters; shapes (N, 3), sigma in metres."""
        tree = cKDTree(points)
        parts: list[tuple[FloatArray, ...]] = []
        pending = np.arange(len(points))
        neighbors = min(48, len(points) - 1)
        while len(pending):
            owners, others, log_heights, sharpness, done = _relevant_pairs(
                tree, normals, sigma, pending, neighbors
            )
            parts.append((owners, others, log_heights, sharpness))
            pending = pending[~done]
            neighbors = min(4 * neighbors, len(points) - 1)
        owners, others, log_heights, sharpness = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.lexsort((others, owners))
        owners, others = owners[order], others[order]
        offsets = points[others] - points[owners]  # (P, 3)
        distances = np.linalg.norm(offsets, axis=1)
        heights = np.einsum("pk,pk->p", offsets, normals[owners])  # y_i(c_j), eq. 8
        projected = offsets - heights[:, None] * normals[owners]
        lengths = np.linalg.norm(projected, axis=1)
        on_axis = lengths <= _ON_AXIS * distances
        return cls(
            starts=np.searchsorted(owners, np.arange(len(points) + 1)),
            directions=np.where(on_axis[:, None], 0.0, projected) / np.where(on_axis, 1.0, lengths)[:, None],
            log_heights=log_heights[order],
            # Straight above: the same height in every direction.
            sharpness=np.where(on_axis, 0.0, sharpness[order]),
            sines=np.clip(heights / distances, -1.0, 1.0),
        )

    def evaluate(self, contact: int, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return beta* of one contact towards directions in its tangent plane, and its slope.

        Parameters
        ----------
        contact
            The index i.
        directions
            Shape (R, 3), unit, in the tangent plane of i.

        Returns
        -------
        values
            Shape (R,), eq. 15, clamped to the open interval (-1, 1).
        slopes
            Shape (R, 3), d beta* / d direction.
        """
        own = slice(self.starts[contact], self.starts[contact + 1])
        if own.start == own.stop:  # a lone contact is flat
            return np.zeros(len(directions)), np.zeros((len(directions), 3))
        sharpness, sines = self.sharpness[own], self.sines[own]
        terms = directions @ (sharpness[:, None] * self.directions[own]).T  # (R, J)
        terms += self.log_heights[own] - sharpness  # log of eq. 11
        terms -= terms.max(axis=1, keepdims=True)
        np.exp(terms, out=terms)
        terms /= terms.sum(axis=1, keepdims=True)
        values = terms @ sines  # eq. 15
        pulls = (terms * sines) @ (sharpness[:, None] * self.directions[own])  # (R, 3)
        pulls -= values[:, None] * (terms @ (sharpness[:, None] * self.directions[own]))
        clamped = np.abs(values) >= MAX_CONVEXITY
        pulls[clamped] = 0.0
        return np.clip(values, -MAX_CONVEXITY, MAX_CONVEXITY), pulls


def _relevant_pairs(
    tree: cKDTree, normals: FloatArray, sigma: float, owners: npt.NDArray[np.intp], neighbors: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Return the pairs whose angular kernel can be seen beside the others', and for whom all are found.

    The logarithm of eq. 11 lies between log sigma_h - 2 sharpness and log sigma_h, whatever the
    direction: a neighbour whose upper end is far below another one's lower end never matters.
    """
    distances, others = tree.query(tree.data[owners], k=neighbors + 1)  # itself among them
    distances, others = distances.reshape(len(owners), -1), others.reshape(len(owners), -1)
    log_heights = -0.5 * (distances / sigma) ** 2  # eq. 12
    offsets = tree.data[others] - tree.data[owners][:, None, :]
    heights = np.einsum("ojk,ok->oj", offsets, normals[owners])
    widths = np.maximum(np.exp(-0.5 * (heights / sigma) ** 2), _MIN_WIDTH)  # eq. 13
    sharpness = 0.25 / widths**2
    # Contacts that coincide have no angle between them: skip the pair, and oneself.
    valid = distances > 0.0
    lowest = np.where(valid, log_heights - 2.0 * sharpness, -np.inf).max(axis=1)
    relevant = valid & (log_heights >= (lowest - NEGLIGIBLE)[:, None])
    done = (log_heights[:, -1] < lowest - NEGLIGIBLE) | (neighbors >= tree.n - 1)
    relevant &= done[:, None]
    row, column = np.nonzero(relevant)
    return (
        owners[row],
        others[row, column],
        log_heights[row, column],
        sharpness[row, column],
        done,
    )
