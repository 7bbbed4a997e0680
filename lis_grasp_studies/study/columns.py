"""Columns of the rows of a study: the outcome of a trial for one estimator."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import trimesh

from lis_grasp.evaluation.grasp_on_truth import epsilon_on_truth
from lis_grasp.exceptions import LisGraspError
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io.json_lines import Row
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.version import __version__
from lis_grasp_studies.study.trial import SETTINGS, Trial, columns_of, object_digest, row_key

if TYPE_CHECKING:
    from lis_grasp.lifting.outcome import LiftOutcome

NO_GRASP, FAILED = "no_grasp", "failed"
"""Reasons of rows without a lift."""

TIMES = ("seconds_touch", "seconds_estimate", "seconds_grasp", "seconds_lift")
"""Columns that differ between equal trials."""

MACHINE = "versions"
"""Column with the versions and the machine that made a row."""


COLUMNS = (
    *("key", "object", "object_digest", "edged", "hand", "touches", "noise", "seed", "estimator"),
    *("held", "lifted", "reason", "executed", "slip", "turn", "acceleration_survived"),
    *("epsilon_estimate", "epsilon_truth", "epsilon_gap"),
    *("closure_probability", "success_probability", "family"),
    *("grasps_found", "candidates", "rejections"),
    *("rmsd", "rmsd_truth_to_estimate", "edge_rmsd", "hausdorff_95", "chamfer"),
    *("f_score_1mm", "f_score_2mm", "f_score_5mm", "iou", "normal_error", "coverage"),
    *("explored_radius", "triangles", "watertight", "contacts", "contacts_digest", "failure"),
    *SETTINGS,
    *("version", MACHINE, *TIMES),
)
"""Columns of the files of results, in their order; lengths in metres, times in seconds."""


def blank_row(trial: Trial, estimator: str, shape: Shape) -> Row:
    """Return the row of a trial without any result: not lifted, not held."""
    return {
        **{name: None for name in COLUMNS if name not in TIMES},
        "key": row_key(trial, estimator),
        **columns_of(trial),
        "object_digest": object_digest(trial.object),
        "estimator": estimator,
        **asdict(trial.setup),
        "version": __version__,
        MACHINE: json.dumps(_versions(), sort_keys=True),
        "edged": bool(len(shape.edges)),
        "lifted": False,
        "held": False,
    }


def search_columns(search: GraspSearch) -> Row:
    """Return the columns of a search for grasps, as if none is executed."""
    return {
        "grasps_found": len(search.grasps),
        "candidates": search.candidates,
        "rejections": json.dumps(dict(search.rejections), sort_keys=True),
        "reason": NO_GRASP,
    }


def quality_columns(best: Grasp, truth: trimesh.Trimesh, trial: Trial, hand: Hand) -> Row:
    """Return the qualities of a grasp on the estimate and on the truth."""
    on_estimate = float(best.quality["epsilon"])
    on_truth = float(epsilon_on_truth(best, truth, hand, friction=trial.setup.friction))
    return {
        "epsilon_estimate": on_estimate,
        "epsilon_truth": on_truth,
        "epsilon_gap": on_estimate - on_truth,
        "closure_probability": float(best.quality["closure_probability"]),
        "success_probability": float(best.quality["success_probability"]),
        "family": best.family,
    }


def outcome_columns(outcome: LiftOutcome) -> Row:
    """Return the outcome of a lift."""
    return {
        "lifted": bool(outcome.lifted),
        "held": bool(outcome.held),
        "slip": float(outcome.slip),
        "turn": float(outcome.turn),
        "acceleration_survived": float(outcome.acceleration_survived),
        "reason": outcome.reason,
    }


@contextmanager
def failure_in(row: Row) -> Iterator[None]:
    """Write an error of the block into the row."""
    try:
        yield
    except LisGraspError as error:
        row |= {"reason": FAILED, "failure": f"{type(error).__name__}: {error}"}


@lru_cache(maxsize=1)
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in ("drake", "numpy", "scipy", "trimesh", "python-fcl"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "none"
    return found
