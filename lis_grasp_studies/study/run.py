"""Trials of a study: contacts made once; a surface, a grasp and a simulated lift per estimator."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from lis_grasp import pipeline
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.exceptions import EstimationError
from lis_grasp.exploration import STEP_FRACTION, Observation
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io.json_lines import Row
from lis_grasp.results.progress import Stopwatch
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape, placed
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.stages.regrasp import Stages, grasp_with_tactile_check
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import make_prober, true_pose
from lis_grasp.surfaces.estimators import find_estimator
from lis_grasp.task.task import Task
from lis_grasp.typing import FloatArray
from lis_grasp_studies.estimators import COMPARED
from lis_grasp_studies.harness.rows import Job
from lis_grasp_studies.harness.runner import single_thread
from lis_grasp_studies.study.columns import (
    TIMES,
    blank_row,
    failure_in,
    outcome_columns,
    quality_columns,
    search_columns,
)
from lis_grasp_studies.study.trial import KEY_LENGTH, TRUTH, Trial, file_digests, parse_noise

if TYPE_CHECKING:
    from lis_grasp.lifting.outcome import LiftOutcome

DRAKE = "lis_grasp.simulation.drake.lift"
"""Module that loads Drake, for `single_thread`."""


def run_trial(job: Job) -> list[Row]:
    """Return a row for each estimator of a job of a study's `Trial`."""
    with single_thread(DRAKE):
        return list(rows_of(job))


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """Contacts of a trial."""

    contacts: Contacts  #: in the frame E in which the hand is commanded
    X_EO: FloatArray | None  #: (4, 4), true pose of the object at the end; None if it is fixed
    seconds: float  #: of the exploration [s]


def estimate(trial: Trial, estimator: str, contacts: Contacts) -> trimesh.Trimesh:
    """Return the mesh that an estimator makes of a trial's contacts.

    Of contacts alone, if the object is known; else they are judged, the free space is removed, and
    the object stands on the table, for all estimators.
    """
    task = _with_noise(trial)
    is_free = task.world.is_free
    known = Perception(
        estimator=find_estimator(estimator, registry=COMPARED),
        sensor=task.robot.sensor,
        free_space=is_free,
        support_height=0.0 if is_free else None,
        normals="outward",
        options=parse_noise(trial.noise).options(),
    )
    return SurfaceEstimate(contacts, known).mesh


def plan(trial: Trial, mesh: trimesh.Trimesh, shape: Shape, hand: Hand) -> GraspSearch:
    """Plan the grasps of a trial on a mesh."""
    return plan_grasps(scenario_at(trial.run_config(), shape, hand).agent, mesh)


def lift(
    trial: Trial,
    grasp: Grasp,
    shape: Shape,
    hand: Hand,
    X_EO: FloatArray | None,
    *,
    simulator: str = "drake",
) -> LiftOutcome:
    """Simulate the lift of a trial: the grasp on the true object, at a pose (4, 4)."""
    config = trial.run_config(simulator=simulator)
    return pipeline.lift(scenario_at(config, shape, hand, X_EO), grasp)


def scenario_at(task: Task, shape: Shape, hand: Hand, X_EO: FloatArray | None = None) -> Scenario:
    """Return the scenario of a shape that is placed already, and was moved to a pose (4, 4)."""
    return Scenario.from_config(task, shape, hand, recorded={"X_EO": X_EO})


def rows_of(job: Job) -> Iterator[Row]:
    """Yield the rows of a job, as `run_trial` does, with as many threads as the caller permits."""
    # A file that cannot be read is an error of the study, not a result of its trials.
    trial = job.trial
    shape, hand = trial.find_object(), Hand.load(trial.hand)
    for estimator in job.variants:
        watch = Stopwatch()
        row = blank_row(trial, estimator, shape)
        with failure_in(row):
            _fill(row, trial, shape, hand, estimator, watch)
        yield row | {name: watch.seconds.get(name.removeprefix("seconds_")) for name in TIMES}


def _fill(
    row: Row, trial: Trial, shape: Shape, hand: Hand, estimator: str, watch: Stopwatch
) -> None:
    touched = touch(trial, trial.explorer(estimator))
    contacts, X_EO, watch.seconds["touch"] = touched.contacts, touched.X_EO, touched.seconds
    digest = _short_digest(contacts.points, contacts.normals)
    row |= {"contacts": len(contacts), "contacts_digest": digest}
    if not len(contacts):
        raise EstimationError("a surface needs at least one contact; the exploration made none")
    with watch.measure("estimate"):
        truth = shape_at(shape, X_EO)
        mesh = truth.mesh if estimator == TRUTH else estimate(trial, estimator, contacts)
    row |= {"triangles": len(mesh.faces), "watertight": bool(mesh.is_watertight)}
    row |= asdict(surface_error(mesh, truth, contacts, explored_radius=STEP_FRACTION * shape.size))
    if trial.setup.attempts > 1 or trial.setup.closings:
        row |= _grasp_by_touch(trial, estimator, touched, shape, hand)
        return
    # The contacts have been used: grasps depend on the mesh, the object, the hand and the seed.
    task = replace(trial, touches=0, noise="")
    files = file_digests(trial.object, trial.hand)
    place = None if X_EO is None else _short_digest(X_EO)
    columns, seconds = grasp_and_lift(
        GraspTask(mesh_digest(mesh), place, files, task, mesh, X_EO, shape, hand)
    )
    row |= columns
    watch.seconds |= seconds


