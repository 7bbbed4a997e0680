"""Held rates by mass and friction, and calibration of the predicted success probability.

    python benchmarks/bench_calibration.py                   # the development shapes
    python benchmarks/bench_calibration.py box vase 004_sugar_box.ply --seeds 0 1

Each object stands in a stable pose in a region and is touched 20 times by geometry alone, with a
realistic sensor. Grasps are planned on surfaces of the first 5, 10 and 20 contacts, for a load of
which only the distribution is known. The best grasp of 20 contacts is lifted with each of four
masses at each of three frictions; the others, and the last of ten, with two of these loads each.

Prints the held rate of each load, the expected calibration error of the success probability that
is predicted for the load (ten equal bins), and a fit of the model to these lifts, with the
calibration error of each object by a fit to the others. The constants in use and the lifts that
they were fitted to are in `lis_grasp/grasping/success_model.json`: evaluate with other seeds, and
on other objects.

Continues where it stopped when run again with the same folder.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from lis_grasp import Grasp, Hand, pipeline
from lis_grasp.exceptions import EstimationError, InvalidContactsError
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasp_ranking import SUCCESS_MODEL, GraspScorer
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.conditions import UNKNOWN
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp_studies.harness.calibration import (
    chance_calibration_error,
    expected_calibration_error,
)
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import Column, grouped_table, split, values_of
from lis_grasp_studies.study.trial import Setup, find_object
from lis_grasp_studies.test_objects.shape_sets import DEVELOPMENT

TOUCHES = (5, 10, 20)
MASSES, FRICTIONS = (0.05, 0.2, 0.5, 1.0), (0.3, 0.5, 0.8)
LOADS = tuple(product(MASSES, FRICTIONS))
FEW_LOADS = 2


@dataclass(frozen=True)
class CalibrationTrial:
    object: str
    seed: int


def lifts(trial: CalibrationTrial, hand_name: str) -> list[Row]:
    """Return one row for each lift, after one without a reason that marks the trial as done."""
    name, seed, hand = trial.object, trial.seed, Hand.load(hand_name)
    shape = find_object(name, Setup())
    conditions = {**UNKNOWN, "region": tuple(UNKNOWN["region"]), "free": False}
    config = RunConfig(
        object=name, touches=TOUCHES[-1], seed=seed, prober="kinematic", **conditions
    )
    scenario = pipeline.Scenario.from_config(config, shape, hand)
    exploration = pipeline.touch(scenario)
    rows: list[Row] = [{"reason": None}]
    rng = np.random.default_rng([seed, len(name)])
    for touches in TOUCHES:
        contacts = exploration.first(touches)
        try:
            _, mesh = pipeline.estimate(scenario.known, contacts)
        except (EstimationError, InvalidContactsError):
            continue
        grasps = pipeline.plan(scenario.known, mesh).grasps

        def lift(grasp: Grasp, mass: float, friction: float, mesh=mesh) -> Row:
            # The same draws of the surface as a planner's.
            scorer = GraspScorer(
                hand, mesh, prior=LoadPrior(friction, mass), rng=np.random.default_rng(seed)
            )
            load = {"mass": mass, "friction": friction}
            outcome = pipeline.lift(replace(scenario, truth=replace(scenario.truth, **load)), grasp)
            batch = scorer.predict_success(GraspBatch.of_grasps([grasp], hand))
            quality = {name: float(values[0]) for name, values in batch.quality.items()}
            observed = {"held": outcome.held, "reason": outcome.reason, "slip": outcome.slip}
            return load | quality | observed

        for grasp in dict.fromkeys([*grasps[:1], *grasps[-1:]]):
            best = grasp is grasps[0]
            few = [LOADS[i] for i in rng.choice(len(LOADS), FEW_LOADS, replace=False)]
            facts = {"touches": touches, "best": best, "jaw": hand.kind == "parallel_jaw"}
            rows += [
                facts | lift(grasp, mass, friction)
                for mass, friction in (LOADS if best and touches == TOUCHES[-1] else few)
            ]
    return rows


def calibration_columns(column: str) -> list[Column]:
    """Return columns of predictions and outcomes of lifts."""

    def both(measure: Callable[..., float]) -> Callable[[Sequence[Row]], str]:
        return lambda rows: f"{measure(values_of(rows, column), values_of(rows, 'held')):.3f}"

    return [
        ("lifts", lambda rows: str(len(rows))),
        ("predicted", both(lambda predicted, _: predicted.mean())),
        ("held", both(lambda _, held: held.mean())),
        ("calibration error", both(expected_calibration_error)),
        ("by chance", both(lambda predicted, _: chance_calibration_error(predicted))),
    ]


def report(rows: list[Row]) -> None:
    title = "Predictions by the constants in use"
    columns = calibration_columns("success_probability")
    print(grouped_table("in_use", title, "hand", split(rows, "hand"), columns).text())
    print("fit of the success model:", {k: round(v, 2) for k, v in fit(rows).items()})
    refitted = predicted_for_new_objects(rows)
    rows = [row | {"refitted": float(p)} for row, p in zip(rows, refitted, strict=True)]
    groups = {("all", "", ""): rows, **split(rows, "hand", "mass", "friction")}
    title, columns = "Each object predicted by a fit to the others", calibration_columns("refitted")
    print(grouped_table("new", title, "hand | mass [kg] | friction", groups, columns).text())


def predict(rows: list[Row], parameters: dict[str, float]) -> np.ndarray:
    """Return the success probability of lifts by the success model with other parameters."""
    jaw = np.array([row["jaw"] for row in rows])

    def by_kind(name: str) -> np.ndarray:
        return np.where(jaw, parameters[f"soft_finger {name}"], parameters[f"coulomb {name}"])

    logs = {
        name: np.log([row[name] + offset for row in rows])
        for name, offset in SUCCESS_MODEL["offsets"].items()
    }
    shape = by_kind("intercept") + parameters["shape slope"] * logs["load_expected"]
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
        "shape slope": 0.8,
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
        left_out = objects == name
        parameters = fit([row for row, out in zip(rows, left_out, strict=True) if not out])
        own_lifts = [row for row, out in zip(rows, left_out, strict=True) if out]
        probability[left_out] = predict(own_lifts, parameters)
    return probability


def main() -> None:
    development = [name for names in DEVELOPMENT.values() for name in names]
    defaults = {"objects": development, "seeds": [0], "hands": ["allegro", "wsg50"], "jobs": 2}
    options = read_options(__doc__, **defaults, output=Path("results/calibration"))
    trials = [CalibrationTrial(*names) for names in product(options.objects, options.seeds)]
    experiment = Experiment("calibration", lifts, variant="hand")
    file = options.output / "rows.jsonl"
    rows = experiment.complete(trials, options.hands, file, jobs=options.jobs)
    report([row for row in rows if row["reason"] is not None])


if __name__ == "__main__":
    main()
