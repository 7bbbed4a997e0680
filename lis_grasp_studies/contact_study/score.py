"""Scores of estimates: errors, calibration, time of the fit; the experiment of contact sets."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import sample_mesh, surface_error
from lis_grasp.exceptions import LisGraspError
from lis_grasp.exploration import STEP_FRACTION
from lis_grasp.io.json_lines import Row
from lis_grasp.meshing import extract_mesh
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.shapes.solids import solid_of
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.surfaces.contact_places import ContactPlaces, box_of
from lis_grasp.typing import FloatArray
from lis_grasp_studies.contact_study.contact_sets import (
    CASES,
    ContactCase,
    ContactSet,
    balanced,
    contact_set,
)
from lis_grasp_studies.estimators import TUNED, NoisyEstimator, compared_estimator
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.test_objects.solid_modelling import Solid, mesh_of

CELLS = 48
"""Cells along the box."""

SAMPLES = 2000
"""Points on each surface and along all edges."""

# Points nearer to the middle of the meshing box than this, of half its sides, are not on its faces.
_INSIDE = 1.0 - 1e-6

Bands = tuple[float | None, float | None, float | None, float | None]
"""The four rates of `EstimateScore`."""

EXPLORED = STEP_FRACTION
"""Explored is what is within this fraction of the object's size of a contact: 5 cm at 20 cm."""

Box = Literal["contacts", "explored", "own"]
"""Where an estimate is meshed: in the box of `gpis`, the contacts' box grown by their spacing; in
that grown by the explored radius, which clips nothing that is measured; or within its own `bounds`.
The first two are the same for all."""

TRUTH = "truth"
"""Name of the true surface among estimators, clipped by the box: the smallest possible errors."""


@dataclass(frozen=True, slots=True)
class EstimateScore:
    """Errors of one estimate over the explored part, and the calibration of its uncertainty.

    Parameters
    ----------
    truth_to_estimate, estimate_to_truth
        Root mean squared distance [m], see `SurfaceError`.
    edge
        From true edges to the estimate, root mean square [m]; None without explored edges.
    normal_error
        Mean angle to the true normals [rad].
    within_68, within_95
        Fraction of the estimate whose distance from the truth is within 1 and 1.96 standard
        deviations, as `uncertainty` gives them there; None if the estimate failed.
    truth_within_68, truth_within_95
        The same from the true surface to the estimate, with the uncertainty at the true points.
    fit_seconds
        Time to make the surface [s].
    failure
        Reason of a failure, or empty. A failed estimate counts as one that misses everything: its
        distances are the explored radius, its normals are off by 90 degrees.
    """

    truth_to_estimate: float
    estimate_to_truth: float
    edge: float | None
    normal_error: float
    within_68: float | None
    within_95: float | None
    truth_within_68: float | None
    truth_within_95: float | None
    fit_seconds: float
    failure: str = ""


def score_estimate(
    estimator: NoisyEstimator, data: ContactSet, *, box: Box = "contacts"
) -> EstimateScore:
    """Fit an estimator to a contact set, mesh it and measure it.

    Errors reward a box that by chance ends where the object does: compare estimates within the same
    kind of box only. A library's error is a failure too.
    """
    start = time.process_time()
    seconds = 0.0
    try:
        surface = estimator(data.contacts, data.given_noise)
        seconds = time.process_time() - start
        bounds = np.asarray(surface.bounds) if box == "own" else meshing_box(data, box)
        cell = float(np.ptp(bounds, axis=0).max()) / CELLS
        mesh = extract_mesh(surface, bounds=bounds, resolution=cell)
        radius, truth = EXPLORED * data.shape.size, data.shape.mesh
        on_estimate, on_truth = (
            band_rates(surface, *both, data.exact, explored_radius=radius, bounds=bounds)
            for both in ((mesh, truth), (truth, mesh))
        )
        return _measured(mesh, data, (*on_estimate, *on_truth), seconds)
    except (LisGraspError, ArithmeticError, ValueError, RuntimeError, MemoryError) as failure:
        return _failed(data, seconds, f"{type(failure).__name__}: {failure}")


