"""Trials of the study of surfaces: one contact set each, one row for each estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.contact_study.cases import ContactCase
from lis_grasp_studies.contact_study.contact_sets import ContactSet, balanced, contact_set
from lis_grasp_studies.contact_study.score import TRUTH, Box, score_estimate, score_truth
from lis_grasp_studies.estimators import TUNED, compared_estimator
from lis_grasp_studies.harness.experiment import Experiment

_contacts_of = lru_cache(maxsize=1)(contact_set)  # of all estimators of a trial


@dataclass(frozen=True, slots=True)
class SurfaceTrial:
    """One contact set and the box that its estimates are meshed in."""

    shape: str
    """Name of a test object, or path of a mesh file."""
    case: ContactCase
    seed: int
    box: Box

    def facts(self) -> Row:
        """Return the columns that identify the trial."""
        name, case = Path(self.shape).stem, self.case.name
        return {"object": name, "case": case, "seed": self.seed, "box": self.box}


def surface_trials(
    shapes: Sequence[str], cases: Sequence[ContactCase], *, part: int, seeds: int, box: Box
) -> list[SurfaceTrial]:
    """Return the trials of some shapes: each meets one case of `part`, the same for every seed."""
    pairs = balanced(shapes, cases, part)
    return [SurfaceTrial(shape, case, seed, box) for seed in range(seeds) for shape, case in pairs]


def score_trial(trial: SurfaceTrial, estimator: str) -> Row:
    """Return the `EstimateScore` of an estimator, and facts of its contact set."""
    data: ContactSet = _contacts_of(trial.shape, trial.case, trial.seed)
    if estimator == TRUTH:
        score = score_truth(data, box=trial.box)
    else:
        score = score_estimate(compared_estimator(estimator, TUNED), data, box=trial.box)
    facts = {"family": data.family, "kind": trial.case.kind}
    return facts | {"contacts": len(data.contacts), "size": data.shape.size} | asdict(score)


def _source(estimator: str) -> str:
    return "" if estimator == TRUTH else TUNED.digest(estimator)


SURFACES = Experiment("surfaces", score_trial, SurfaceTrial.facts, source=_source)
"""The study of surfaces."""
