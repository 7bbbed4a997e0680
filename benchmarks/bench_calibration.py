"""Fit and calibration of the predicted success of grasps, on development objects.

    python benchmarks/bench_calibration.py                       # lifts, and the fit of them
    python benchmarks/bench_calibration.py box vase bean --hands barrett

Trials are those of a study under unknown conditions: ten or twenty touches of a free object with a
realistic sensor. Eight grasps are planned on two surfaces, drawn from the true mesh and `blend` and
`gpis` of the same contacts, for a load of which only the distribution is known. The first grasp and
another one of random rank are lifted, so that lifts that are lost are in the fit: one of the two
with the usual load, the other with mass and friction drawn from that distribution.

Prints held rates, calibration and ranking of the constants in use, then of a fit, each object
predicted by a fit to the others. The constants in use and the lifts that they were fitted to are in
`lis_grasp/grasping/success_model.json`: evaluate with other seeds, and on other objects.

Continues where it stopped when run again with the same folder.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import mannwhitneyu

from lis_grasp import Grasp, Hand, shapes
from lis_grasp.exceptions import LisGraspError
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasp_quality import SUCCESS_MODEL, GraspScorer
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.io.json_lines import Row
from lis_grasp.stages.agent import UNKNOWN_LOAD
from lis_grasp_studies.harness.calibration import (
    chance_calibration_error,
    expected_calibration_error,
)
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import Column, grouped_table, split, values_of
from lis_grasp_studies.study import run
from lis_grasp_studies.study.trial import TRUTH, Setup, Trial
from lis_grasp_studies.test_objects.shape_sets import DEVELOPMENT, graspable_shape

SURFACES, TOUCHES = (TRUTH, "blend", "gpis"), (10, 20)
SETUP = Setup("dynamic", conditions="unknown")

STRETCHED: Mapping[str, tuple[str, tuple[float, float, float]]] = {
    "bar": ("box", (0.150, 0.028, 0.012)),
    "strip": ("box", (0.130, 0.030, 0.005)),
    "rod": ("cylinder", (0.011, 0.011, 0.130)),
    "block": ("box", (0.045, 0.060, 0.150)),
    "low_stairs": ("stairs", (0.100, 0.050, 0.016)),
    "flat_bean": ("bean", (0.100, 0.050, 0.014)),
    "long_mallet": ("mallet", (0.080, 0.030, 0.180)),
    "low_half_cylinder": ("half_cylinder", (0.120, 0.050, 0.015)),
}
"""More objects: development shapes with other extents [m], because thin and long ones are lost."""


@dataclass(frozen=True)
class CalibrationTrial:
    object: str
    seed: int
    grasps: int


def stretched_objects(folder: Path) -> list[str]:
    """Write the stretched objects into a folder; return the paths of their files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, (shape, extents) in STRETCHED.items():
        known = shape in shapes.NAMES
        mesh = (shapes.find(shape) if known else graspable_shape(shape)).mesh.copy()
        mesh.apply_scale(np.array(extents) / mesh.extents)
        paths.append(str(folder / f"{name}.ply"))
        mesh.export(paths[-1])
    return paths


def lifts(job: CalibrationTrial, hand_name: str) -> list[Row]:
    """Return one row for each lift, after one without a reason that marks the trial as done."""
    hand, name = Hand.load(hand_name), Path(job.object).stem
    rng = np.random.default_rng([job.seed, *name.encode(), *hand_name.encode()])
    touches, setup = int(rng.choice(TOUCHES)), replace(SETUP, grasps=job.grasps)
    trial = Trial(job.object, hand_name, touches, "0.5mm/3deg", job.seed, setup)
    shape = trial.find_object()
    rows: list[Row] = [{"reason": None}]
    touched = run.touch(trial, "blend")
    for surface in rng.permutation(SURFACES)[:2]:
        # Drawn before anything can fail, so that one surface does not change another's draws.
        draws, first_is_usual, z = rng.uniform(), bool(rng.integers(2)), rng.normal(size=2)
        drawn = {
            "mass": float(UNKNOWN_LOAD.mass * np.exp(UNKNOWN_LOAD.mass_spread * z[0])),
            "friction": float(UNKNOWN_LOAD.friction * np.exp(UNKNOWN_LOAD.friction_spread * z[1])),
        }
        usual = {"mass": UNKNOWN_LOAD.mass, "friction": UNKNOWN_LOAD.friction}
        try:
            truth = run.shape_at(shape, touched.X_EO).mesh
            mesh = truth if surface == TRUTH else run.estimate(trial, surface, touched.contacts)
            grasps = run.plan(trial, mesh, shape, hand).grasps
        except LisGraspError:
            continue
        ranks = dict.fromkeys([0, 1 + int(draws * (len(grasps) - 1))] if grasps else ())
        for rank in (rank for rank in ranks if rank < len(grasps)):
            load = usual if (rank == 0) == first_is_usual else drawn
            at_load = replace(trial, setup=replace(setup, **load))
            outcome = run.lift(at_load, grasps[rank], shape, hand, touched.X_EO)
            jaws = hand.for_height(float(mesh.bounds[1, 2]))  # the pads that were planned with
            scorer = GraspScorer(
                jaws,
                mesh,
                prior=LoadPrior(load["friction"], load["mass"]),
                rng=np.random.default_rng(job.seed),
                support_height=0.0,
            )
            facts = {
                "touches": touches,
                "surface": str(surface),
                "rank": rank,
                "usual": load is usual,
            }
            facts |= {"jaw": hand.kind == "parallel_jaw", "family": grasps[rank].family}
            facts["planned"] = grasps[rank].quality["success_probability"]
            observed = {"held": outcome.held, "reason": outcome.reason, "slip": outcome.slip}
            rows.append(facts | load | qualities(scorer, grasps[rank], jaws) | observed)
    return rows


