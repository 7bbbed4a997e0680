"""Normal estimation: contacts from points without normals, with the normals' standard deviations.

The evidence is the points themselves (a smooth closed surface passes through them), the directions
of approach (a finger meets the outside), and points in free space; see `NormalPosterior`. In a
dense cloud they are the normals of local planes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidContactsError, shown
from lis_grasp.geometry import angle_between
from lis_grasp.surfaces._contact_noise import mean_where_unknown
from lis_grasp.surfaces._normal_posterior import EstimatedNormals, NormalPosterior
from lis_grasp.surfaces.contact_places import farthest_point_order
from lis_grasp.surfaces.queries import require_range
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.underflow import underflows

# Points without approach directions: four are the corners of the simplest closed surface.
LEAST_POINTS = 4

# Noise of positions where it is not given, in largest distances between two points. Less follows
# the noise of real points; more loses edges.
_DEFAULT_NOISE = 0.01
# Least noise of the process, relative to its amplitude, for points at one place.
_LEAST_NOISE = 1e-3

# A straight motion that hits a surface element anywhere has an angle to the inward normal of
# density proportional to its cosine (Lambert), so of mean cosine 2/3. The von Mises-Fisher
# distribution with that mean has this concentration: coth(k) - 1/k = 2/3.
_COSINE_LAW = 2.9895

# More points are estimated from this many of them, spread evenly; the others from their neighbours.
_MOST_IN_FIELD = 250
# Free points near each point: many on one side say nothing new.
_FREE_NEIGHBOURS = 2
# and no farther, in largest distances between two points: within the covariance's length of all.
_FREE_REACH = 0.5

# Inside and outside are ambiguous if the other side is this likely in comparison (1 to 20).
_LEAST_LOG_ODDS = -np.log(20.0)

# Neighbours of a plane, the point itself included.
_NEIGHBOURS = 12
# Least sine of a normal's standard deviation: a plane of neighbours on a curved surface is biased.
_LEAST_DEVIATION = 0.05


@underflows
def estimate_normals(
    points: npt.ArrayLike,
    *,
    approach: npt.ArrayLike | None = None,
    approach_noise: float | None = None,
    free_points: npt.ArrayLike | None = None,
    free_radii: npt.ArrayLike | None = None,
    fingertip_radius: float = 0.0,
    position_noise: float | npt.ArrayLike | None = None,
) -> Contacts:
    """Estimate the outward normals of points on a surface; return them as contacts.

    They are likeliest under a smooth prior; `Contacts.normal_noise` has their standard deviations.

    Parameters
    ----------
    points
        Shape (N, 3) [m] in O: surface points, or the centres of a spherical fingertip in contact.
    approach
        Shape (N, 3), the direction of the fingertip's motion, or of the measured force on the
        object, at each contact, of any length; 0 where it is unknown. None if all are unknown.
    approach_noise
        One standard deviation of each component of the inward normal about that direction [rad].
        None takes straight motions that hit any part of a surface: angles with the cosine law.
    free_points, free_radii
        Shapes (K, 3) and (K,) [m], balls outside of the object, as in `Contacts`.
    fingertip_radius
        Radius of the spherical fingertip [m] whose centres `points` are; 0 for surface points.
    position_noise
        One standard deviation of the points along the normals [m], one for all or shape (N,); None
        if it is unknown.

    Raises
    ------
    InvalidContactsError
        If an array has another shape or is not finite, or there are too few points.
    EstimationError
        If the evidence does not say which side is outside.
    """
    require_range("fingertip_radius", fingertip_radius, unit="m")
    centers = _checked(points, free_points, free_radii, position_noise)
    directions = _directions(approach, len(centers))
    concentration = _COSINE_LAW
    if approach_noise is not None:
        require_range("approach_noise", approach_noise, unit="rad", above_zero=True)
        concentration = approach_noise**-2.0
    _require_evidence(centers, directions)
    estimate = _estimate_many if len(centers) > _MOST_IN_FIELD else _estimate
    normals, deviations = estimate(centers, concentration * directions)
    return Contacts(
        centers.points - fingertip_radius * normals,
        normals,
        free_points=centers.free_points,
        free_radii=centers.free_radii,
        position_noise=centers.position_noise,
        normal_noise=deviations,
    )


def _checked(
    points: npt.ArrayLike,
    free_points: npt.ArrayLike | None,
    free_radii: npt.ArrayLike | None,
    position_noise: float | npt.ArrayLike | None,
) -> Contacts:
    """Return checked arrays as contacts whose normals mean nothing yet."""
    count = len(np.atleast_1d(np.asarray(points)))
    noise = None if position_noise is None else np.asarray(position_noise, dtype=np.float64)
    return Contacts(
        np.asarray(points),
        np.tile([0.0, 0.0, 1.0], (count, 1)),
        free_points=np.empty((0, 3)) if free_points is None else np.asarray(free_points),
        free_radii=np.empty(0) if free_radii is None else np.asarray(free_radii),
        position_noise=np.full(count, noise) if noise is not None and noise.ndim == 0 else noise,
    )


def _directions(approach: npt.ArrayLike | None, count: int) -> FloatArray:
    """Return unit directions of approach, zeros where unknown, shape (N, 3)."""
    if approach is None:
        return np.zeros((count, 3))
    vectors = np.asarray(approach, dtype=np.float64)
    if vectors.shape != (count, 3) or not np.all(np.isfinite(vectors)):
        raise InvalidContactsError(
            f"approach must be {count} finite directions, shape ({count}, 3); it is"
            f" {shown(approach)}: give one direction of motion for each point, zeros where unknown",
            field="approach",
        )
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)


def _require_evidence(centers: Contacts, directions: FloatArray) -> None:
    known = int(np.count_nonzero(np.any(directions, axis=1)))
    needed = LEAST_POINTS if known < len(centers) else 1
    places = len(np.unique(centers.points, axis=0))
    if places < needed:
        raise InvalidContactsError(
            f"normals need at least {needed} points at different places if directions of approach"
            f" are not known; there are {places}: add points, or columns nx,ny,nz or ax,ay,az"
            if needed > 1
            else "normals need at least one point; there are none",
            field="points",
        )


def _estimate(centers: Contacts, inward: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return normals (N, 3) and deviations (N,) [rad] by the posterior of all points."""
    points = centers.points
    scale = float(pdist(points).max(initial=0.0)) or 1.0
    middle = centers.bounds.mean(axis=0)
    scaled = (points - middle) / scale
    free = (centers.free_points[_free_near(centers, _FREE_REACH * scale)] - middle) / scale
    outward = scaled - scaled.mean(axis=0)
    likely = np.where(np.any(inward, axis=1, keepdims=True), -inward, outward)
    starts = [likely, outward, _local_planes(points, likely)[0]]
    known = _known_noise(centers)
    noise = np.full(len(points), _DEFAULT_NOISE) if known is None else known / scale
    posterior = NormalPosterior.condition(scaled, np.maximum(noise, _LEAST_NOISE), inward, free)
    maxima = posterior.maxima([*starts, posterior.relaxed()])
    # The same surface with its sides exchanged, unless the climb leads back.
    maxima += posterior.maxima([-maxima[0].normals])
    if _are_ambiguous(maxima):
        raise EstimationError(
            "the points do not say which side is outside: add normals (columns nx,ny,nz) or"
            " directions of approach (ax,ay,az), points in free space, or give `position_noise`"
        )
    return _mixture(maxima)


