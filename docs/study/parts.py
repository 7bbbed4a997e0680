"""Ablation: what each part of the package is worth if nothing is known of the object; see plan.md.

python docs/study/parts.py --meshes ycb     # continues where it stopped

Conditions are the study's; the built-in shapes, the scans and the tools, `allegro`, 20 touches. All
variants get the same contacts. One grasp is executed, without a tactile check, unless the variant
has three attempts.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from write_studies import SCANS, trials_of

from lis_grasp import Contacts, GraspSearch, Hand
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.regrasp import Attempt, grasp_with_tactile_check
from lis_grasp.shapes import NAMES
from lis_grasp.typing import FloatArray
from lis_grasp_studies.report_page import TextTable
from lis_grasp_studies.runner import local_scheduler, run_trials
from lis_grasp_studies.statistics import cluster_sums, objects_of, sign_flip_p_value
from lis_grasp_studies.study.paired_tables import Pairs, difference, gains
from lis_grasp_studies.study.study_tables import p_value
from lis_grasp_studies.study.study_trial import estimate, plan, single_threaded_drake, touch
from lis_grasp_studies.study.trial import Trial, label
from lis_grasp_studies.test_objects.shape_sets import TOOLS
from lis_grasp_studies.trial_results import Job, TrialResults, missing_jobs

HAND, TOUCHES = "allegro", 20
GROUPS = {"built-in shapes and scans": (*NAMES, *SCANS), "tools and flat things": TOOLS}
WHOLE = "whole pipeline"


@dataclass(frozen=True)
class Variant:
    """The pipeline, or the pipeline without one of its parts."""

    estimator: str = "blend"
    free_space: bool = True  # is removed from the estimate
    uncertainty: bool = True  # of the estimate counts in the ranking of grasps
    attempts: int = 1


VARIANTS: Mapping[str, Variant] = {
    WHOLE: Variant(),
    "without sharp patches (gpis)": Variant("gpis"),
    "without the smooth estimate (patch)": Variant("patch"),
    "without free space": Variant(free_space=False),
    "without uncertainty": Variant(uncertainty=False),
    "with three attempts": Variant(attempts=3),
}


def main() -> None:
    """Run the trials that are missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--meshes", type=Path, required=True, help="folder of the six scans")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--output", type=Path, default=Path("results/unknown/parts.jsonl"))
    options = parser.parse_args()
    names = [name for group in GROUPS.values() for name in group]
    trials = trials_of(HAND, range(options.seeds), TOUCHES, options.meshes, names)
    results = TrialResults(options.output, "parts")
    jobs = missing_jobs(trials, list(VARIANTS), set(map(_key_of, results.read())), _key)
    for done, of in run_trials(jobs, len(trials), results, local_scheduler(options.jobs), run):
        print(f"\r{done} of {of}", end="", flush=True)
    rows = results.read()
    print("\n" + "\n".join(parts_table(rows, group).markdown() for group in GROUPS))


def _key(trial: Trial, variant: str) -> tuple:
    return label(trial.object), trial.seed, variant


def _key_of(row: Row) -> tuple:
    return row["object"], row["seed"], row["variant"]


def run(job: Job) -> list[Row]:
    """Explore once, and return a row for each variant."""
    trial = job.trial
    with single_threaded_drake():
        touched = touch(trial, trial.explorer("blend"))
        return [
            {
                **{name: getattr(trial, name) for name in ("hand", "touches", "noise", "seed")},
                "object": label(trial.object),
                "variant": variant,
                **asdict(VARIANTS[variant]),
                **_outcome_of(trial, VARIANTS[variant], touched.contacts, touched.X_EO),
            }
            for variant in job.variants
        ]


def _outcome_of(trial: Trial, variant: Variant, contacts: Contacts, X_EO: FloatArray | None) -> Row:
    shape, hand = trial.find_object(), Hand.load(trial.hand)
    config = trial.run_config(hand=trial.hand, attempts=variant.attempts)

    def planner(known: Contacts, *_: object) -> tuple[trimesh.Trimesh, GraspSearch]:
        if not variant.free_space:
            known = replace(known, free_points=np.empty((0, 3)), free_radii=np.empty(0))
        mesh = estimate(trial, variant.estimator, known)
        if not variant.uncertainty:
            mesh.vertex_attributes.pop("uncertainty")
        return mesh, plan(trial, mesh, shape, hand)

    attempts: list[Attempt] = list(
        grasp_with_tactile_check(shape, hand, contacts, config, planner=planner, X_WO=X_EO)
    )
    outcome = attempts[-1].outcome
    return {
        "executed": len(attempts),
        "held": outcome is not None and bool(outcome.held),
        "reason": "no_grasp" if outcome is None else outcome.reason,
    }


def parts_table(rows: Sequence[Row], group: str) -> TextTable:
    """Return the rate of each variant on a group of objects, and its difference from the whole."""
    rows = [row for row in rows if row["object"] in GROUPS[group]]
    whole = {(row["object"], row["seed"]): row for row in rows if row["variant"] == WHOLE}
    body = []
    for variant in VARIANTS:
        own = [row for row in rows if row["variant"] == variant]
        pairs: Pairs = [
            (row, whole[place]) for row in own if (place := (row["object"], row["seed"])) in whole
        ]
        if not pairs:
            continue
        compared = ("–", "–")
        if variant != WHOLE:
            sums = cluster_sums(gains(pairs), objects_of([mine for mine, _ in pairs]))
            compared = (difference(pairs, over_objects=True), p_value(sign_flip_p_value(sums)))
        rate = f"{100.0 * np.mean([row['held'] for row in own]):.0f}"
        body.append((variant, str(len(own)), rate, *compared))
    head = (group, "trials", "held [%]", "minus the whole pipeline [points]", "p")
    return TextTable("parts", "What each part is worth", head, tuple(body))


if __name__ == "__main__":
    main()