def qualities(scorer: GraspScorer, grasp: Grasp, hand: Hand) -> Row:
    """Return the precise qualities of a grasp for a known load."""
    batch = scorer.predict_success(GraspBatch.of_grasps([grasp], hand))
    return {name: float(values[0]) for name, values in batch.quality.items()}


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
        ("Brier score", both(lambda predicted, held: np.mean((predicted - held) ** 2))),
        ("pairs in order", both(pairs_in_order)),
    ]


def pairs_in_order(predicted: np.ndarray, held: np.ndarray) -> float:
    """Return the fraction of pairs, one held and one lost, of which the held one is predicted more.

    It is the area under the curve of true over false positives; NaN without such a pair.
    """
    won, lost = predicted[held > 0.5], predicted[held < 0.5]
    if not (len(won) and len(lost)):
        return float("nan")
    return float(mannwhitneyu(won, lost).statistic / (len(won) * len(lost)))


def report(rows: list[Row]) -> None:
    fitted = fit(rows)
    print("fit of the success model:", fitted["shape"], fitted["load"])
    refitted = predicted_for_new_objects(rows)
    rows = [row | {"refitted": float(p)} for row, p in zip(rows, refitted, strict=True)]
    for column, title in (
        ("success_probability", "Predictions by the constants in use"),
        ("refitted", "Each object predicted by a fit to the others"),
    ):
        binned = [row | {"decile": f"{int(10 * row[column]) / 10:.1f}"} for row in rows]
        for by in ("surface", "usual", "decile"):
            groups = {("all", ""): binned, **dict(sorted(split(binned, "hand", by).items()))}
            columns = calibration_columns(column)
            print(grouped_table(column, title, f"hand | {by}", groups, columns).text())


def predict(rows: list[Row], model: Mapping[str, Any]) -> np.ndarray:
    """Return the success probability of lifts by a success model."""
    kinds = ["soft_finger" if row["jaw"] else "coulomb" for row in rows]

    def by_kind(factor: str, name: str) -> np.ndarray:
        return np.array([model[factor][kind][name] for kind in kinds])

    def log(name: str) -> np.ndarray:
        return np.log(values_of(rows, name) + model["offsets"][name])

    shape = by_kind("shape", "intercept") + by_kind("shape", "slope") * log("load_expected")
    spare = log("acceleration") - np.log(by_kind("load", "acceleration"))
    burden = np.log(values_of(rows, "mass") / model["mass"]["usual"])
    load = by_kind("load", "slope") * spare - model["mass"]["slope"] * burden
    return model["ceiling"] * expit(shape) * expit(load)


# Intercept and slope of the shape, and the logarithm of the acceleration, as 974 lifts before
# version 2.0 gave them; and how far a fit to some hundred lifts departs from them, one deviation.
START = {"coulomb": (4.85, 2.7, np.log(6.42)), "soft_finger": (6.09, 2.7, np.log(0.326))}
DEVIATIONS = np.array([4.0, 2.0, 1.0])


def fit(rows: list[Row]) -> dict[str, Any]:
    """Return the most probable success model of lifts; constants that are not in `START` stay."""
    model = dict(SUCCESS_MODEL)
    for kind, start in START.items():
        own = [row for row in rows if row["jaw"] == (kind == "soft_finger")]
        held = np.array([row["held"] for row in own], dtype=bool)

        def changed(values: np.ndarray, model=model, kind=kind) -> dict[str, Any]:
            intercept, slope, log_acceleration = values.tolist()
            shape = {"intercept": intercept, "slope": slope}
            load = model["load"][kind] | {"acceleration": float(np.exp(log_acceleration))}
            return model | {
                "shape": model["shape"] | {kind: shape},
                "load": model["load"] | {kind: load},
            }

        def loss(values: np.ndarray, own=own, held=held, start=start, changed=changed) -> float:
            p = predict(own, changed(values))
            prior = 0.5 * (((values - start) / DEVIATIONS) ** 2).sum()
            return float(prior - np.log(np.where(held, p, 1.0 - p)).sum())

        model = changed(minimize(loss, start, method="L-BFGS-B").x)
    return model


def predicted_for_new_objects(rows: list[Row]) -> np.ndarray:
    """Return the probabilities of all lifts, those of an object by a fit to the other objects."""
    objects = np.array([Path(row["object"]).stem for row in rows])
    probability = np.empty(len(rows))
    for name in np.unique(objects):
        others = fit([row for row, of in zip(rows, objects, strict=True) if of != name])
        own = [row for row, of in zip(rows, objects, strict=True) if of == name]
        probability[objects == name] = predict(own, others)
    return probability


def main() -> None:
    development = [name for names in DEVELOPMENT.values() for name in names]
    defaults = {"objects": development, "seeds": [50], "hands": ["allegro", "wsg50"], "jobs": 2}
    defaults |= {"grasps": 8}
    options = read_options(__doc__, **defaults, output=Path("results/calibration"))
    objects = options.objects
    if objects == development:
        objects = [*objects, *stretched_objects(options.output / "objects")]
    trials = [
        CalibrationTrial(*names) for names in product(objects, options.seeds, [options.grasps])
    ]
    experiment = Experiment("calibration", lifts, variant="hand")
    file = options.output / "rows.jsonl"
    rows = experiment.complete(trials, options.hands, file, jobs=options.jobs)
    report([row for row in rows if row["reason"] is not None])


if __name__ == "__main__":
    main()
