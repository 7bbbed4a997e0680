"""Held rates by mass and friction, and calibration of the predicted success probability.

    python benchmarks/bench_calibration.py                   # the development shapes
    python benchmarks/bench_calibration.py box egg 004_sugar_box.ply --seeds 0 1

Each object stands in a stable pose in a region and is touched 20 times by geometry alone, with a
realistic sensor. Grasps are planned on surfaces of the first 5, 10 and 20 contacts, for a load of
which only the distribution is known. The best grasp of 20 contacts is lifted with each of four
masses at each of three frictions; the others, and the last of ten, with two of these loads each.

Prints the held rate of each load, the expected calibration error of the success probability that
is predicted for the load (ten equal bins), the area under the ROC curve, and a fit of the model
to these lifts, with the calibration error of each object by a fit to the others. The constants in
use and the lifts that they were fitted to are in `lis_grasp/grasping/success_model.json`: evaluate
with other seeds, and on other objects.

Continues where it stopped when run again with the same folder.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import rankdata

from lis_grasp import Hand, pipeline
from lis_grasp.exceptions import EstimationError, InvalidContactsError
from lis_grasp.grasping.grasp_ranking import GraspScorer
from lis_grasp.grasping.load_prior import LoadPrior
from lis_grasp.grasping.success_model import SUCCESS_MODEL
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.conditions import UNKNOWN
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp_studies.calibration import (
    calibration_bins,
    chance_calibration_error,
    expected_calibration_error,
)
from lis_grasp_studies.runner import local_scheduler, run_trials
from lis_grasp_studies.study.trial import Setup, find_object
from lis_grasp_studies.test_objects.shape_sets import DEVELOPMENT
from lis_grasp_studies.trial_results import Job, TrialResults, missing_jobs

TOUCHES = (5, 10, 20)
MASSES, FRICTIONS = (0.05, 0.2, 0.5, 1.0), (0.3, 0.5, 0.8)
LOADS = tuple(product(MASSES, FRICTIONS))
FEW_LOADS = 2


@dataclass(frozen=True)
class CalibrationTrial:
    object: str
    seed: int
    hand: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    development = [name for names in DEVELOPMENT.values() for name in names]
    parser.add_argument("objects", nargs="*", default=development)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--hands", nargs="+", default=["allegro", "wsg50"])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--output", type=Path, default=Path("results/calibration"))
    options = parser.parse_args()
    trials = [
        CalibrationTrial(*names) for names in product(options.objects, options.seeds, options.hands)
    ]
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
    shape = find_object(name, Setup())
    hand = Hand.load(job.trial.hand)
    conditions = {**UNKNOWN, "region": tuple(UNKNOWN["region"]), "free": False}
    config = RunConfig(
        object=name, touches=TOUCHES[-1], seed=seed, prober="kinematic", **conditions
    )
    scenario = pipeline.Scenario.from_config(config, shape, hand)
    exploration = pipeline.touch(scenario)
    first: Row = {"object": name, "seed": seed, "hand": job.trial.hand, "reason": None}
    rows = [first]
    rng = np.random.default_rng([seed, len(name)])
    for touches in TOUCHES:
        try:
            _, mesh = pipeline.estimate(scenario.known, exploration.first(touches))
        except (EstimationError, InvalidContactsError):
            continue
        found = pipeline.plan(scenario.known, mesh).grasps
        for grasp in dict.fromkeys([*found[:1], *found[-1:]]):
            best = grasp is found[0]
            every = best and touches == TOUCHES[-1]
            few = [LOADS[i] for i in rng.choice(len(LOADS), FEW_LOADS, replace=False)]
            for mass, friction in LOADS if every else few:
                # The same draws of the surface as a planner's.
                scorer = GraspScorer(
                    hand, mesh, prior=LoadPrior(friction, mass), rng=np.random.default_rng(seed)
                )
                truth = replace(scenario.truth, mass=mass, friction=friction)
                outcome = pipeline.lift(replace(scenario, truth=truth), grasp)
                rows.append(
                    first
                    | {"touches": touches, "best": best, "jaw": hand.kind == "parallel_jaw"}
                    | {"mass": mass, "friction": friction}
                    | dict(scorer.predict_success([grasp])[0].quality)
                    | {"held": outcome.held, "reason": outcome.reason, "slip": outcome.slip}
                )
    return rows


def report(rows: list[Row]) -> None:
    for hand in dict.fromkeys(row["hand"] for row in rows):
        mine = [row for row in rows if row["hand"] == hand]
        print(f"{hand}: {len(mine)} lifts")
        print_rates([r for r in mine if r["best"] and r["touches"] == TOUCHES[-1]])
        held = np.array([row["held"] for row in mine])
        predicted = np.array([row["success_probability"] for row in mine])
        print_calibration(predicted, held)
        print(f"area under the ROC curve: {_area(predicted, held):.3f}")
    parameters = fit(rows)
    print("fit of the success model:", {k: round(v, 2) for k, v in parameters.items()})
    probability = predicted_for_new_objects(rows)
    held = np.array([row["held"] for row in rows])
    hands = np.array([row["hand"] for row in rows])
    each = {"all": np.full(len(rows), True), **{name: hands == name for name in np.unique(hands)}}
    for name, mine in each.items():
        print(f"{name}, each object predicted by a fit to the others:")
        print_calibration(probability[mine], held[mine])
        print(f"area under the ROC curve: {_area(probability[mine], held[mine]):.3f}")
        print_rates_beside(
            [row for row, own in zip(rows, mine, strict=True) if own], probability[mine]
        )


def print_rates(rows: list[Row]) -> None:
    """Print how many best grasps held, by mass and friction."""
    held = np.array([row["held"] for row in rows])
    print_by_load("held after 20 touches", rows, lambda of: f"{held[of].sum():3d} of {of.sum()}")


def print_rates_beside(rows: list[Row], predicted: np.ndarray) -> None:
    """Print predicted and observed rates in percent, by mass and friction."""
    held = np.array([row["held"] for row in rows])
    print_by_load(
        "predicted / held [%]",
        rows,
        lambda of: f"{100 * predicted[of].mean():3.0f} / {100 * held[of].mean():3.0f}",
    )


def print_by_load(title: str, rows: list[Row], text_of: Callable[[np.ndarray], str]) -> None:
    """Print a text for the rows of each mass (a line) and friction (a column)."""
    loads = np.array([(row["mass"], row["friction"]) for row in rows])
    print(f"{title:23}" + "".join(f"{f'friction {f:g}':14}" for f in FRICTIONS))
    for mass in MASSES:
        cells = [text_of((loads == (mass, friction)).all(axis=1)) for friction in FRICTIONS]
        print(f"{f'  {mass:4g} kg':23}" + "".join(f"{cell:14}" for cell in cells))


def print_calibration(predicted: np.ndarray, held: np.ndarray) -> None:
    """Print observed rates by predicted probability, and the expected calibration error."""
    for count, probability, rate in calibration_bins(predicted, held):
        print(f"predicted {probability:.2f}: {rate:.2f} of {count} held")
    error, chance = expected_calibration_error(predicted, held), chance_calibration_error(predicted)
    print(f"expected calibration error {error:.3f}, by chance {chance:.3f}")


def _area(values: np.ndarray, held: np.ndarray) -> float:
    """Return the area under the ROC curve, from ranks (Mann and Whitney)."""
    ranks, good = rankdata(values), held.sum()
    return float((ranks[held].sum() - good * (good + 1) / 2) / (good * (len(held) - good)))


def predict(rows: list[Row], parameters: dict[str, float]) -> np.ndarray:
    """Return the success probability of lifts by the success model with other parameters."""
    jaw = np.array([row["jaw"] for row in rows])

    def by_kind(name: str) -> np.ndarray:
        return np.where(jaw, parameters[f"soft_finger {name}"], parameters[f"coulomb {name}"])

    logs = {
        name: np.log([row[name] + offset for row in rows])
        for name, offset in SUCCESS_MODEL["offsets"].items()
    }
    shape = by_kind("intercept") + parameters["epsilon slope"] * logs["epsilon_expected"]
    load = by_kind("load slope") * (logs["acceleration"] - by_kind("log load"))
    burden = np.log([row["mass"] / SUCCESS_MODEL["mass"]["usual"] for row in rows])
    load = load - parameters["mass slope"] * burden
    return expit(shape) * expit(load)


def fit(rows: list[Row]) -> dict[str, float]:
    """Return the most probable parameters of the success model, with a weak prior about a start."""
    held = np.array([row["held"] for row in rows])
    start = {
        "coulomb intercept": 6.0,
        "soft_finger intercept": 7.0,
        "epsilon slope": 0.8,
        "coulomb log load": 2.0,
        "soft_finger log load": 2.0,
        "coulomb load slope": 3.0,
        "soft_finger load slope": 3.0,
        "mass slope": 1.0,
    }
    first = np.array(list(start.values()))

    def loss(values: np.ndarray) -> float:
        p = np.clip(predict(rows, dict(zip(start, values, strict=True))), 1e-9, 1.0 - 1e-9)
        return float(
            -np.log(np.where(held, p, 1.0 - p)).sum() + 0.02 * ((values - first) ** 2).sum()
        )

    best = minimize(loss, first, method="BFGS")
    return dict(zip(start, best.x.tolist(), strict=True))


def predicted_for_new_objects(rows: list[Row]) -> np.ndarray:
    """Return the probabilities of all lifts, those of an object by a fit to the other objects."""
    objects = np.array([Path(row["object"]).stem for row in rows])
    probability = np.empty(len(rows))
    for name in np.unique(objects):
        parameters = fit([row for row, own in zip(rows, objects == name, strict=True) if not own])
        probability[objects == name] = predict(
            [row for row, own in zip(rows, objects == name, strict=True) if own], parameters
        )
    return probability


if __name__ == "__main__":
    main()