@dataclass(frozen=True)
class _TrialStages(Stages):
    """The stages of a trial with an estimator, for `grasp_with_tactile_check`."""

    trial: Trial
    estimator: str

    def estimate(self, scenario: Scenario, contacts: Contacts) -> trimesh.Trimesh:
        """Return the mesh of the estimate, or the true mesh where it is now."""
        if self.estimator == TRUTH:
            return scenario.truth.shape_now.mesh
        return estimate(self.trial, self.estimator, contacts)


def _grasp_by_touch(
    trial: Trial, estimator: str, touched: Touched, shape: Shape, hand: Hand
) -> Row:
    """Return the columns of the last of several attempts."""
    scenario = scenario_at(trial.run_config(hand=trial.hand), shape, hand, touched.X_EO)
    stages = _TrialStages(trial, estimator)
    attempts = list(grasp_with_tactile_check(scenario, touched.contacts, stages))
    last = attempts[-1]
    row = search_columns(last.search) | {"executed": sum(a.outcome is not None for a in attempts)}
    if last.outcome is None:
        return row
    truth = last.scenario.truth.shape_now.mesh
    grasp = last.search.grasps[last.rank]
    return row | quality_columns(grasp, truth, trial, hand) | outcome_columns(last.outcome)


def shape_at(shape: Shape, X_EO: FloatArray | None) -> Shape:
    """Return the true object at its pose in E, (4, 4); None for the identity."""
    return shape if X_EO is None else placed(shape, X_EO)


@dataclass(frozen=True, slots=True)
class GraspTask:
    """A grasp to plan and to lift; equal tasks have equal results."""

    mesh_digest: str
    place_digest: str | None
    """Hash of the true object's pose."""
    files: tuple[str, ...]
    """Hashes of the files of object and hand."""
    trial: Trial
    """The object, hand, seed and setup; without touches and noise."""
    # Not compared: the hashes and names identify them.
    mesh: trimesh.Trimesh = field(compare=False)
    X_EO: FloatArray | None = field(compare=False)
    shape: Shape = field(compare=False)
    hand: Hand = field(compare=False)


# Estimators may agree (blend is patch where contacts are few), and planning on the truth does not
# depend on the contacts: a process computes each task once.
@lru_cache(maxsize=64)
def grasp_and_lift(task: GraspTask) -> tuple[Row, dict[str, float]]:
    """Plan, evaluate the best grasp on the truth, lift with it; return columns, and times [s]."""
    watch = Stopwatch()
    row: Row = {}
    with failure_in(row):
        _fill_grasp(row, task, watch)
    return row, watch.seconds


def _fill_grasp(row: Row, task: GraspTask, watch: Stopwatch) -> None:
    trial, shape, hand = task.trial, task.shape, task.hand
    with watch.measure("grasp"):
        search = plan(trial, task.mesh, shape, hand)
    row |= search_columns(search)
    if not search.grasps:
        return
    best = search.grasps[0]
    row |= quality_columns(best, shape_at(shape, task.X_EO).mesh, trial, hand)
    with watch.measure("lift"):
        outcome = lift(trial, best, shape, hand, task.X_EO)
    row |= {"executed": 1} | outcome_columns(outcome)


@dataclass(slots=True)
class _Explored:
    """Progress of an exploration."""

    observations: tuple[Observation, ...] = ()
    X_EO: FloatArray | None = None  # of a free object after them
    touched: dict[int, Touched] = field(default_factory=dict)
    """By the number of contacts that were requested."""
    seconds: float = 0.0


def touch(trial: Trial, explorer: str) -> Touched:
    """Return the contacts of a trial, explored with an estimator.

    Continues what this process explored for a smaller budget of the same trial: all choices depend
    on the past only, so that the contacts of a smaller budget are the first ones of a larger.
    """
    files = file_digests(trial.object, trial.hand)
    start = replace(trial, touches=1, setup=replace(trial.setup, attempts=1, closings=0))
    known = _explored(start, explorer, files)
    if trial.touches in known.touched:
        return known.touched[trial.touches]
    begun = time.perf_counter()
    if trial.touches < max(known.touched, default=0):  # the order of a study is from small to large
        known.observations, known.X_EO, known.seconds = (), None, 0.0
        known.touched.clear()
    config = _with_noise(trial, estimator=explorer, touches=trial.touches)
    scenario = scenario_at(config, trial.find_object(), Hand.load(trial.hand))
    if known.X_EO is not None:
        scenario = scenario.moved(known.X_EO)
    prober = make_prober(scenario, known.observations)
    exploration = pipeline.touch(scenario, prober=prober, recorded=known.observations)
    known.observations, known.X_EO = exploration.observations, true_pose(prober)
    known.seconds += time.perf_counter() - begun
    touched = Touched(exploration.contacts, known.X_EO, known.seconds)
    known.touched[trial.touches] = touched
    return touched


def _with_noise(trial: Trial, **more: Any) -> Task:
    """Return the configuration of a trial's run, with the noise of its sensor."""
    noise = parse_noise(trial.noise)
    return trial.run_config(position_noise=noise.position, normal_noise=noise.normal, **more)


@lru_cache(maxsize=4)
def _explored(start: Trial, explorer: str, files: tuple[str, ...]) -> _Explored:
    """Return the progress of one exploration, which `touch` continues."""
    return _Explored()


def mesh_digest(mesh: trimesh.Trimesh) -> str:
    """Return a hash of a mesh: vertices, faces and vertex attributes."""
    attributes = [mesh.vertex_attributes[name] for name in sorted(mesh.vertex_attributes)]
    return _short_digest(mesh.vertices, mesh.faces, *attributes)


def _short_digest(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:KEY_LENGTH]
