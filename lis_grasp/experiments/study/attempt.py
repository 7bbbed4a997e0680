"""A grasp planned on a mesh and executed on the true object: what of it belongs into a row."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp import pipeline
from lis_grasp.evaluation.grasp_on_truth import epsilon_on_truth
from lis_grasp.exceptions import LisGraspError
from lis_grasp.experiments.study.study import Setup
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.hands.hand import Hand
from lis_grasp.io.json_lines import Row
from lis_grasp.shapes import Shape

if TYPE_CHECKING:
    from lis_grasp.lifting.lift_outcome import LiftOutcome

NO_GRASP, FAILED = "no_grasp", "failed"
"""Reasons of rows that came to no lift."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """A grasp to plan and to execute; equal ones come to the same.

    Parameters
    ----------
    mesh_digest
        Of the mesh to plan on, see `mesh_digest`.
    object, hand_name, files, seed, setup
        What else decides; files are hashes of what is in those of object and hand.
    mesh, shape, hand
        What the digest and the names stand for.
    """

    mesh_digest: str
    object: str
    hand_name: str
    files: tuple[str, ...]
    seed: int
    setup: Setup
    mesh: trimesh.Trimesh = field(compare=False)
    shape: Shape = field(compare=False)
    hand: Hand = field(compare=False)


# Estimators may agree (blend is patch where contacts are few), and the true mesh is the same
# whatever was touched: what a process has tried it need not try again.
@lru_cache(maxsize=64)
def attempt(task: Attempt) -> tuple[Row, dict[str, float]]:
    """Plan, measure the best grasp on the truth, lift with it; return columns, and times [s]."""
    watch = pipeline.Stopwatch()
    row: Row = {}
    try:
        _fill(row, task, watch)
    except LisGraspError as error:
        row |= failure(error)
    return row, watch.seconds


def failure(error: LisGraspError) -> Row:
    """Return the columns that an error leaves in a row."""
    return {"reason": FAILED, "failure": f"{type(error).__name__}: {error}"}


def mesh_digest(mesh: trimesh.Trimesh) -> str:
    """Return a hash of a mesh: vertices, faces, and what each vertex knows of itself."""
    known = [np.asarray(mesh.vertex_attributes[name]) for name in sorted(mesh.vertex_attributes)]
    digest = hashlib.sha256()
    for array in (np.asarray(mesh.vertices), np.asarray(mesh.faces), *known):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def plan(mesh: trimesh.Trimesh, shape: Shape, hand: Hand, setup: Setup, seed: int) -> GraspSearch:
    """Plan grasps on a mesh of an object, as trials do."""
    return pipeline.plan(
        mesh,
        hand,
        support=pipeline.support_height(shape),
        friction=setup.friction,
        count=setup.grasps,
        seed=seed,
    )


def lift(grasp: Grasp, shape: Shape, hand: Hand, setup: Setup) -> LiftOutcome:
    """Execute a grasp on the true object, as trials do."""
    return pipeline.lift(shape, hand, grasp, mass=setup.mass, friction=setup.friction)


def _fill(row: Row, task: Attempt, watch: pipeline.Stopwatch) -> None:
    setup, shape, hand = task.setup, task.shape, task.hand
    with watch.measure("grasp"):
        search = plan(task.mesh, shape, hand, setup, task.seed)
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
        outcome = lift(best, shape, hand, setup)
    row |= {
        "lifted": bool(outcome.lifted),
        "held": bool(outcome.held),
        "slip": float(outcome.slip),
        "acceleration_survived": float(outcome.acceleration_survived),
        "reason": outcome.reason,
    }
