"""Errors of an estimated surface against the true one, and the even samples that measure them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import manifold3d
import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    EstimationError,
    InvalidContactsError,
    InvalidOptionError,
    require_at_least,
    require_positive,
)
from lis_grasp.guesses import with_advice
from lis_grasp.records import Record
from lis_grasp.shapes import Shape, find, sharp_edges
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.shapes.shape import require_mesh
from lis_grasp.shapes.solids import solid_of
from lis_grasp.typing import BoolArray, FloatArray, IndexArray
from lis_grasp.underflow import underflows

SAMPLES = 10_000
"""Points on each surface, and along all edges."""

# Steps of the golden sequence in two dimensions (Roberts 2018, "R2"): 1/g, 1/g^2, g^3 = g + 1.
_STEP = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True, slots=True)
class SurfaceError(Record):
    """Deviations between an estimate and the truth, over the explored part.

    Explored are points within `explored_radius` of a contact (Ottenhaus et al. 2016, section IV.D,
    with 50 mm); without contacts, all points. RMSD is the root mean squared distance to the nearest
    point of the other surface, averaged over area (edges: over length).

    Parameters
    ----------
    rmsd
        Explored part of the estimate -> truth [m]. Grows with superfluous surface.
    rmsd_truth_to_estimate
        Explored part of the truth -> estimate [m]. Grows with missing surface.
    edge_rmsd
        Explored part of the true sharp edges -> estimate [m]; None without such edges.
    hausdorff_95
        95 % quantile of the distance, the larger of both directions [m].
    chamfer
        Mean of the two mean distances, estimate -> truth and truth -> estimate [m].
    f_score_1mm, f_score_2mm, f_score_5mm
        Harmonic mean of precision (fraction of the estimate within 1, 2 or 5 mm of the truth) and
        recall (fraction of the truth as near to the estimate), from 0 to 1 (Knapitsch, Park, Zhou
        and Koltun 2017).
    iou
        Volume of the intersection divided by the volume of the union, from 0 to 1. It covers
        everything, explored or not: where nothing was touched the bounds close the estimate. None
        if either is not closed.
    normal_error
        Mean angle between the normals of the estimate and of the nearest true points [rad]; at a
        true edge, the normal of either side.
    coverage
        Explored part of the true area, from 0 to 1.
    explored_radius
        Distance to a contact up to which a point is explored [m]; None where all points are.
    """

    rmsd: float
    rmsd_truth_to_estimate: float
    edge_rmsd: float | None
    hausdorff_95: float
    chamfer: float
    f_score_1mm: float
    f_score_2mm: float
    f_score_5mm: float
    iou: float | None
    normal_error: float
    coverage: float
    explored_radius: float | None


@underflows
@with_advice
def surface_error(
    estimate: trimesh.Trimesh,
    truth: Shape | trimesh.Trimesh | str | Path,
    contacts: Contacts | None = None,
    *,
    explored_radius: float | None = None,
    samples: int = SAMPLES,
) -> SurfaceError:
    """Measure the errors of an estimate against the truth, over the explored part.

    Parameters
    ----------
    estimate
        Mesh of the estimated surface, in O [m].
    truth
        The true object in O [m], or its name or path for `shapes.find`; a mesh has the edges that
        `shapes.sharp_edges` finds.
    contacts
        Contacts of the estimate, in O; None if everything is explored.
    explored_radius
        Points nearer to a contact than this count as explored [m]; required with contacts.
    samples
        Number of points on each surface and along the edges.

    Raises
    ------
    InvalidOptionError
        If the radius or the number of samples is not above 0, or one of the contacts and the radius
        is given without the other.
    InvalidMeshError
        If either is no mesh, or its size fits no object of a hand in metres.
    InvalidContactsError
        If no part of the true surface is within the radius of a contact.
    EstimationError
        If no part of the estimate is within the radius of a contact.

    Examples
    --------
    >>> box, larger = shapes.find("box"), shapes.find("box", 0.13)
    >>> error = surface_error(larger.mesh, box, samples=1000)
    >>> 0.001 < error.rmsd < 0.01
    True
    """
    require_at_least(1, samples=samples)
    if explored_radius is not None:
        require_positive(explored_radius=explored_radius)
    if (contacts is None) != (explored_radius is None):
        raise InvalidOptionError(
            "contacts and explored_radius must be given together; one of them is missing",
            option="explored_radius",
            value=explored_radius,
        )
    truth = find(truth) if isinstance(truth, (str, Path)) else truth
    estimate = require_mesh("estimate", estimate)
    if isinstance(truth, Shape):
        true_mesh, edges = truth.mesh, truth.edges
    else:
        true_mesh = require_mesh("truth", truth)
        edges = sharp_edges(true_mesh)

    def is_explored(points: FloatArray) -> BoolArray:
        if contacts is None or explored_radius is None:
            return np.ones(len(points), dtype=bool)
        return np.asarray(cKDTree(contacts.points).query(points)[0] <= explored_radius)

    on_estimate, estimate_faces = sample_mesh(estimate, samples)
    on_truth, _ = sample_mesh(true_mesh, samples)
    compared, covered = is_explored(on_estimate), is_explored(on_truth)
    if not covered.any():
        raise InvalidContactsError(
            f"some contact must be within {explored_radius:g} m of the true surface; none of"
            f" {len(contacts or ())} is: check that both are in the same frame and in metres",
            field="points",
        )
    if not compared.any():
        raise EstimationError(
            f"the estimate must come within {explored_radius:g} m of some contact; it is farther"
            " from all of them: check that it was made from these contacts"
        )
    to_truth, true_faces = distances_to_mesh(on_estimate[compared], true_mesh)
    to_estimate, _ = distances_to_mesh(on_truth[covered], estimate)
    cosines = np.einsum(
        "pk,pk->p",
        estimate.face_normals[estimate_faces[compared]],
        true_mesh.face_normals[true_faces],
    )
    on_edges = sample_segments(edges, samples) if len(edges) else np.empty((0, 3))
    to_edges, _ = distances_to_mesh(on_edges[is_explored(on_edges)], estimate)
    return SurfaceError(
        rmsd=_root_mean_square(to_truth),
        rmsd_truth_to_estimate=_root_mean_square(to_estimate),
        edge_rmsd=_root_mean_square(to_edges) if len(to_edges) else None,
        hausdorff_95=float(max(np.quantile(d, 0.95) for d in (to_truth, to_estimate))),
        chamfer=0.5 * float(to_truth.mean() + to_estimate.mean()),
        f_score_1mm=_f_score(to_truth, to_estimate, 0.001),
        f_score_2mm=_f_score(to_truth, to_estimate, 0.002),
        f_score_5mm=_f_score(to_truth, to_estimate, 0.005),
        iou=_intersection_over_union(estimate, true_mesh),
        normal_error=float(np.arccos(np.clip(cosines, -1.0, 1.0)).mean()),
        coverage=float(covered.mean()),
        explored_radius=explored_radius if explored_radius is None else float(explored_radius),
    )


def _f_score(to_truth: FloatArray, to_estimate: FloatArray, threshold: float) -> float:
    precision, recall = np.mean(to_truth <= threshold), np.mean(to_estimate <= threshold)
    return float(2.0 * precision * recall / max(precision + recall, np.finfo(float).tiny))


def _intersection_over_union(estimate: trimesh.Trimesh, truth: trimesh.Trimesh) -> float | None:
    first, second = solid_of(estimate), solid_of(truth)
    if any(solid.status() != manifold3d.Error.NoError for solid in (first, second)):
        return None
    both, either = (first ^ second).volume(), (first + second).volume()
    return float(both / either)


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def sample_mesh(mesh: trimesh.Trimesh, count: int) -> tuple[FloatArray, IndexArray]:
    """Return `count` points spread over a mesh in proportion to area, and the triangle of each.

    Stratified by area over the triangles in order; within triangles a low-discrepancy sequence. No
    random numbers: equal meshes have equal samples. Shapes (count, 3) [m] and (count,).
    """
    corners = np.array(mesh.triangles)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    passed = np.cumsum(np.linalg.norm(np.cross(first, second), axis=1))
    faces = np.searchsorted(passed, (np.arange(count) + 0.5) / count * passed[-1], side="right")
    u, v = ((np.arange(count)[:, None] + 0.5) * _STEP % 1.0).T
    beyond = u + v > 1.0  # the other half of the parallelogram
    u, v = np.where(beyond, 1.0 - u, u), np.where(beyond, 1.0 - v, v)
    points = corners[faces, 0] + u[:, None] * first[faces] + v[:, None] * second[faces]
    return points, faces


def sample_segments(segments: FloatArray, count: int) -> FloatArray:
    """Return `count` points evenly along straight pieces (E, 2, 3) put end to end, (count, 3)."""
    steps = segments[:, 1] - segments[:, 0]
    lengths = np.linalg.norm(steps, axis=1)
    passed = np.cumsum(lengths)
    along = (np.arange(count) + 0.5) / count * passed[-1]
    piece = np.searchsorted(passed, along, side="right")
    fraction = (along - (passed - lengths)[piece]) / lengths[piece]
    return np.asarray(segments[piece, 0] + fraction[:, None] * steps[piece])
