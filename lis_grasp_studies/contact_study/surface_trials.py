"""Trials of the study: one contact set each, one row for each estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.contact_study.competitors import STUDIED, studied_estimator
from lis_grasp_studies.contact_study.contact_cases import ContactCase
from lis_grasp_studies.contact_study.estimate_score import (
    TRUTH,
    Box,
    score_estimate,
    score_truth,
)
from lis_grasp_studies.contact_study.study_sets import balanced, contact_set
from lis_grasp_studies.runner import single_thread
from lis_grasp_studies.trial_results import Job


@dataclass(frozen=True, slots=True)
class SurfaceTrial:
    """One contact set and the box that its estimates are meshed in."""

    shape: str
    """Name of a test object, or path of a mesh file."""
    case: ContactCase
    seed: int
    box: Box

    @property
    def object(self) -> str:
        """Name of the object."""
        return Path(self.shape).stem


def surface_trials(
    shapes: Sequence[str], cases: Sequence[ContactCase], *, part: int, seeds: int, box: Box
) -> list[SurfaceTrial]:
    """Return the trials of some shapes: each meets one case of `part`, the same for every seed."""
    pairs = balanced(shapes, cases, part)
    return [SurfaceTrial(shape, case, seed, box) for seed in range(seeds) for shape, case in pairs]


def trial_key(trial: SurfaceTrial, estimator: str) -> tuple[Any, ...]:
    """Return the key of a row: object, case, seed, box, estimator, and the source of a plug-in."""
    source = "" if estimator == TRUTH else STUDIED.digest(estimator)
    return trial.object, trial.case.name, trial.seed, trial.box, estimator, source


def key_of(row: Row) -> tuple[Any, ...]:
    """Return the key of a row, as `trial_key` does."""
    names = ("object", "case", "seed", "box", "estimator")
    return *(row[name] for name in names), row.get("source", "")


def run_surface_trial(job: Job) -> list[Row]:
    """Return a row for each estimator: the trial, and its `EstimateScore`."""
    trial: SurfaceTrial = job.trial
    with single_thread():
        data = contact_set(trial.shape, trial.case, trial.seed)
        facts: Row = {
            "object": trial.object,
            "family": data.family,
            "case": trial.case.name,
            "kind": trial.case.kind,
            "seed": trial.seed,
            "box": trial.box,
            "contacts": len(data.contacts),
            "size": data.shape.size,
        }
        rows = []
        for name in job.variants:
            score = (
                score_truth(data, box=trial.box)
                if name == TRUTH
                else score_estimate(studied_estimator(name), data, box=trial.box)
            )
            source = trial_key(trial, name)[-1]
            added = {"source": source} if source else {}
            rows.append(facts | {"estimator": name} | added | asdict(score))
        return rows
