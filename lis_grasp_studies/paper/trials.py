"""The paper's experiments: walks, random contacts, a wedge; each estimator's surface errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
import trimesh

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.exceptions import LisGraspError
from lis_grasp.exploration import STEP_FRACTION
from lis_grasp.io.json_lines import Row
from lis_grasp.meshing import extract_mesh
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray
from lis_grasp_studies.contact_study.draws import random_contacts
from lis_grasp_studies.contact_study.score import band_rates
from lis_grasp_studies.contact_study.surface_points import SurfacePoints
from lis_grasp_studies.estimators import COMPARED, Noise, compared_estimator
from lis_grasp_studies.harness.experiment import Experiment

# Distance of a new contact from the nearest one, in steps.
_BAND = (0.8, 1.2)
# A fingertip measures no normal on an edge: distance of contacts from edges, in steps.
_CLEARANCE = 0.06

NOISE_LEVELS = tuple(
    Noise(1e-3 * millimetres, float(np.deg2rad(degrees)))
    for millimetres, degrees in ((0, 0), (1, 2.5), (2, 5), (4, 10), (6, 15), (8, 20))
)
"""Noise of position and normal, from none to more than any sensor has."""

_SPACING = 0.05
_SIDE = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceWalk:
    """The contacts of one walk over an object, in order, and what was explored after each."""

    contacts: Contacts
    """Exact points and normals of the true surface, in O."""
    coverage: FloatArray
    """Shape (N,), fraction of the true area within a step of a contact that does not face away,
    after each contact."""

    def until(self, coverage: float) -> Contacts:
        """Return the contacts up to the one that explored at least this fraction of the object."""
        enough = np.flatnonzero(self.coverage >= coverage)
        return self.first(int(enough[0]) + 1 if len(enough) else len(self.contacts))

    def first(self, touches: int) -> Contacts:
        """Return the first contacts."""
        return self.contacts.subset(np.arange(min(touches, len(self.contacts))))


def walk_surface(shape: Shape, *, rng: np.random.Generator) -> SurfaceWalk:
    """Touch an object step by step until all of it is within a step of a contact.

    The first contact is anywhere; each next one is drawn from the true surface about a step away
    from the contacts so far. The paper's explorer chooses targets by an estimate, and does not say
    which; contacts chosen on the true surface depend on no estimator. They are even, though, which
    favours estimators with sharp edges.

    A step is a quarter of the object's size.
    """
    step = STEP_FRACTION * shape.size
    surface = SurfacePoints.with_face_normals(shape)
    can_touch = surface.edge_distances > _CLEARANCE * step
    gaps = np.full(len(surface.points), np.inf)  # to the nearest contact that does not face away
    chosen: list[int] = []
    coverage: list[float] = []
    while True:
        open_ = can_touch & (gaps > _BAND[0] * step)
        frontier = np.flatnonzero(open_ & (gaps < _BAND[1] * step))
        if len(frontier):
            k = rng.choice(frontier)
        elif not open_.any():
            break
        else:  # at the start, and where a part is connected to nothing touched
            rest = np.flatnonzero(open_)
            k = rng.choice(rest[gaps[rest] == gaps[rest].min()])
        chosen.append(int(k))
        surface.shrink_gaps(gaps, k)
        coverage.append(float(np.mean(gaps < step)))
    return SurfaceWalk(surface.contacts(np.array(chosen)), np.array(coverage))


def wedge() -> Shape:
    """Return a large cube with an edge along y at the origin; its other edges are far away."""
    half = 0.5 * _SIDE
    cube = trimesh.creation.box(bounds=[[-_SIDE, -half, -_SIDE], [0.0, half, 0.0]])
    return Shape.from_mesh(cube, "wedge")


def touch_wedge() -> Contacts:
    """Return 12 contacts 50 mm apart: 2 columns of 3 on each face, the first 25 mm from the edge.

    The paper gives their number and spacing; their arrangement is ours.
    """
    away = -_SPACING * np.array([0.5, 1.5])
    along = _SPACING * np.array([-1.0, 0.0, 1.0])
    a, y = (values.ravel() for values in np.meshgrid(away, along))
    zero, one = np.zeros(6), np.ones(6)
    top = np.column_stack([a, y, zero]), np.column_stack([zero, zero, one])
    side = np.column_stack([zero, y, a]), np.column_stack([one, zero, zero])
    return Contacts(np.vstack([top[0], side[0]]), np.vstack([top[1], side[1]]))


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


def paper_trials(experiments: Sequence[PaperExperiment], seeds: Iterable[int]) -> list[PaperTrial]:
    """Return every trial of some experiments, seed by seed, so that an early stop is balanced."""
    levels = [str(level) for level in range(len(NOISE_LEVELS))]
    return [
        PaperTrial(experiment, name, seed)
        for seed in seeds
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
    rates = band_rates(
        surface, shape.mesh, mesh, clean, explored_radius=EXPLORED_RADIUS, bounds=surface.bounds
    )
    return row | asdict(error) | dict(zip(WITHIN, rates, strict=True))


def _source(estimator: str) -> str:
    return COMPARED.digest(estimator)  # a method of the registry cannot be pickled


PAPER = Experiment("paper", score_paper_trial, source=_source)
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
