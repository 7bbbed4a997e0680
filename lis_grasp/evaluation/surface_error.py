"""Errors of an estimated surface against the true one, over the explored part."""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_samples import sample_mesh, sample_segments
from lis_grasp.exceptions import (
    EstimationError,
    InvalidContactsError,
    require_at_least,
    require_positive,
)
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.typing import BoolArray, FloatArray

SAMPLES = 10_000
"""Points on each surface, and along all edges."""


@dataclass(frozen=True, slots=True)
class SurfaceError:
    """Deviations between an estimate and the truth, over the explored part.

    Explored are points within `explored_radius` of a contact (Ottenhaus et al. 2016, section IV.D,
    with 50 mm). RMSD is the root mean squared distance to the nearest point of the other surface,
    averaged over area (edges: over length).

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
        Harmonic mean of precision (fraction of the estimate within so many millimetres of the
        truth) and recall (fraction of the truth as near to the estimate), from 0 to 1 (Knapitsch,
        Park, Zhou and Koltun 2017).
    iou
        Volume of the intersection over that of the union, from 0 to 1. It covers everything,
        explored or not: where nothing was touched the bounds close the estimate. None if the
        estimate is not closed.
    normal_error
        Mean angle between the estimate's normals and those of the nearest true points [rad]; at a
        true edge, the normal of either side.
    coverage
        Explored part of the true area, from 0 to 1.
    explored_radius
        [m].
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
    explored_radius: float


def surface_error(
    estimate: trimesh.Trimesh,
    truth: Shape,
    contacts: Contacts,
    *,
    explored_radius: float,
    samples: int = SAMPLES,
) -> SurfaceError:
    """Measure the errors of an estimate against the truth, over the explored part.

    Distances are exact; they are averaged over even samples, without random numbers.

    Parameters
    ----------
    estimate
        Mesh of the estimated surface, in O [m].
    truth
        The true object, with its sharp edges, in O [m].
    contacts
        Of the estimate, in O.
    explored_radius
        Points nearer to a contact than this count as explored [m].
    samples
        Number of points on each surface and along the edges.

    Raises
    ------
    InvalidOptionError
        If the radius or the number of samples is not above 0.
    InvalidContactsError
        If no part of the true surface is within the radius of a contact.
    EstimationError
        If no part of the estimate is.
    """
    require_positive(explored_radius=explored_radius)
    require_at_least(1, samples=samples)
    on_estimate, estimate_faces = sample_mesh(estimate, samples)
    on_truth, _ = sample_mesh(truth.mesh, samples)
    known = _explored(on_estimate, contacts, explored_radius)
    of_truth = _explored(on_truth, contacts, explored_radius)
    if not of_truth.any():
        raise InvalidContactsError(
            f"some contact must be within {explored_radius:g} m of the true surface; none of"
            f" {len(contacts)} is: check that both are in the same frame and in metres"
        )
    if not known.any():
        raise EstimationError(
            f"the estimate must come within {explored_radius:g} m of some contact; it is farther"
            " from all of them: check that it was made from these contacts"
        )
    to_truth, true_faces = distances_to_mesh(on_estimate[known], truth.mesh)
    to_estimate, _ = distances_to_mesh(on_truth[of_truth], estimate)
    cosines = np.einsum(
        "pk,pk->p",
        estimate.face_normals[estimate_faces[known]],
        truth.mesh.face_normals[true_faces],
    )
    return SurfaceError(
        rmsd=_root_mean_square(to_truth),
        rmsd_truth_to_estimate=_root_mean_square(to_estimate),
        edge_rmsd=_edge_rmsd(estimate, truth.edges, contacts, explored_radius, samples),
        hausdorff_95=float(max(np.quantile(d, 0.95) for d in (to_truth, to_estimate))),
        chamfer=0.5 * float(to_truth.mean() + to_estimate.mean()),
        f_score_1mm=_f_score(to_truth, to_estimate, 0.001),
        f_score_2mm=_f_score(to_truth, to_estimate, 0.002),
        f_score_5mm=_f_score(to_truth, to_estimate, 0.005),
        iou=_intersection_over_union(estimate, truth.mesh),
        normal_error=float(np.arccos(np.clip(cosines, -1.0, 1.0)).mean()),
        coverage=float(of_truth.mean()),
        explored_radius=float(explored_radius),
    )


def _edge_rmsd(
    estimate: trimesh.Trimesh,
    edges: FloatArray,
    contacts: Contacts,
    explored_radius: float,
    samples: int,
) -> float | None:
    if not len(edges):
        return None
    points = sample_segments(edges, samples)
    points = points[_explored(points, contacts, explored_radius)]
    if not len(points):
        return None
    return _root_mean_square(distances_to_mesh(points, estimate)[0])


def _f_score(to_truth: FloatArray, to_estimate: FloatArray, threshold: float) -> float:
    precision, recall = np.mean(to_truth <= threshold), np.mean(to_estimate <= threshold)
    return float(2.0 * precision * recall / max(precision + recall, np.finfo(float).tiny))


def _intersection_over_union(estimate: trimesh.Trimesh, truth: trimesh.Trimesh) -> float | None:
    first, second = _solid(estimate), _solid(truth)
    if first.status() != manifold3d.Error.NoError:
        return None
    both, either = (first ^ second).volume(), (first + second).volume()
    return float(both / either)


def _solid(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """Return a closed mesh as a solid of manifold3d, whose booleans are exact."""
    return manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.ascontiguousarray(mesh.vertices, dtype=np.float64),
            tri_verts=np.ascontiguousarray(mesh.faces, dtype=np.uint64),
        )
    )


def _explored(points: FloatArray, contacts: Contacts, radius: float) -> BoolArray:
    if not len(contacts):
        return np.zeros(len(points), dtype=bool)
    distances, _ = cKDTree(contacts.points).query(points)
    return np.asarray(distances <= radius)


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