def _known_noise(centers: Contacts) -> FloatArray | None:
    """Return the noise of positions (N,) [m], a mean where it is unknown; None if all of it is."""
    noise = centers.position_noise
    if noise is None or np.isnan(noise).all():
        return None
    return mean_where_unknown(noise)


def _are_ambiguous(maxima: list[EstimatedNormals]) -> bool:
    """Return whether a maximum with other sides than the best is about as likely."""
    best = max(maxima, key=lambda estimate: estimate.log_evidence)
    return any(
        np.sum(estimate.normals * best.normals) < 0.0
        and estimate.log_evidence - best.log_evidence > _LEAST_LOG_ODDS
        for estimate in maxima
    )


def _mixture(maxima: list[EstimatedNormals]) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest normals, and their deviations over all maxima by their evidence."""
    best = max(maxima, key=lambda estimate: estimate.log_evidence)
    weights = np.exp([estimate.log_evidence - best.log_evidence for estimate in maxima])
    variances = np.stack(
        [
            estimate.deviations**2 + 0.5 * angle_between(estimate.normals, best.normals) ** 2
            for estimate in maxima
        ]
    )
    deviations = np.sqrt(np.minimum(weights @ variances / weights.sum(), 1.0))
    return best.normals, np.asarray(deviations)


def _estimate_many(centers: Contacts, inward: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return normals and deviations from local planes, on the side of the normals of a few."""
    few, _ = farthest_point_order(centers.points, _MOST_IN_FIELD)
    normals, _ = _estimate(centers.subset(few), inward[few])
    _, nearest = cKDTree(centers.points[few]).query(centers.points)
    return _local_planes(centers.points, normals[nearest])


def _free_near(centers: Contacts, reach: float) -> IndexArray:
    """Return indices of the free points that are nearest to the points, within `reach` [m]."""
    count = min(_FREE_NEIGHBOURS, len(centers.free_points))
    if not count:
        return np.empty(0, dtype=np.intp)
    distances, index = cKDTree(centers.free_points).query(centers.points, count)
    return np.unique(index[distances < reach])


def _local_planes(points: FloatArray, references: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit normals of the plane about each point, and their standard deviations.

    Principal component analysis of neighbours (Hoppe et al. 1992, Surface reconstruction from
    unorganized points, section 3.1). The sign of a normal comes from a reference; it is not
    propagated.

    Parameters
    ----------
    points
        Shape (N, 3) [m].
    references
        Shape (N, 3): each normal is turned to the side of its reference.

    Returns
    -------
    normals, deviations
        Shapes (N, 3) and (N,) [rad]. A deviation is that of the least-squares plane's slope: the
        neighbours' scatter across the plane, over their smaller extent along it.
    """
    count = min(_NEIGHBOURS, len(points))
    _, index = cKDTree(points).query(points, count)
    offsets = points[np.reshape(index, (len(points), count))]  # (N, K, 3)
    offsets = offsets - offsets.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(offsets.transpose(0, 2, 1) @ offsets)
    normals = vectors[:, :, 0]
    signs = np.where(np.sum(normals * references, axis=1) < 0.0, -1.0, 1.0)
    across = np.maximum(values[:, 0], 0.0) / max(count - 3, 1)
    deviations = np.sqrt(across / np.maximum(values[:, 1], 1e-300))
    return signs[:, None] * normals, np.maximum(deviations, _LEAST_DEVIATION)
