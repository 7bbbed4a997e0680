"""Log odds that a contact contradicts all others: its normal has the wrong side, or it is a stray.

The process of `gpis` predicts each contact from all others, in closed form (Rasmussen and Williams
2006, section 5.4.2). Other evidence needs no process. Contacts of one sphere or plane mirror each
other's normals (Hoppe et al. 1992, Surface reconstruction from unorganized points). A chord has the
same angle to the normals at both ends, (n_i + n_j)^T (x_j - x_i) = 0, on spheres, cylinders and
planes, and from one side of a plate to the other. Space where a hand was is outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist, squareform

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces._gaussian_process_regression import ROWS, GradientRegression
from lis_grasp.surfaces._kernels import MISFIT, SMOOTH
from lis_grasp.surfaces.contact_places import resolution_of
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Degrees of freedom of Student's t of prediction errors, the weight of its log odds, and the median
# of chi^2 of a contact.
_DEGREES, _PREDICTED, _MEDIAN = 16.0, 0.2, 3.357

# Weight of the chords' log odds, the largest of one, and slopes that are none.
_CHORD, _LARGEST_CHORD, _CHORD_MISFIT = 5.0, 4.0, 0.01

# Heights below this, in extents, are neither above nor below a tangent plane.
_LEVEL = 0.01
# Concentration of a beta distribution of fractions, at least and at most.
_CONCENTRATION = (0.3, 20.0)

# Number of neighbours; the best one mirrors a contact's normal.
_MIRRORS = 6
# Weight of contacts that are far away, where none is near.
_FAR_WEIGHT = 1e-9

# Log odds of the side from which a contact was touched, and the cosine of touches that graze it.
_FROM_OUTSIDE, _GRAZING = 10.0, 0.1
# Free space this near to a contact, in spacings, comes from its own touch.
_TOUCHING = 0.5

# Balls of free space that are looked at for each contact, and how deep inside of them a contact
# contradicts them: in that distance, and in standard deviations.
_FREE_NEIGHBOURS = 64
_DEEP, _NOISE_REACH = 0.1, 4.0

# Log odds of a stray: of its distance from the surface in spacings up to 1, and in distances to the
# nearest contact, of how well its neighbours mirror its normal, and without evidence.
_STRAY = (11.6, 6.6, -5.1, -2.2)
# Prediction errors have this many medians where contacts are sound.
_LARGEST_ERROR = 6.0
# Log odds of a stray inside of free space, and at (0, 0, 0) exactly: an empty row, unless it fits.
_INSIDE, _EMPTY = 6.0, 14.5


# Largest and least group of contacts that are judged together; fewer say too little of each other.
_MOST, _LEAST = 160, 5


def groups_of(contacts: Contacts) -> list[IndexArray]:
    """Return the rows of groups of contacts that are judged together; none of too few contacts.

    Every group covers all of the object, and does not depend on the order of contacts.
    """
    count = len(contacts)
    if count < _LEAST or contacts.extent <= resolution_of(contacts):
        return []
    middle = contacts.bounds.mean(axis=0)
    order = np.argsort(np.linalg.norm(contacts.points - middle, axis=1), kind="stable")
    number = -(-count // _MOST)
    return [np.sort(order[k::number]) for k in range(number)]


@dataclass(slots=True, eq=False)
class Evidence:
    """N contacts, at least two places, with what each says about the others. Made by `of`."""

    targets: FloatArray  # (N, 4): value, and normal as far as it was turned
    precision: FloatArray  # (N, 4, N, 4): inverse of the process's covariance with noise
    offsets: FloatArray  # (N, N, 3) from each contact to each, in extents
    distances: FloatArray  # (N, N), infinite from a contact to itself
    spacing: float
    slopes: FloatArray  # (N, N): variance of the components of two normals along their chord
    outside: FloatArray  # (N, 3): direction of the free space at a contact, 0 where unknown
    inside: BoolArray  # (N,): whether it is inside of free space
    empty: BoolArray  # (N,): whether it is an empty row

    @classmethod
    def of(cls, contacts: Contacts, position: FloatArray, normal: FloatArray) -> Evidence:
        """Condition the process on contacts, of noise (N,) [m] and (N,) [rad]."""
        separations = pdist(contacts.points)
        scale = float(separations.max())
        nodes = (contacts.points - contacts.points.mean(axis=0)) / scale
        slopes = MISFIT[1] ** 2 + normal**2
        variances = [MISFIT[0] ** 2 + (position / scale) ** 2, slopes, slopes, slopes]
        targets = np.column_stack([np.full(len(nodes), -1.0), contacts.normals])
        process = GradientRegression.fit(SMOOTH, nodes, targets, np.column_stack(variances))
        factor = (process.cholesky, True)
        precision = cho_solve(factor, np.eye(ROWS * len(nodes)), check_finite=False)
        distances = np.maximum(squareform(separations / scale), np.finfo(np.float64).eps)
        spacing = _spacing(distances)
        np.fill_diagonal(distances, np.inf)
        heights = (position / scale) ** 2
        chords = (heights[:, None] + heights) / distances**2
        chords += _CHORD_MISFIT**2 + normal[:, None] ** 2 + normal**2
        outside, inside = _free_space(contacts, position, _TOUCHING * spacing * scale)
        return cls(
            targets=targets,
            precision=precision.reshape(len(nodes), ROWS, len(nodes), ROWS),
            offsets=nodes[None] - nodes[:, None],
            distances=distances,
            spacing=spacing,
            slopes=chords,
            outside=outside,
            inside=inside,
            empty=np.all(contacts.points == 0.0, axis=1),
        )

    def without(self, i: int) -> Evidence:
        """Return the evidence of all other contacts."""
        kept = np.delete(np.arange(len(self.targets)), i)
        cross = self.precision[kept][:, :, i]  # (N - 1, 4, 4)
        own = np.linalg.inv(self.precision[i, :, i])
        precision = self.precision[kept][:, :, kept]
        precision -= np.einsum("iab,bc,jdc->iajd", cross, own, cross, optimize=True)
        among = np.ix_(kept, kept)
        return Evidence(
            targets=self.targets[kept],
            precision=precision,
            offsets=self.offsets[among],
            distances=self.distances[among],
            spacing=self.spacing,
            slopes=self.slopes[among],
            outside=self.outside[kept],
            inside=self.inside[kept],
            empty=self.empty[kept],
        )

    def log_odds(self) -> tuple[FloatArray, FloatArray]:
        """Return the log odds that each contact's normal is flipped, that it is a stray, (N,)."""
        normals = self.targets[:, 1:]
        count = len(normals)
        own = self.precision[range(count), :, range(count)]  # (N, 4, 4)
        weights = np.einsum("iajb,jb->ia", self.precision, self.targets, optimize=True)
        errors = np.linalg.solve(own, weights[:, :, None])[:, :, 0]
        turned = errors - np.column_stack([np.zeros(count), 2.0 * normals])
        as_given = np.einsum("ia,ia->i", weights, errors)
        if_turned = np.einsum("ia,iab,ib->i", turned, own, turned)
        degrees = _DEGREES * np.median(np.minimum(as_given, if_turned)) / _MEDIAN
        flipped = np.log1p(as_given / degrees) - np.log1p(if_turned / degrees)
        flipped *= 0.5 * _PREDICTED * (_DEGREES + ROWS)

        heights = self._heights()
        above = (heights > _LEVEL).sum(axis=1)
        level = above + (heights < -_LEVEL).sum(axis=1)
        pairs, chords, weights = self.pairs()
        mirrored = np.einsum("ij,ij->i", pairs, weights)
        flipped -= _CHORD * np.einsum("ij,ij->i", chords, weights)
        flipped += _exchange_odds(above / np.maximum(level, 1))
        flipped += _exchange_odds(0.5 + 0.5 * mirrored)
        flipped -= _FROM_OUTSIDE * self.facing()

        distance = np.abs(errors[:, 0])
        usual = _LARGEST_ERROR * np.median(distance)
        stray = _STRAY[0] * np.minimum(distance / (self.spacing + usual), 1.0)
        stray += _STRAY[1] * distance / (self.distances.min(axis=1) + usual)
        stray += _STRAY[2] * mirrored + _STRAY[3] + _INSIDE * self.inside + _EMPTY * self.empty
        return flipped, stray

    def pairs(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return two measures of pairs that change their sign with a normal, and weights, (N, N).

        The first, n_i^T (I - 2 r r^T) n_j with r from i to j, is 1 on spheres, on planes and across
        right edges. The second is the log odds that (n_i + n_j)^T r is 0 and (n_i - n_j)^T r is
        not, as on spheres, cylinders, and both sides of a plate. The weights of a row sum to 1.
        """
        normals = self.targets[:, 1:]
        slopes = self._heights() / self.distances
        pairs = 2.0 * slopes * slopes.T + normals @ normals.T
        plus, minus = ((slopes + sign * slopes.T) ** 2 for sign in (1.0, -1.0))
        chords = np.log((self.slopes + plus) / (self.slopes + minus)) / _LARGEST_CHORD
        weights = np.exp(-0.5 * (self.distances / self.spacing) ** 2) + _FAR_WEIGHT
        np.fill_diagonal(weights, 0.0)
        chords = _LARGEST_CHORD * np.tanh(chords)
        return pairs, chords, weights / weights.sum(axis=1, keepdims=True)

    def facing(self) -> FloatArray:
        """Return from -1 to 1 how surely each normal points into free space, 0 where unknown."""
        return np.tanh(np.sum(self.outside * self.targets[:, 1:], axis=1) / _GRAZING)

    def most_mirrored(self, i: int) -> float:
        """Return how well the best of some neighbours mirrors a contact's normal, on any side."""
        near = np.argsort(self.distances[i])[:_MIRRORS]
        return float(np.abs(self.pairs()[0][i, near]).max())

    def _heights(self) -> FloatArray:
        """Return the height of each contact above the tangent plane of each, (N, N)."""
        return np.einsum("ijk,ik->ij", self.offsets, self.targets[:, 1:])


def _exchange_odds(fractions: FloatArray) -> FloatArray:
    """Return the log odds of 1 - p instead of p, for fractions p (N,), given the other fractions.

    The others have a beta distribution, fitted by moments with one uniform pseudo-observation.
    """
    count = len(fractions)
    mean = (fractions.sum() - fractions + 0.5) / count
    square = (np.sum(fractions**2) - fractions**2 + 1.0 / 3.0) / count
    concentration = np.clip(mean * (1.0 - mean) / (square - mean**2) - 1.0, *_CONCENTRATION)
    p = np.clip(fractions, 0.5 / count, 1.0 - 0.5 / count)
    return np.asarray((1.0 - 2.0 * mean) * concentration * np.log(p / (1.0 - p)))


def _spacing(distances: FloatArray) -> float:
    """Return the spacing of contacts, or of their clusters, from their distances (N, N)."""
    third = np.partition(distances, min(3, len(distances) - 1), axis=1)
    links = minimum_spanning_tree(distances).data
    return float(max(np.median(third[:, min(3, len(distances) - 1)]), np.quantile(links, 0.9)))


def _free_space(
    contacts: Contacts, noise: FloatArray, reach: float
) -> tuple[FloatArray, BoolArray]:
    """Return directions of the free space that touches contacts, (N, 3), and who is inside, (N,).

    Free space within `reach` [m] of a contact shows the side from which it was touched.
    """
    count, centers = len(contacts), contacts.free_points
    if not len(centers):
        return np.zeros((count, 3)), np.zeros(count, dtype=bool)
    k = min(_FREE_NEIGHBOURS, len(centers))
    away, near = (x.reshape(count, k) for x in cKDTree(centers).query(contacts.points, k))
    gaps = away - contacts.free_radii[near]
    nearest = (range(count), np.argmin(np.abs(gaps), axis=1))
    outside = centers[near[nearest]] - contacts.points
    touching = (np.abs(gaps[nearest]) < reach) & (away[nearest] > 0.0)
    outside *= (touching / np.where(touching, away[nearest], 1.0))[:, None]
    return outside, gaps.min(axis=1) < -(_DEEP * reach + _NOISE_REACH * noise)
