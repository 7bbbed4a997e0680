"""Success rates of lifts, planned on the true mesh, on 40 touches, and on 15: objects x seeds.

    python benchmarks/bench_success.py box torus 004_sugar_box.ply --seeds 20

Objects are of graspable size, 0.2 kg, friction 0.8, and touched by geometry alone. `truth` plans on
the true mesh, the others on the `blend` surface of the first touches; these grasp by touch, with
three attempts at most. A grasp is held that lifts the object, survives shakes of half and of one g
along and about every axis, and has it still at rest in the hand. Intervals: 95 %, for other seeds.

Continues where it stopped when run again with the same folder.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench_calibration import print_calibration

from lis_grasp import Hand, shapes
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import Scenario, lift, plan, touch
from lis_grasp.pipeline.regrasp import grasp_with_tactile_check
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp_studies.runner import local_scheduler, run_trials
from lis_grasp_studies.statistics import success_rate
from lis_grasp_studies.trial_results import Job, TrialResults, missing_jobs

HANDS = {"allegro": ("truth", "40", "15"), "wsg50": ("truth", "40")}


@dataclass(frozen=True)
class LiftTrial:
    object: str
    seed: int
    hand: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="*", default=list(shapes.NAMES))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--output", type=Path, default=Path("results/success"))
    options = parser.parse_args()
    results = TrialResults(options.output / "rows.jsonl", "success")
    known = {key_of(row) for row in results.read()}
    jobs, wanted = [], set()
    for hand, variants in HANDS.items():
        trials = [LiftTrial(n, s, hand) for s in range(options.seeds) for n in options.objects]
        wanted |= {key(trial, name) for trial in trials for name in variants}
        jobs += missing_jobs(trials, variants, known, key)
    for done, total in run_trials(jobs, len(jobs), results, local_scheduler(options.jobs), run):
        print(f"\r{done} of {total}", end="", flush=True)
    print()
    report([row for row in results.read() if key_of(row) in wanted])


def key(trial: LiftTrial, planned_on: str) -> tuple:
    return trial.object, trial.seed, trial.hand, planned_on


def key_of(row: Row) -> tuple:
    return row["object"], row["seed"], row["hand"], row["planned_on"]


def run(job: Job) -> list[Row]:
    """Return one row for each way to plan."""
    name, seed = job.trial.object, job.trial.seed
    shape = shapes.build(name) if name in shapes.NAMES else shapes.load(name)
    hand = Hand.load(job.trial.hand)
    config = RunConfig(object=name, hand=job.trial.hand, seed=seed, prober="kinematic")
    scenario = Scenario.from_config(config, shape, hand)
    exploration = touch(scenario)
    rows = []
    for planned_on in job.variants:
        attempts, outcome, predicted = 1, None, None
        if planned_on == "truth":
            search = plan(scenario.known, shape.mesh)
            if search.grasps:
                grasp = search.grasps[0]
                predicted = grasp.quality["success_probability"]
                outcome = lift(scenario, grasp)
        else:
            known = exploration.first(int(planned_on))
            tried = list(grasp_with_tactile_check(scenario, known))
            attempts, outcome = len(tried), tried[-1].outcome
            if outcome is not None:
                grasp = tried[-1].search.grasps[tried[-1].rank]
                predicted = grasp.quality["success_probability"]
        rows.append(
            {
                "object": name,
                "seed": seed,
                "hand": job.trial.hand,
                "planned_on": planned_on,
                "attempts": attempts,
                "predicted": predicted,
                "reason": "no_grasp" if outcome is None else outcome.reason,
                "held": outcome is not None and outcome.held,
                "lifted": outcome is not None and outcome.lifted,
                "survived": 0.0 if outcome is None else outcome.acceleration_survived,
            }
        )
    return rows


def report(rows: list[Row]) -> None:
    print("hand, planned on: held (95 %); survived 1 g of those lifted; attempts; other reasons")
    for hand, variants in HANDS.items():
        for planned_on in variants:
            chosen = [r for r in rows if (r["hand"], r["planned_on"]) == (hand, planned_on)]
            rate = success_rate(chosen)
            interval = "" if rate.low is None else f" ({rate.low:.0%} to {rate.high:.0%})"
            lifted = [row for row in chosen if row["lifted"]]
            survived = sum(row["survived"] > 9.8 for row in lifted)
            failed = [row for row in chosen if not row["held"]]
            reasons = Counter(f"{Path(row['object']).stem}: {row['reason']}" for row in failed)
            print(
                f"{hand}, {planned_on}: {rate.held} of {rate.trials}{interval};"
                f" {survived} of {len(lifted)}; {np.mean([r['attempts'] for r in chosen]):.2f};"
                f" {dict(reasons)}"
            )
        tried = [r for r in rows if r["hand"] == hand and r["predicted"] is not None]
        print(f"{hand}: of {len(tried)} grasps executed")
        print_calibration([r["predicted"] for r in tried], [r["held"] for r in tried])


if __name__ == "__main__":
    main()
