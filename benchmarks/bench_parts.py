"""Ablation: points of the success rate that each part of the pipeline is worth, of unknown objects.

    python benchmarks/bench_parts.py --meshes ycb --seeds 10

Conditions are those of the study of unknown objects (docs/study/unknown/plan.md): nothing known but
a region, a free object, a noisy sensor; 0.2 kg, friction 0.8, the four-finger hand, 20 touches.
Objects are the built-in shapes and the scans in --meshes. All variants get the same contacts. One
grasp is executed, without a tactile check, unless the variant has three attempts. Differences are
from the whole pipeline, with 95 % intervals for other objects, and exact sign-flip p-values with
objects as units.

Continues where it stopped when run again with the same folder.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp import Contacts, GraspSearch, Hand
from lis_grasp.experiments.runner import local_scheduler, run_trials, single_thread
from lis_grasp.experiments.statistics import cluster_sums, objects_of, sign_flip_p_value
from lis_grasp.experiments.study.paired_tables import Pairs, difference, gains
from lis_grasp.experiments.study.study_trial import estimate, plan, touch
from lis_grasp.experiments.study.trial import Setup, Trial, label
from lis_grasp.experiments.trial_results import Job, TrialResults, missing_jobs
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.regrasp import Attempt, grasp_with_tactile_check
from lis_grasp.shapes import NAMES
from lis_grasp.typing import FloatArray

NOISE = "0.5mm/3deg"
WHOLE = "whole pipeline"


@dataclass(frozen=True)
class Variant:
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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--meshes", type=Path, help="folder of scans")
    parser.add_argument("--objects", nargs="+", default=list(NAMES), help="built-in shapes")
    parser.add_argument("--hand", default="allegro")
    parser.add_argument("--touches", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--output", type=Path, default=Path("results/parts"))
    options = parser.parse_args()
    scans = [] if options.meshes is None else sorted(map(str, options.meshes.glob("*.ply")))
    setup = Setup(prober="dynamic", conditions="unknown")
    trials = [
        Trial(name, options.hand, options.touches, NOISE, seed, setup)
        for seed in range(options.seeds)
        for name in [*options.objects, *scans]
    ]
    results = TrialResults(options.output / "rows.jsonl", "parts")
    jobs = missing_jobs(trials, list(VARIANTS), set(map(key_of, results.read())), key)
    for done, of in run_trials(jobs, len(trials), results, local_scheduler(options.jobs), run):
        print(f"\r{done} of {of}", end="", flush=True)
    wanted = {key(trial, name) for trial in trials for name in VARIANTS}
    print("\n" + table([row for row in results.read() if key_of(row) in wanted]))


def key(trial: Trial, variant: str) -> tuple:
    return label(trial.object), trial.hand, trial.touches, trial.seed, variant


def key_of(row: Row) -> tuple:
    return row["object"], row["hand"], row["touches"], row["seed"], row["variant"]


def run(job: Job) -> list[Row]:
    """Explore once, and return a row for each variant."""
    trial = job.trial
    import_module("lis_grasp.simulation.simulate_lift")  # so that Drake's threads are limited, too
    with single_thread():
        touched = touch(trial, trial.explorer("blend"))
        return [
            {
                **{name: getattr(trial, name) for name in ("hand", "touches", "noise", "seed")},
                "object": label(trial.object),
                "variant": variant,
                **asdict(VARIANTS[variant]),
                **outcome_of(trial, VARIANTS[variant], touched.contacts, touched.X_EO),
            }
            for variant in job.variants
        ]


def outcome_of(trial: Trial, variant: Variant, contacts: Contacts, X_EO: FloatArray | None) -> Row:
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


def table(rows: list[Row]) -> str:
    whole = {(row["object"], row["seed"]): row for row in rows if row["variant"] == WHOLE}
    lines = [
        "| variant | trials | held [%] | minus the whole pipeline [points] | p |",
        "|---|---|---|---|---|",
    ]
    for variant in VARIANTS:
        own = [row for row in rows if row["variant"] == variant]
        if not own:
            continue
        pairs: Pairs = [
            (row, whole[place]) for row in own if (place := (row["object"], row["seed"])) in whole
        ]
        rate = 100.0 * np.mean([row["held"] for row in own])
        compared = "– | –"
        if variant != WHOLE and pairs:
            sums = cluster_sums(gains(pairs), objects_of([mine for mine, _ in pairs]))
            p = sign_flip_p_value(sums)
            compared = f"{difference(pairs, over_objects=True)} | {p:.3f}"
        lines.append(f"| {variant} | {len(own)} | {rate:.0f} | {compared} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
