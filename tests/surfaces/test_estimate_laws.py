"""Laws of the default estimate: more contacts, repeated contacts, frames, scales, order."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import BlendedImplicitSurface
from lis_grasp.surfaces.contact_places import ContactPlaces
from lis_grasp.typing import FloatArray

SIZE = 0.2
NAMES = ("box", "cylinder", "half_cylinder", "pentagon", "sphere", "torus")


def surface_samples(name: str) -> tuple[FloatArray, FloatArray]:
    """Points of the true surface, spread by area, and their normals."""
    mesh = shapes.build(name, SIZE).mesh
    rng = np.random.default_rng(7)
    faces = rng.choice(len(mesh.faces), 6000, p=mesh.area_faces / mesh.area)
    weights = rng.dirichlet(np.ones(3), size=len(faces))
    points = np.einsum("nk,nkc->nc", weights, mesh.triangles[faces])
    return points, np.asarray(mesh.face_normals)[faces]


def spread(points: FloatArray, count: int, rng: np.random.Generator) -> list[int]:
    """Indices of points far from each other, the first at random."""
    chosen = [int(rng.integers(len(points)))]
    gaps = np.full(len(points), np.inf)
    while len(chosen) < count:
        gaps = np.minimum(gaps, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(rng.choice(np.flatnonzero(gaps > 0.85 * gaps.max()))))
    return chosen


def root_mean_square(contacts: Contacts, points: FloatArray) -> float:
    """Distance of the true surface from the estimate, to first order, floored at 0.1 mm [m]."""
    surface = BlendedImplicitSurface.from_contacts(contacts)
    slopes = np.linalg.norm(surface.gradient(points), axis=1)
    distances = np.minimum(np.abs(surface.evaluate(points)) / np.maximum(slopes, 0.3), 0.05)
    return float(np.sqrt(np.mean(distances**2)) + 1e-4)


def log_ratio_of_errors(name: str, kind: str, seed: int) -> float:
    """Log of the error with additional true contacts over the error without."""
    points, normals = surface_samples(name)
    rng = np.random.default_rng([seed, NAMES.index(name)])
    first = spread(points, 16, rng)
    if kind == "far":
        more = spread(points, 32, rng)[16:]
    elif kind == "random":
        more = list(rng.choice(len(points), 16, replace=False))
    else:  # two more within 9 mm of each, on the same face
        more = []
        for i in first:
            near = np.linalg.norm(points - points[i], axis=1) < 0.009
            alike = np.flatnonzero(near & (normals @ normals[i] > 0.9))
            more += list(rng.choice(alike, 2))
    chosen = [np.array(first), np.array(first + more)]
    errors = [root_mean_square(Contacts(points[k], normals[k]), points[::9]) for k in chosen]
    return float(np.log(errors[1] / errors[0]))


@pytest.mark.parametrize("count", [60, 300])
def test_every_even_contact_of_a_branched_object_is_a_place(count: int) -> None:
    # A T: its box has three times its area, and a few contacts are far apart along its bars.
    bars = [trimesh.creation.box(sides) for sides in ((0.023, 0.02, 0.2), (0.16, 0.034, 0.036))]
    bars[1].apply_translation((0.0, 0.0, 0.1))
    points = np.vstack([trimesh.sample.sample_surface_even(bar, 3000, seed=3)[0] for bar in bars])
    chosen = points[spread(points, count, np.random.default_rng(3))]
    places = ContactPlaces.of(chosen)
    gaps, _ = cKDTree(chosen).query(chosen, k=2)
    assert len(places.nodes) > 0.9 * count
    assert places.spacing == pytest.approx(np.median(gaps[:, 1]), rel=0.25)


@pytest.mark.slow
def test_more_true_contacts_near_others_lower_the_expected_error() -> None:
    ratios = [log_ratio_of_errors(name, "near", seed=0) for name in NAMES]
    assert np.mean(ratios) < 0.0, np.round(ratios, 2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["far", "random", "near"])
def test_more_true_contacts_lower_the_error_of_most_sets(kind: str) -> None:
    # The mean is that of few sets: exact contacts of flat faces have errors from 0.1 to 10 mm. More
    # than half are lower at two standard deviations of a fair coin's frequency.
    ratios = [log_ratio_of_errors(name, kind, seed) for name in NAMES for seed in range(1, 9)]
    lower = np.mean(np.array(ratios) < 0.0)
    assert lower > 0.5 + 1.0 / np.sqrt(len(ratios)), (lower, np.round(ratios, 2))


def touched(name: str, count: int = 24, seed: int = 0) -> Contacts:
    points, normals = surface_samples(name)
    chosen = spread(points, count, np.random.default_rng(seed))
    return Contacts(points[chosen], normals[chosen])


def test_thinning_the_contacts_degrades_the_estimate_gradually() -> None:
    points, normals = surface_samples("half_cylinder")
    order = spread(points, 64, np.random.default_rng(3))  # every beginning is spread evenly
    errors = [
        root_mean_square(Contacts(points[order[:n]], normals[order[:n]]), points[::9])
        for n in (64, 32, 16, 8, 4)
    ]
    assert max(errors[:2]) < 0.001
    assert errors[2] < 0.02
    assert max(errors) < 0.5 * SIZE
