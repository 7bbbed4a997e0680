"""One trial: contacts made once; then, for each estimator, a surface, a grasp and its proof."""

from __future__ import annotations

import hashlib
import json
import platform
import threading
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

import trimesh
from threadpoolctl import threadpool_limits

import lis_grasp
from lis_grasp import pipeline
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import SurfaceError, surface_error
from lis_grasp.exceptions import EstimationError, LisGraspError
from lis_grasp.experiments.compared_estimators import contender
from lis_grasp.experiments.study.attempt import Attempt, attempt, failure, mesh_digest
from lis_grasp.experiments.study.exploring import contacts_of
from lis_grasp.experiments.study.keys import (
    KEY_LENGTH,
    columns_of,
    file_digests,
    object_digest,
    row_key,
)
from lis_grasp.experiments.study.study import OWN, TRUTH, Setup, Trial, find_object, parse_noise
from lis_grasp.exploration import STEP_FRACTION
from lis_grasp.hands.hand import Hand
from lis_grasp.io.json_lines import Row
from lis_grasp.meshing import extract_mesh
from lis_grasp.shapes import Shape

TIMES = ("seconds_touch", "seconds_estimate", "seconds_grasp", "seconds_lift")
"""Columns that differ between equal trials."""

MACHINE = "versions"
"""Column that says on what a row was made."""

_ERRORS = tuple(SurfaceError.__dataclass_fields__)
_ALONE = threading.Lock()


@dataclass(frozen=True, slots=True)
class Job:
    """A trial to run, for some estimators.

    Parameters
    ----------
    trial, setup
        What to do.
    estimators
        For which.
    """

    trial: Trial
    setup: Setup
    estimators: tuple[str, ...]


def run_job(job: Job) -> list[Row]:
    """Return a row for each estimator of a job.

    One thread a process: as fast where all cores are busy, and sums in the same order everywhere.
    That holds wherever it runs, also in a worker that joined a cluster late and has more threads:
    there jobs wait for each other.
    """
    # Only libraries that are loaded can be limited, and Drake brings one of its own.
    import_module("lis_grasp.simulation.simulate_lift")
    with _ALONE, threadpool_limits(1):
        return list(_rows(job))


def explorer_of(setup: Setup, estimator: str) -> str:
    """Return the estimator that drives the exploration for an estimator."""
    if setup.explorer != OWN:
        return setup.explorer
    # The truth needs no contacts; they say what was explored.
    return Setup().explorer if estimator == TRUTH else estimator


def estimate(trial: Trial, estimator: str, contacts: Contacts) -> trimesh.Trimesh:
    """Return the mesh that an estimator makes of a trial's contacts, and of nothing else."""
    return extract_mesh(contender(estimator)(contacts, parse_noise(trial.noise)))


def _rows(job: Job) -> Iterator[Row]:
    # What cannot be read is a mistake of the study, and no result of its trials.
    shape, hand = find_object(job.trial.object, job.setup), Hand.load(job.trial.hand)
    for estimator in job.estimators:
        watch = pipeline.Stopwatch()
        row = _blank_row(job.trial, job.setup, estimator, shape)
        try:
            _fill(row, job.trial, job.setup, shape, hand, estimator, watch)
        except LisGraspError as error:
            row |= failure(error)
        yield row | {name: watch.seconds.get(name.removeprefix("seconds_")) for name in TIMES}


def _fill(
    row: Row,
    trial: Trial,
    setup: Setup,
    shape: Shape,
    hand: Hand,
    estimator: str,
    watch: pipeline.Stopwatch,
) -> None:
    """Write into a row what a trial comes to, as far as it comes."""
    explorer = explorer_of(setup, estimator)
    contacts, watch.seconds["touch"] = contacts_of(trial, setup, explorer)
    row |= {"contacts": len(contacts), "contacts_digest": _digest(contacts)}
    if not len(contacts):
        raise EstimationError("a surface needs at least one contact; the exploration made none")
    with watch.measure("estimate"):
        mesh = shape.mesh if estimator == TRUTH else estimate(trial, estimator, contacts)
    row |= {"triangles": len(mesh.faces), "watertight": bool(mesh.is_watertight)}
    row |= asdict(surface_error(mesh, shape, contacts, explored_radius=STEP_FRACTION * shape.size))
    files = file_digests(trial.object, trial.hand)
    task = Attempt(
        *(mesh_digest(mesh), trial.object, trial.hand, files, trial.seed, setup),
        *(mesh, shape, hand),
    )
    columns, seconds = attempt(task)
    row |= columns
    watch.seconds |= seconds


def _blank_row(trial: Trial, setup: Setup, estimator: str, shape: Shape) -> Row:
    """Return a row of a trial that came to nothing yet: not lifted, not held."""
    return {
        "key": row_key(trial, setup, estimator),
        **columns_of(trial),
        "object_digest": object_digest(trial.object),
        "estimator": estimator,
        **asdict(setup),
        "version": lis_grasp.__version__,
        MACHINE: json.dumps(_versions(), sort_keys=True),
        "edged": bool(len(shape.edges)),
        **dict.fromkeys(("contacts", "contacts_digest", "triangles", "watertight", *_ERRORS)),
        **dict.fromkeys(("grasps_found", "candidates", "rejections")),
        **dict.fromkeys(("epsilon_estimate", "epsilon_truth", "epsilon_gap")),
        **dict.fromkeys(("closure_probability", "success_probability")),
        "lifted": False,
        "held": False,
        **dict.fromkeys(("slip", "acceleration_survived", "reason", "failure")),
    }


@lru_cache(maxsize=1)
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in ("drake", "numpy", "scipy", "trimesh", "python-fcl"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "none"
    return found


def _digest(contacts: Contacts) -> str:
    """Return a hash of the contacts, which tells that estimators got the same."""
    content = contacts.points.tobytes() + contacts.normals.tobytes()
    return hashlib.sha256(content).hexdigest()[:KEY_LENGTH]
