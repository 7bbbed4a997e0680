"""Trials of the paper's experiments: contacts of an object, and each estimator's surface errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.meshing import extract_mesh
from lis_grasp.shapes import Shape
from lis_grasp_studies.contact_study.draws import random_contacts
from lis_grasp_studies.contact_study.score import band_rates
from lis_grasp_studies.contact_study.surface_points import SurfacePoints
from lis_grasp_studies.estimators import COMPARED, Noise, compared_estimator
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.paper.contacts import (
    NOISE_LEVELS,
    SurfaceWalk,
    touch_wedge,
    walk_surface,
    wedge,
)

# The order enters the seeds of the noise: append new ones.
PaperExperiment = Literal["whole", "half", "few", "noisy", "wedge", "random"]
EXPERIMENTS: tuple[PaperExperiment, ...] = get_args(PaperExperiment)

EXPLORED_RADIUS = 0.05
"""Surface within this distance of a contact counts as explored [m] (Ottenhaus 2016, IV.B)."""

SENSOR_NOISE = Noise(position=0.001, normal=float(np.deg2rad(3.0)))
"""Noise of the noisy experiment: that of a fair tactile sensor."""

WITHIN = ("within_1_sigma", "within_1.96_sigma")
"""Columns: fractions of the explored truth within so many standard deviations of the estimate."""

_WALK, _NOISE, _RANDOM = 1, 2, 3


@dataclass(frozen=True, slots=True)
class PaperTrial:
    """An experiment on one object with one seed."""

    experiment: PaperExperiment
    """Contacts: a walk over the whole object ("whole"), over half of it ("half"), its first 5 to 8
    contacts ("few"), all with 1 mm and 3 degrees of noise ("noisy"); as many as "whole" has, drawn
    from the surface uniformly in area ("random"); or 12 contacts round a 90 degree edge, under a
    level of noise ("wedge")."""
    object: str
    """Name of a built-in shape, at 20 cm; for "wedge" the index of the level in NOISE_LEVELS."""
    seed: int
    """Seed of contacts and noise. Experiments on one object and seed have the same walk."""


@lru_cache(maxsize=32)
def explored(name: str, seed: int) -> tuple[Shape, SurfaceWalk]:
    """Return an object at the paper's size, and the walk over it that belongs to a seed."""
    shape = shapes.build(name, shapes.PAPER_SIZE)
    index = shapes.NAMES.index(name)
    return shape, walk_surface(shape, rng=np.random.default_rng([_WALK, index, seed]))


def paper_trials(experiments: Sequence[PaperExperiment], seeds: int) -> list[PaperTrial]:
    """Return every trial of some experiments, seed by seed, so that an early stop is balanced."""
    levels = [str(level) for level in range(len(NOISE_LEVELS))]
    return [
        PaperTrial(experiment, name, seed)
        for seed in range(seeds)
        for experiment in experiments
        for name in (levels if experiment == "wedge" else shapes.NAMES)
    ]


def score_paper_trial(trial: PaperTrial, estimator: str) -> Row:
    """Return the errors [m] of an estimator in a trial, or the reason of its failure."""
    shape, clean, noise = _setting(trial)
    contacts = noise.disturb(clean, rng=np.random.default_rng([_NOISE, *_seeds(trial)]))
    row: Row = {"contacts": len(contacts)}
    try:
        surface = compared_estimator(estimator)(contacts, noise)
        mesh = extract_mesh(surface)
        error = surface_error(mesh, shape, clean, explored_radius=EXPLORED_RADIUS)
    except LisGraspError as failure:
        return row | {"failure": str(failure)}
    rates = band_rates(surface, shape.mesh, mesh, clean, explored_radius=EXPLORED_RADIUS)
    return row | asdict(error) | dict(zip(WITHIN, rates, strict=True))


PAPER = Experiment("paper", score_paper_trial, source=COMPARED.digest)
"""The experiments of the paper."""


@lru_cache(maxsize=1)  # of all estimators of a trial
def _setting(trial: PaperTrial) -> tuple[Shape, Contacts, Noise]:
    """Return the true object, its exact contacts, and the noise."""
    if trial.experiment == "wedge":
        return wedge(), touch_wedge(), NOISE_LEVELS[int(trial.object)]
    shape, walk = explored(trial.object, trial.seed)
    if trial.experiment == "random":
        rng = np.random.default_rng([_RANDOM, *_seeds(trial)])
        surface = SurfacePoints.with_face_normals(shape)
        return shape, random_contacts(surface, len(walk.contacts), rng=rng), Noise()
    if trial.experiment == "half":
        return shape, walk.until(0.5), Noise()
    if trial.experiment == "few":
        return shape, walk.first(5 + trial.seed % 4), Noise()
    return shape, walk.contacts, SENSOR_NOISE if trial.experiment == "noisy" else Noise()


def _seeds(trial: PaperTrial) -> tuple[int, int, int]:
    names = shapes.NAMES
    number = int(trial.object) if trial.experiment == "wedge" else names.index(trial.object)
    return EXPERIMENTS.index(trial.experiment), number, trial.seed
