"""Calibration of the predicted success probability of grasps planned on few touches.

    python benchmarks/bench_calibration.py box torus 004_sugar_box.ply --seeds 0 1

Each object is touched 15 times by geometry alone. Grasps are planned on surfaces of the first 5, 8
and 15 contacts (`blend`), 5 and 10 (`gpis`), and 8 (`lis`); the best grasp and the last of ten are
lifted. Prints the expected calibration error of `success_probability` (ten equal bins), the
predicted and observed success rates of each estimator, the area under the ROC curve, and a logistic
fit to the lifts of `blend`. Also prints how often grasps held whose measured contacts were in force
closure at half the friction, and the others.

The constants in use and the lifts that they were fitted to are in
`lis_grasp/grasping/success_model.json`: evaluate with other seeds, and on other objects.

Continues where it stopped when run again with the same folder.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.stats import rankdata

from lis_grasp import Contacts, Hand, shapes
from lis_grasp.evaluation.calibration import calibration_bins, expected_calibration_error
from lis_grasp.exceptions import EstimationError, InvalidContactsError
from lis_grasp.experiments.runner import local_scheduler, run_trials
from lis_grasp.experiments.trial_results import Job, TrialResults, missing_jobs
from lis_grasp.grasping.grasp_ranking import SUCCESS_MODEL, robust_epsilon_on
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import estimate, lift, plan, support_height, touch
from lis_grasp.pipeline.run_config import RunConfig

BUDGETS = (("blend", 5), ("blend", 8), ("blend", 15), ("gpis", 5), ("gpis", 10), ("lis", 8))


@dataclass(frozen=True)
class CalibrationTrial:
    object: str
    seed: int
    hand: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="*", default=list(shapes.NAMES))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--hand", default="allegro")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--output", type=Path, default=Path("results/calibration"))
    options = parser.parse_args()
    trials = [CalibrationTrial(n, s, options.hand) for s in options.seeds for n in options.objects]
    results = TrialResults(options.output / "rows.jsonl", "calibration")
    known = {key_of(row) for row in results.read()}
    jobs = missing_jobs(trials, ["lifts"], known, lambda trial, _: trial)
    for done, total in run_trials(jobs, len(jobs), results, local_scheduler(options.jobs), lifts):
        print(f"\r{done} of {total} objects", end="", flush=True)
    print()
    rows = [row for row in results.read() if key_of(row) in set(trials)]
    report([row for row in rows if row["reason"] is not None])


def key_of(row: Row) -> CalibrationTrial:
    return CalibrationTrial(row["object"], row["seed"], row["hand"])


def lifts(job: Job) -> list[Row]:
    """Return one row for each lift, after one without a reason that marks the trial as done."""
    name, seed = job.trial.object, job.trial.seed
    shape = shapes.build(name) if name in shapes.NAMES else shapes.load(name)
    hand = Hand.load(job.trial.hand)
    config = RunConfig(object=name, hand=job.trial.hand, touches=15, seed=seed, prober="kinematic")
    exploration = touch(shape, hand, config)
    rows: list[Row] = [{"object": name, "seed": seed, "hand": job.trial.hand, "reason": None}]
    for estimator, count in BUDGETS:
        rows += [
            {**rows[0], "estimator": estimator, "touches": count, **row}
            for row in _lifts_on(shape, hand, exploration.first(count), estimator, seed)
        ]
    return rows


def _lifts_on(
    shape: shapes.Shape, hand: Hand, contacts: Contacts, estimator: str, seed: int
) -> list[Row]:
    try:
        _, mesh = estimate(contacts, estimator)
    except (EstimationError, InvalidContactsError):
        return []
    support = support_height(shape)
    found = plan(mesh, hand, support=support, friction=0.8, count=10, seed=seed).grasps
    rows = []
    for grasp in dict.fromkeys([*found[:1], *found[-1:]]):
        outcome = lift(shape, hand, grasp, mass=0.2, friction=0.8)
        measured = outcome.measured_contacts
        points, normals = measured.points, measured.normals
        rows.append(
            {
                **grasp.quality,
                "held": outcome.held,
                "reason": outcome.reason,
                "measured": robust_epsilon_on(mesh, hand, points, normals, friction=0.8)
                if len(measured) >= 2
                else None,
            }
        )
    return rows


def report(rows: list[Row]) -> None:
    held = np.array([row["held"] for row in rows])
    predicted = np.array([row["success_probability"] for row in rows])
    print(f"{len(rows)} lifts, {held.mean():.0%} held")
    print_calibration(predicted, held)
    for estimator in dict.fromkeys(row["estimator"] for row in rows):
        mine = np.array([row["estimator"] == estimator for row in rows])
        print(
            f"{estimator}: {predicted[mine].mean():.2f} predicted, {held[mine].mean():.2f} of"
            f" {mine.sum()} held"
        )
    for name in ("success_probability", "epsilon_robust", "closure_probability"):
        print(f"area under the ROC curve of {name}: {_area([r[name] for r in rows], held):.3f}")
    default = np.array([row["estimator"] == "blend" for row in rows])
    fit = _fit([row for row, chosen in zip(rows, default, strict=True) if chosen], held[default])
    print("logistic fit to the lifts of blend:", np.round(fit, 2))
    measured = np.array([np.nan if r["measured"] is None else r["measured"] for r in rows])
    for name, chosen in (
        ("fewer than two fingers in contact", np.isnan(measured)),
        ("measured contacts not in robust force closure", measured == 0.0),
        ("measured contacts in robust force closure", measured > 0.0),
    ):
        print(f"{name}: {held[chosen].sum()} of {chosen.sum()} held")


def print_calibration(predicted: np.ndarray, held: np.ndarray) -> None:
    """Print observed rates by predicted probability, and the expected calibration error."""
    for count, probability, rate in calibration_bins(predicted, held):
        print(f"predicted {probability:.2f}: {rate:.2f} of {count} held")
    print(f"expected calibration error {expected_calibration_error(predicted, held):.3f}")


def _area(values: list[float], held: np.ndarray) -> float:
    """Return the area under the ROC curve, from ranks (Mann and Whitney)."""
    ranks, good = rankdata(values), held.sum()
    return float((ranks[held].sum() - good * (good + 1) / 2) / (good * (len(held) - good)))


def _fit(rows: list[Row], held: np.ndarray) -> np.ndarray:
    """Return the logistic regression of held on the measures, with a weak prior about 0."""
    columns = np.column_stack(
        [
            np.ones(len(rows)),
            *(
                np.log([row[name] + offset for row in rows])
                for name, offset in SUCCESS_MODEL["offsets"].items()
            ),
        ]
    )
    sign = np.where(held, -1.0, 1.0)

    def loss(w: np.ndarray) -> float:
        return float(np.logaddexp(0.0, sign * (columns @ w)).sum() + 0.05 * (w[1:] ** 2).sum())

    return minimize(loss, np.zeros(3)).x


if __name__ == "__main__":
    main()
