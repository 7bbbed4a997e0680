"""One trial of the paper's experiments: an object, its contacts, every estimator, the errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.mesh_distance import distances_to_mesh
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.evaluation.surface_samples import sample_mesh
from lis_grasp.exceptions import LisGraspError
from lis_grasp.experiments.compared_estimators import Noise, contender
from lis_grasp.experiments.paper.surface_walk import SurfaceWalk, walk_surface
from lis_grasp.experiments.paper.wedge import NOISE_LEVELS, touch_wedge, wedge
from lis_grasp.meshing import extract_mesh
from lis_grasp.shapes import Shape
from lis_grasp.surfaces import ImplicitSurface

Experiment = Literal["whole", "half", "few", "noisy", "wedge"]

EXPLORED_RADIUS = 0.05
"""What lies nearer to a contact counts as explored [m] (Ottenhaus et al. 2016, IV.B)."""

SENSOR_NOISE = Noise(position=0.001, normal=float(np.deg2rad(3.0)))
"""Noise of the noisy experiment: a fair tactile sensor's."""

# Points at which the estimate's uncertainty is held against the truth.
_BAND_SAMPLES = 2000

_WALK, _NOISE = 1, 2


@dataclass(frozen=True, slots=True, order=True)
class Trial:
    """An experiment on one object with one seed.

    Parameters
    ----------
    experiment
        "whole": the object fully explored; "half": until half of its surface is; "few": the first
        5 to 8 contacts; "noisy": fully explored, with 1 mm and 3 degrees of noise; "wedge": 12
        contacts round a 90 degree edge, under a level of noise.
    object
        Name of a built-in shape, at 20 cm; for "wedge" the index of the level in NOISE_LEVELS.
    seed
        Of the walk and the noise. Experiments on one object and seed share the walk.
    """

    experiment: Experiment
    object: str
    seed: int


def explored(name: str, seed: int) -> tuple[Shape, SurfaceWalk]:
    """Return an object at the paper's size, and the walk over it that trials of a seed share."""
    shape = shapes.build(name, shapes.PAPER_SIZE)
    index = shapes.NAMES.index(name)
    return shape, walk_surface(shape, rng=np.random.default_rng([_WALK, index, seed]))


def trials(experiments: Sequence[Experiment], seeds: int) -> list[Trial]:
    """Return every trial of some experiments, seed by seed, so that an early stop is balanced."""
    return [
        Trial(experiment, name, seed)
        for seed in range(seeds)
        for experiment in experiments
        for name in (
            [str(level) for level in range(len(NOISE_LEVELS))]
            if experiment == "wedge"
            else shapes.NAMES
        )
    ]


def run_trial(trial: Trial, contenders: Sequence[str]) -> list[dict[str, Any]]:
    """Return a row for each estimator: the trial, and its errors [m] or why there are none."""
    shape, clean, noise = _setting(trial)
    rng = np.random.default_rng([_NOISE, *_key(trial)])
    contacts = noise.disturb(clean, rng=rng)
    rows = []
    for name in contenders:
        row: dict[str, Any] = {**asdict(trial), "estimator": name, "contacts": len(contacts)}
        try:
            surface = contender(name)(contacts, noise)
            mesh = extract_mesh(surface)
            error = surface_error(mesh, shape, clean, explored_radius=EXPLORED_RADIUS)
        except LisGraspError as failure:
            rows.append(row | {"failure": str(failure)})
            continue
        row |= asdict(error)
        row["within_1_sigma"], row["within_1.96_sigma"] = _band(surface, mesh, shape, clean)
        rows.append(row)
    return rows


def _setting(trial: Trial) -> tuple[Shape, Contacts, Noise]:
    """Return the true object, the contacts as they would be without noise, and the noise."""
    if trial.experiment == "wedge":
        return wedge(), touch_wedge(), NOISE_LEVELS[int(trial.object)]
    shape, walk = explored(trial.object, trial.seed)
    if trial.experiment == "half":
        return shape, walk.until(0.5), Noise()
    if trial.experiment == "few":
        return shape, walk.first(5 + trial.seed % 4), Noise()
    return shape, walk.contacts, SENSOR_NOISE if trial.experiment == "noisy" else Noise()


def _key(trial: Trial) -> tuple[int, int, int]:
    names = shapes.NAMES
    number = int(trial.object) if trial.experiment == "wedge" else names.index(trial.object)
    return get_args(Experiment).index(trial.experiment), number, trial.seed


def _band(
    surface: ImplicitSurface, mesh: trimesh.Trimesh, shape: Shape, contacts: Contacts
) -> tuple[float, float]:
    """Return the shares of the explored truth within 1 and 1.96 standard deviations."""
    points, _ = sample_mesh(shape.mesh, _BAND_SAMPLES)
    points = points[cKDTree(contacts.points).query(points)[0] <= EXPLORED_RADIUS]
    distances, _ = distances_to_mesh(points, mesh)
    deviations = surface.uncertainty(points)
    return (
        float(np.mean(distances <= deviations)),
        float(np.mean(distances <= 1.96 * deviations)),
    )
