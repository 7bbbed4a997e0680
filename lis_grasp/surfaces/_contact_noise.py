"""Noise of contacts: known or given noise, noise of means, and maximum likelihood estimates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist
from scipy.special import logsumexp

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import tangent_frame, unit
from lis_grasp.surfaces._gaussian_process_regression import (
    GradientRegression,
    factorize,
    gradient_covariance,
    log_likelihood,
)
from lis_grasp.surfaces._kernels import SMOOTH
from lis_grasp.surfaces._patch import design_rows
from lis_grasp.surfaces.contact_places import resolution_of
from lis_grasp.surfaces.queries import require_range
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Least noise in a weight, relative to the largest: an exact measurement has no finite weight.
_LEAST_NOISE = 1e-6

# Neighbours of a contact that its quadric explains, at most and at least, and how many are looked
# at to find them.
_NEIGHBOURS, _LEAST_NEIGHBOURS, _CANDIDATES = 6, 4, 18

# Contacts with a quadric, at most and at least.
_MOST_BLOCKS, _LEAST_BLOCKS = 40, 6

# Neighbours are on one smooth patch: their smoothed normals agree, they are within three spacings,
# and neither is far above the other's tangent plane, in spacings.
_SAME_PATCH = 0.64
_REACH = 3.0
_STEP = 1.0

# Widths of the bilateral smoothing of normals: of positions, in spacings, and of normals.
_SMOOTH_POSITIONS, _SMOOTH_NORMALS = 1.2, 0.5

# Prior standard deviation of curvature in 1/spacing, and of the length of the quadric's gradient.
_CURVATURE = 2.0
_GRADIENT_LENGTH = 0.1

# Departures of a surface from its quadric at one spacing, in spacings, and their prior weights. It
# grows with the third power of distance, that of the normal with the second. The largest is an edge
# among the neighbours.
_DEPARTURES = np.array([0.001, 0.03, 0.3])
_WEIGHTS = np.array([0.6, 0.3, 0.1])

# Noise that conditions the equations of that surface.
_CONDITIONING = (3e-4, 1e-2)

# No noise needs a Bayes factor of exp(15): edges are no smooth surface, and noise is common.
_LOG_BAYES_FACTOR = 15.0

# With more contacts their neighbours resolve the shape, and the equations take too long.
_MOST_COMPARED = 100

# Range and starts of the search: logarithms of noise, in spacings and rad.
_LOWEST, _HIGHEST = -7.0, 1.0
_STARTS = np.array([(-6.0, -5.0), (-6.0, -2.0), (-2.5, -2.0)])


def noise_of(
    contacts: Contacts, position_noise: float | None, normal_noise: float | None
) -> tuple[FloatArray, FloatArray]:
    """Return the noise of each contact: its own, else what is given, else NaN.

    `position_noise` [m] and `normal_noise` [rad] are for contacts whose own noise is unknown.
    Returns two arrays of shape (N,) [m] and [rad]. Raises `InvalidOptionError` if an option is
    outside its range.
    """
    options = {"position_noise": (position_noise, "m"), "normal_noise": (normal_noise, "rad")}
    for name, (value, measure) in options.items():
        if value is not None:
            require_range(name, value, unit=measure)
    position, normal = (np.nan if value is None else value for value, _ in options.values())
    return (
        filled(contacts.position_noise, position, len(contacts)),
        filled(contacts.normal_noise, normal, len(contacts)),
    )


def precisions_of(noise: FloatArray | None, count: int) -> FloatArray:
    """Return relative weights of measurements, 1 / variance, shape (N,); 1 for the noisiest.

    `noise` (N,) are standard deviations, or None where all are unknown. An unknown one, NaN, counts
    as their root mean square; an exact one, 0, as a millionth of the largest.
    """
    if noise is None:
        return np.ones(count)
    known = mean_where_unknown(noise)
    largest = known.max()
    if largest == 0.0:
        return np.ones(count)
    return np.asarray(1.0 / np.maximum(known / largest, _LEAST_NOISE) ** 2)


def mean_where_unknown(noise: FloatArray) -> FloatArray:
    """Return noise (N,), where it is unknown the root mean square of what is known."""
    return np.where(np.isnan(noise), np.sqrt(np.nanmean(noise**2)), noise)


def noise_of_means(noise: FloatArray | None, group: IndexArray) -> FloatArray | None:
    """Return the noise of inverse-variance weighted means, (sum of 1 / variance)^(-1/2).

    `noise` (N,) are standard deviations of independent measurements or None, `group` (N,) their
    groups, numbered from 0. NaN for a group whose noise is all unknown.
    """
    if noise is None:
        return None
    known = ~np.isnan(noise)
    with np.errstate(divide="ignore"):
        precisions = 1.0 / noise[known] ** 2  # infinite for an exact measurement
        total = np.bincount(group[known], precisions, minlength=int(group.max()) + 1)
        means = 1.0 / np.sqrt(total)
    return np.where(np.isin(np.arange(len(total)), group[known]), means, np.nan)


def filled(own: FloatArray | None, value: float, count: int) -> FloatArray:
    """Return the noise (N,) of N contacts: their own, or a value where it is unknown."""
    return np.full(count, value) if own is None else np.where(np.isnan(own), value, own)


def likeliest_noise(contacts: Contacts) -> tuple[float, float]:
    """Return the noise of distinct contacts, see `contact_preparation.estimate_noise`."""
    blocks = _Blocks.of(contacts)
    if blocks is None:
        return np.nan, np.nan
    start = min(_STARTS, key=lambda x: blocks.loss(x)[0])
    limits = [(_LOWEST, _HIGHEST)] * 2
    found = minimize(
        blocks.loss, start, jac=True, method="L-BFGS-B", bounds=limits, options={"ftol": 1e-4}
    )
    position, normal = np.exp(found.x)
    noise = float(position * blocks.spacing), float(normal)
    return (0.0, 0.0) if _is_smooth(contacts, noise) else noise


def _is_smooth(contacts: Contacts, noise: tuple[float, float]) -> bool:
    """Return whether a smooth surface without noise explains contacts much better than with noise.

    A smooth shape that contacts resolve only together has no noise, although neighbours alone do
    not explain each other. Compares marginal likelihoods of a Gaussian process, at the amplitude
    that is likeliest without noise. More than 100 contacts are not compared.
    """
    if not 2 <= len(contacts) <= _MOST_COMPARED:
        return False
    scale = float(pdist(contacts.points).max())
    nodes = (contacts.points - contacts.bounds.mean(axis=0)) / scale
    targets = np.column_stack([np.full(len(nodes), -1.0), contacts.normals])
    value, slope = _CONDITIONING
    process = GradientRegression.fit(
        SMOOTH, nodes, targets, np.array([value, slope, slope, slope]) ** 2
    )
    variance = process.likeliest_amplitude() ** 2
    covariance = variance * gradient_covariance(SMOOTH, nodes)
    conditioning = variance * process.noise.ravel()
    of_noise = np.tile(np.array([noise[0] / scale, *[noise[1]] * 3]) ** 2, len(nodes))
    with_noise, without = (
        log_likelihood(factorize(covariance.copy(), variances), targets.ravel())
        for variances in (conditioning + of_noise, conditioning)
    )
    return without - with_noise > _LOG_BAYES_FACTOR


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """Linear equations of B contacts' quadrics at K neighbours each; lengths in spacings.

    The unknowns are h, two tangential components of n, and Qxx Qyy Qzz Qxy Qxz Qyz.
    """

    spacing: float  # [m], square root of the area per contact
    distances: FloatArray  # (B, K)
    used: FloatArray  # (B, K) 1 for a neighbour, 0 for none
    # Squared equations (outer products of rows with their right sides, 10 x 10):
    heights: FloatArray  # (B, K, 100) of a neighbour's height
    tilts: FloatArray  # (B, K, 100) of the two tangential components of its normal, summed
    lengths: FloatArray  # (B, 100) of the lengths of the gradients at all neighbours, summed

    @classmethod
    def of(cls, contacts: Contacts) -> _Blocks | None:
        """Return the equations; None if the contacts do not determine the noise."""
        if len(contacts) <= _LEAST_NEIGHBOURS or contacts.extent <= resolution_of(contacts):
            return None
        points, normals = contacts.points, contacts.normals
        tree = cKDTree(points)
        distances, near = tree.query(points, k=min(_CANDIDATES + 1, len(points)))
        k = min(10, len(points) - 1)
        spacing = float(np.median(distances[:, k]) * np.sqrt(np.pi / k))
        if not spacing > 0.0:
            return None
        distances, near = distances[:, 1:] / spacing, near[:, 1:]
        on_patch = _on_one_patch(points / spacing, normals, distances, near)
        centers = _spread(points, np.flatnonzero(on_patch.sum(axis=1) >= _LEAST_NEIGHBOURS))
        if len(centers) < _LEAST_BLOCKS:
            return None
        first = np.argsort(~on_patch[centers], axis=1, kind="stable")[:, :_NEIGHBOURS]
        rows = centers[:, None]
        near, distances, used = near[rows, first], distances[rows, first], on_patch[rows, first]
        offsets = (points[near] - points[rows]) / spacing  # (B, K, 3)
        values, gradients = _quadric_rows(offsets, tangent_frame(normals[centers]))
        mine, theirs = normals[rows], normals[near]  # (B, 1, 3), (B, K, 3)
        frames = tangent_frame(theirs)  # (B, K, 2, 3)
        tilts = _with_side(frames @ gradients, -np.einsum("bkuc,blc->bku", frames, mine))
        lengths = _with_side(
            np.einsum("bkc,bkcq->bkq", theirs, gradients),
            1.0 - np.einsum("bkc,blc->bk", theirs, mine),
        )
        lengths *= used[:, :, None] / _GRADIENT_LENGTH
        heights = _with_side(values, -np.einsum("bkc,blc->bk", offsets, mine))
        return cls(
            spacing=spacing,
            distances=distances,
            used=used.astype(np.float64),
            heights=np.einsum("bkp,bkq->bkpq", heights, heights).reshape(*near.shape, 100),
            tilts=np.einsum("bkup,bkuq->bkpq", tilts, tilts).reshape(*near.shape, 100),
            lengths=np.einsum("bkp,bkq->bpq", lengths, lengths).reshape(len(near), 100),
        )

    def loss(self, log_noise: FloatArray) -> tuple[float, FloatArray]:
        """Return minus the mean log marginal likelihood, and its gradient, shape (2,).

        `log_noise` are the logarithms of the noise of positions, in spacings, and of normals.
        """
        position, normal = np.exp(2.0 * log_noise)
        departures = _DEPARTURES[:, None, None]  # (L, 1, 1)
        of_value = position + (departures * self.distances**3) ** 2  # (L, B, K)
        of_slope = normal + (3.0 * departures * self.distances**2) ** 2
        by_value, by_slope = self.used / of_value, self.used / of_slope
        sums = by_value[:, :, None] @ self.heights + by_slope[:, :, None] @ self.tilts
        sums = (sums[:, :, 0] + self.lengths).reshape(*of_value.shape[:2], 10, 10)
        flat = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0]) / _CURVATURE**2
        prior = np.array([1.0 / position, 1.0 / normal, 1.0 / normal, *flat])
        matrices, sides = sums[..., :9, :9], sums[..., :9, 9]
        matrices[..., range(9), range(9)] += prior
        covariances = np.linalg.inv(matrices)
        solutions = np.einsum("lbpq,lbq->lbp", covariances, sides)
        misfit = sums[..., 9, 9] - np.einsum("lbp,lbp->lb", sides, solutions)
        volumes = np.linalg.slogdet(matrices)[1] - np.log(prior).sum()
        scatter = (self.used * (np.log(of_value) + 2.0 * np.log(of_slope))).sum(axis=2)
        logs = np.log(_WEIGHTS)[:, None] - 0.5 * (misfit + volumes + scatter)  # (L, B)
        total = logsumexp(logs, axis=0)

        # Fisher's identity: expected squared residuals under the posterior of the unknowns.
        moments = np.empty_like(sums)
        moments[..., :9, :9] = covariances + solutions[..., :, None] * solutions[..., None, :]
        moments[..., :9, 9] = moments[..., 9, :9] = -solutions
        moments[..., 9, 9] = 1.0
        flat_moments = moments.reshape(*logs.shape, 100, 1)
        value_errors = (self.heights @ flat_moments)[..., 0]  # (L, B, K)
        slope_errors = (self.tilts @ flat_moments)[..., 0]
        for_position = (by_value * (value_errors / of_value - 1.0)).sum(axis=2)
        for_normal = (by_slope * (slope_errors / of_slope - 2.0)).sum(axis=2)
        own = np.einsum("lbpp->lbp", moments)  # of the contact's own height and normal
        for_position += (own[..., 0] / position - 1.0) / position
        for_normal += (own[..., 1:3].sum(axis=2) / normal - 2.0) / normal
        weights = np.exp(logs - total)
        slopes = [
            variance * np.sum(weights * part)
            for variance, part in ((position, for_position), (normal, for_normal))
        ]
        return float(-total.mean()), -np.array(slopes) / len(total)


def _on_one_patch(
    points: FloatArray, normals: FloatArray, distances: FloatArray, near: IndexArray
) -> BoolArray:
    """Return whether each contact and its neighbours are on one smooth patch, shape (N, K)."""
    smooth = normals
    for _ in range(2):
        tilts = np.sum((smooth[near] - smooth[:, None]) ** 2, axis=2)
        weights = np.exp(
            -0.5 * (distances / _SMOOTH_POSITIONS) ** 2 - 0.5 * tilts / _SMOOTH_NORMALS**2
        )
        smooth = unit(normals + np.einsum("nk,nkc->nc", weights, normals[near]))
    offsets = points[near] - points[:, None]
    # 0 on planes, spheres and cylinders, whatever the curvature.
    steps = np.abs(np.einsum("nkc,nkc->nk", offsets, smooth[near] + smooth[:, None]))
    agree = np.einsum("nkc,nc->nk", smooth[near], smooth) > _SAME_PATCH
    return agree & (distances < _REACH) & (steps < _STEP * np.maximum(distances, 1.0))


def _spread(points: FloatArray, chosen: IndexArray) -> IndexArray:
    """Return at most `_MOST_BLOCKS` of the chosen points, at all distances from the centroid."""
    distances = np.linalg.norm(points[chosen] - points.mean(axis=0), axis=1)
    order = chosen[np.argsort(distances, kind="stable")]
    count = min(len(order), _MOST_BLOCKS)
    return order[np.round(np.linspace(0, len(order) - 1, count)).astype(np.intp)]


def _quadric_rows(offsets: FloatArray, tangents: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what maps the unknowns to a quadric's value, (B, K, 9), and gradient, (B, K, 3, 9)."""
    rows = design_rows(offsets.reshape(-1, 3)).reshape(*offsets.shape[:2], 4, 10)
    slopes = np.einsum("bkrc,btc->bkrt", rows[..., 1:4], tangents)
    rows = np.concatenate([rows[..., :1], slopes, rows[..., 4:]], axis=-1)
    return rows[:, :, 0], rows[:, :, 1:]


def _with_side(rows: FloatArray, sides: FloatArray) -> FloatArray:
    """Return equations with their right sides as last column."""
    return np.concatenate([rows, sides[..., None]], axis=-1)