def score_truth(data: ContactSet, *, box: Box = "contacts") -> EstimateScore:
    """Measure the true surface, clipped by the box that estimates are meshed in.

    No estimate has smaller errors, but for luck: where contacts leave much outside of their box,
    the errors of all estimators are large.
    """
    clipped = solid_of(data.shape.mesh)
    if box != "own":
        low, high = meshing_box(data, box)
        clipped ^= Solid.cube(tuple(high - low)).translate(tuple(low))
    return _measured(mesh_of(clipped), data, (None, None, None, None), 0.0)


def meshing_box(data: ContactSet, box: Box) -> FloatArray:
    """Return the box that every estimate of a contact set is meshed in, shape (2, 3) [m]."""
    if box == "contacts":
        return box_of(data.contacts, ContactPlaces.of(data.contacts.points))
    return data.contacts.bounds + EXPLORED * data.shape.size * np.array([[-1.0], [1.0]])


def _measured(
    mesh: trimesh.Trimesh, data: ContactSet, bands: Bands, seconds: float
) -> EstimateScore:
    radius = EXPLORED * data.shape.size
    error = surface_error(mesh, data.shape, data.exact, explored_radius=radius, samples=SAMPLES)
    return EstimateScore(
        error.rmsd_truth_to_estimate,
        error.rmsd,
        error.edge_rmsd,
        error.normal_error,
        *bands,
        seconds,
    )


def band_rates(
    surface: ImplicitSurface,
    source: trimesh.Trimesh,
    target: trimesh.Trimesh,
    contacts: Contacts,
    *,
    explored_radius: float,
    bounds: FloatArray,
) -> tuple[float, float]:
    """Return the fractions of a mesh within 1 and 1.96 standard deviations of another.

    Only its part within the explored radius [m] of a contact counts, inside of the meshing box
    `bounds` (2, 3) [m]: on its faces the box ends an estimate, not the surface.
    `surface.uncertainty` gives the standard deviation at its points.
    """
    points, _ = sample_mesh(source, SAMPLES)
    inside = np.abs(points - bounds.mean(axis=0)) < 0.5 * _INSIDE * np.ptp(bounds, axis=0)
    explored = cKDTree(contacts.points).query(points)[0] <= explored_radius
    points = points[explored & inside.all(axis=1)]
    distances, _ = distances_to_mesh(points, target)
    deviations = surface.uncertainty(points)
    return (
        float(np.mean(distances <= deviations)),
        float(np.mean(distances <= 1.96 * deviations)),
    )


def _failed(data: ContactSet, seconds: float, reason: str) -> EstimateScore:
    radius = EXPLORED * data.shape.size
    edge = radius if len(data.shape.edges) else None
    text = " ".join(reason.split())
    return EstimateScore(radius, radius, edge, 0.5 * np.pi, None, None, None, None, seconds, text)


_contacts_of = lru_cache(maxsize=1)(contact_set)  # of all estimators of a trial


@dataclass(frozen=True, slots=True)
class SurfaceTrial:
    """One contact set and the box that its estimates are meshed in."""

    shape: str
    """Name of a test object, or path of a mesh file."""
    case: ContactCase
    seed: int
    box: Box

    def facts(self) -> Row:
        """Return the columns that identify the trial."""
        name, case = Path(self.shape).stem, self.case.name
        return {"object": name, "case": case, "seed": self.seed, "box": self.box}


def surface_trials(
    shapes: Sequence[str], *, part: int, seeds: Iterable[int], box: Box
) -> list[SurfaceTrial]:
    """Return the trials of some shapes: each meets one case of `part`, the same for every seed."""
    pairs = balanced(shapes, CASES, part)
    return [SurfaceTrial(shape, case, seed, box) for seed in seeds for shape, case in pairs]


def score_trial(trial: SurfaceTrial, estimator: str) -> Row:
    """Return the `EstimateScore` of an estimator, and facts of its contact set."""
    data: ContactSet = _contacts_of(trial.shape, trial.case, trial.seed)
    if estimator == TRUTH:
        score = score_truth(data, box=trial.box)
    else:
        score = score_estimate(compared_estimator(estimator, TUNED), data, box=trial.box)
    facts = {"family": data.family, "kind": trial.case.kind}
    return facts | {"contacts": len(data.contacts), "size": data.shape.size} | asdict(score)


def _source(estimator: str) -> str:
    return "" if estimator == TRUTH else TUNED.digest(estimator)


SURFACES = Experiment("surfaces", score_trial, SurfaceTrial.facts, source=_source)
"""The study of surfaces."""
