"""Trials of the paper's experiments: contacts of an object, and each estimator's surface errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.evaluation.surface_samples import sample_mesh
from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.meshing import extract_mesh
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp_studies.compared_estimators import COMPARED, Noise, compared_estimator
from lis_grasp_studies.paper.paper_contacts import (
    NOISE_LEVELS,
    SurfaceWalk,
    random_contacts,
    touch_wedge,
    walk_surface,
    wedge,
)
from lis_grasp_studies.runner import single_thread
from lis_grasp_studies.trial_results import Job

# The order enters the seeds of the noise: append new ones.
Experiment = Literal["whole", "half", "few", "noisy", "wedge", "random"]

EXPLORED_RADIUS = 0.05
"""Surface within this distance of a contact counts as explored [m] (Ottenhaus 2016, IV.B)."""

SENSOR_NOISE = Noise(position=0.001, normal=float(np.deg2rad(3.0)))
"""Noise of the noisy experiment: that of a fair tactile sensor."""

# Points at which the estimate's uncertainty is compared with its error.
_BAND_SAMPLES = 2000

_WALK, _NOISE, _RANDOM = 1, 2, 3


@dataclass(frozen=True, slots=True)
class PaperTrial:
    """An experiment on one object with one seed."""

    experiment: Experiment
    """Contacts: a walk over the whole object ("whole"), over half of it ("half"), its first 5 to 8
    contacts ("few"), all with 1 mm and 3 degrees of noise ("noisy"); as many as "whole" has, drawn
    from the surface uniformly in area ("random"); or 12 contacts round a 90 degree edge, under a
    level of noise ("wedge")."""
    object: str
    """Name of a built-in shape, at 20 cm; for "wedge" the index of the level in NOISE_LEVELS."""
    seed: int
    """Seed of contacts and noise. Experiments on one object and seed have the same walk."""


def trial_key(trial: PaperTrial, estimator: str) -> tuple[Any, ...]:
    """Return the key of a row: experiment, object, seed, estimator, and the source of a plug-in."""
    return *astuple(trial), estimator, COMPARED.digest(estimator)


def key_of(row: Row) -> tuple[Any, ...]:
    """Return the key of a row, as `trial_key` does."""
    names = ("experiment", "object", "seed", "estimator")
    return *(row[name] for name in names), row.get("source", "")


@lru_cache(maxsize=32)
def explored(name: str, seed: int) -> tuple[Shape, SurfaceWalk]:
    """Return an object at the paper's size, and the walk over it that belongs to a seed."""
    shape = shapes.build(name, shapes.PAPER_SIZE)
    index = shapes.NAMES.index(name)
    return shape, walk_surface(shape, rng=np.random.default_rng([_WALK, index, seed]))


def paper_trials(experiments: Sequence[Experiment], seeds: int) -> list[PaperTrial]:
    """Return every trial of some experiments, seed by seed, so that an early stop is balanced."""
    levels = [str(level) for level in range(len(NOISE_LEVELS))]
    return [
        PaperTrial(experiment, name, seed)
        for seed in range(seeds)
        for experiment in experiments
        for name in (levels if experiment == "wedge" else shapes.NAMES)
    ]


def run_paper_trial(job: Job) -> list[Row]:
    """Return a row for each estimator: the trial, and its errors [m] or the reason of failure."""
    trial: PaperTrial = job.trial
    with single_thread():
        shape, clean, noise = _setting(trial)
        contacts = noise.disturb(clean, rng=np.random.default_rng([_NOISE, *_seeds(trial)]))
        return [_row(trial, name, shape, clean, contacts, noise) for name in job.variants]


def _row(
    trial: PaperTrial, name: str, shape: Shape, clean: Contacts, contacts: Contacts, noise: Noise
) -> Row:
    row: Row = {**asdict(trial), "estimator": name, "contacts": len(contacts)}
    source = COMPARED.digest(name)
    row |= {"source": source} if source else {}
    try:
        surface = compared_estimator(name)(contacts, noise)
        mesh = extract_mesh(surface)
        error = surface_error(mesh, shape, clean, explored_radius=EXPLORED_RADIUS)
    except LisGraspError as failure:
        return row | {"failure": str(failure)}
    row |= asdict(error)
    row["within_1_sigma"], row["within_1.96_sigma"] = _band(surface, mesh, shape, clean)
    return row


def _setting(trial: PaperTrial) -> tuple[Shape, Contacts, Noise]:
    """Return the true object, its exact contacts, and the noise."""
    if trial.experiment == "wedge":
        return wedge(), touch_wedge(), NOISE_LEVELS[int(trial.object)]
    shape, walk = explored(trial.object, trial.seed)
    if trial.experiment == "random":
        rng = np.random.default_rng([_RANDOM, *_seeds(trial)])
        return shape, random_contacts(shape, len(walk.contacts), rng=rng), Noise()
    if trial.experiment == "half":
        return shape, walk.until(0.5), Noise()
    if trial.experiment == "few":
        return shape, walk.first(5 + trial.seed % 4), Noise()
    return shape, walk.contacts, SENSOR_NOISE if trial.experiment == "noisy" else Noise()


def _seeds(trial: PaperTrial) -> tuple[int, int, int]:
    names = shapes.NAMES
    number = int(trial.object) if trial.experiment == "wedge" else names.index(trial.object)
    return get_args(Experiment).index(trial.experiment), number, trial.seed


def _band(
    surface: ImplicitSurface, mesh: trimesh.Trimesh, shape: Shape, contacts: Contacts
) -> tuple[float, float]:
    """Return the fractions of the explored truth within 1 and 1.96 standard deviations."""
    points, _ = sample_mesh(shape.mesh, _BAND_SAMPLES)
    points = points[cKDTree(contacts.points).query(points)[0] <= EXPLORED_RADIUS]
    distances, _ = distances_to_mesh(points, mesh)
    deviations = surface.uncertainty(points)
    return (
        float(np.mean(distances <= deviations)),
        float(np.mean(distances <= 1.96 * deviations)),
    )
