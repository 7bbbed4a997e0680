"""One trial: contacts made once; then, for each estimator, a surface, a grasp and its proof."""

from __future__ import annotations

import hashlib
import json
import platform
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import trimesh
from threadpoolctl import threadpool_limits

import lis_grasp
from lis_grasp import pipeline
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.grasp_on_truth import epsilon_on_truth
from lis_grasp.evaluation.surface_error import SurfaceError, surface_error
from lis_grasp.exceptions import EstimationError, LisGraspError
from lis_grasp.exploration import STEP_FRACTION, TactileSensor
from lis_grasp.grasping.hand import HAND_NAMES, Hand
from lis_grasp.shapes import NAMES, Shape
from lis_grasp.study.study import OWN, TRUTH, Setup, Trial, find_object, parse_noise

Row = dict[str, Any]

TIMES = ("seconds_touch", "seconds_estimate", "seconds_grasp", "seconds_lift")
"""Columns that differ between equal trials."""

MACHINE = "versions"
"""Column that says on what a row was made."""

NO_GRASP, FAILED = "no_grasp", "failed"
"""Reasons of rows that came to no lift."""

_ERRORS = tuple(SurfaceError.__dataclass_fields__)
_KEY_LENGTH = 16


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


def row_key(trial: Trial, setup: Setup, estimator: str) -> str:
    """Return the name of a row: a hash of all that decides what is in it.

    An object's mesh file and a hand's YAML, URDF and SDF count by what is in them.
    """
    facts = [asdict(trial), asdict(setup), estimator, *_contents(trial)]
    text = json.dumps(facts, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_KEY_LENGTH]


def run_job(job: Job) -> list[Row]:
    """Return a row for each estimator of a job.

    One thread a process: as fast where all cores are busy, and sums in the same order everywhere.
    """
    with threadpool_limits(1):
        return list(_rows(job))


def _rows(job: Job) -> Iterator[Row]:
    # What cannot be read is a mistake of the study, and no result of its trials.
    shape, hand = find_object(job.trial.object, job.setup), Hand.load(job.trial.hand)
    for estimator in job.estimators:
        watch = pipeline.Stopwatch()
        row = _blank_row(job.trial, job.setup, estimator, shape)
        try:
            _fill(row, job.trial, job.setup, shape, hand, estimator, watch)
        except LisGraspError as failure:
            row |= {"reason": FAILED, "failure": f"{type(failure).__name__}: {failure}"}
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
    explorer = setup.explorer if setup.explorer != OWN else estimator
    if explorer == TRUTH:
        explorer = Setup().explorer  # the truth needs no contacts; they say what was explored
    contacts, watch.seconds["touch"] = contacts_of(trial, setup, explorer)
    row |= {"contacts": len(contacts), "contacts_digest": _digest(contacts)}
    if not len(contacts):
        raise EstimationError("a surface needs at least one contact; the exploration made none")
    with watch.measure("estimate"):
        mesh = (
            shape.mesh
            if estimator == TRUTH
            else pipeline.estimate(contacts, estimator, _sensor(trial))[1]
        )
    row |= {"triangles": len(mesh.faces), "watertight": bool(mesh.is_watertight)}
    row |= asdict(surface_error(mesh, shape, contacts, explored_radius=STEP_FRACTION * shape.size))
    _grasp(row, trial, setup, shape, hand, mesh, watch)


def _grasp(
    row: Row,
    trial: Trial,
    setup: Setup,
    shape: Shape,
    hand: Hand,
    mesh: trimesh.Trimesh,
    watch: pipeline.Stopwatch,
) -> None:
    """Plan on the estimate; measure the best grasp on the truth, and lift with it."""
    with watch.measure("grasp"):
        search = pipeline.plan(
            mesh,
            hand,
            support=pipeline.support_height(shape),
            friction=setup.friction,
            count=setup.grasps,
            seed=trial.seed,
        )
    row |= {
        "grasps_found": len(search.grasps),
        "candidates": search.candidates,
        "rejections": json.dumps(dict(search.rejections), sort_keys=True),
        "reason": NO_GRASP,
    }
    if not search.grasps:
        return
    best = search.grasps[0]
    on_estimate = float(best.quality["epsilon"])
    on_truth = float(epsilon_on_truth(best, shape.mesh, hand, friction=setup.friction))
    row |= {
        "epsilon_estimate": on_estimate,
        "epsilon_truth": on_truth,
        "epsilon_gap": on_estimate - on_truth,
        "closure_probability": float(best.quality["closure_probability"]),
        "success_probability": float(best.quality["success_probability"]),
    }
    with watch.measure("lift"):
        outcome = pipeline.prove(shape, hand, best, mass=setup.mass, friction=setup.friction)
    row |= {
        "lifted": bool(outcome.lifted),
        "held": bool(outcome.held),
        "slip": float(outcome.slip),
        "acceleration_survived": float(outcome.acceleration_survived),
        "reason": outcome.reason,
    }


# An exploration is a function of its arguments: it does not matter which process makes it, and a
# process that runs a trial for several estimators makes it once. Every choice in it depends on the
# past only, so that the contacts of a smaller budget are the first ones of a larger.
@lru_cache(maxsize=4)
def contacts_of(trial: Trial, setup: Setup, explorer: str) -> tuple[Contacts, float]:
    """Return the contacts of a trial, explored with the estimator `explorer`, and the time [s]."""
    start = time.perf_counter()
    noise = parse_noise(trial.noise)
    config = pipeline.RunConfig(
        object=trial.object,
        estimator=explorer,
        touches=trial.touches,
        seed=trial.seed,
        prober=setup.prober,
        policy=setup.policy,
        mass=setup.mass,
        friction=setup.friction,
        position_noise=noise.position,
        normal_noise=noise.normal,
    )
    exploration = pipeline.touch(find_object(trial.object, setup), Hand.load(trial.hand), config)
    return exploration.contacts, time.perf_counter() - start


def _sensor(trial: Trial) -> TactileSensor:
    noise = parse_noise(trial.noise)
    return TactileSensor(position_noise=noise.position, normal_noise=noise.normal)


def _blank_row(trial: Trial, setup: Setup, estimator: str, shape: Shape) -> Row:
    """Return a row of a trial that came to nothing yet: not lifted, not held."""
    return {
        "key": row_key(trial, setup, estimator),
        **asdict(trial),
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


def _contents(trial: Trial) -> list[str]:
    """Return a hash of each file that a trial names; shipped names have none."""
    named = [] if trial.object in NAMES else [Path(trial.object)]
    if trial.hand not in HAND_NAMES:
        hand = Path(trial.hand)
        named += [hand, *sorted(hand.parent.glob("*.urdf")), *sorted(hand.parent.glob("*.sdf"))]
    return [hashlib.sha256(path.read_bytes()).hexdigest() for path in named]


def _digest(contacts: Contacts) -> str:
    """Return a hash of the contacts, which tells that estimators got the same."""
    content = contacts.points.tobytes() + contacts.normals.tobytes()
    return hashlib.sha256(content).hexdigest()[:_KEY_LENGTH]
