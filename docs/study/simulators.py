"""Lift grasps of the study of unknown objects in both simulators, Drake and MuJoCo; see plan.md.

python docs/study/simulators.py --meshes ycb     # continues where it stopped

Objects, conditions and estimators are the study's; 40 touches, the first seed of each hand. A grasp
is planned once, and executed in both simulators.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np
import trimesh
from write_studies import SEEDS, trials_of

from lis_grasp import Grasp, Hand
from lis_grasp.exceptions import LisGraspError
from lis_grasp.experiments.figures.palette import estimator_label
from lis_grasp.experiments.report_page import TextTable
from lis_grasp.experiments.runner import local_scheduler, run_trials, single_thread
from lis_grasp.experiments.study.comparison import names, pairs_of
from lis_grasp.experiments.study.paired_tables import difference
from lis_grasp.experiments.study.study_trial import (
    FAILED,
    NO_GRASP,
    estimate,
    lift,
    plan,
    shape_at,
    touch,
)
from lis_grasp.experiments.study.trial import TRUTH, Trial, label
from lis_grasp.experiments.trial_results import Job, TrialResults, missing_jobs
from lis_grasp.io.json_lines import Row
from lis_grasp.lifting.lift_outcome import LiftOutcome
from lis_grasp.pipeline import support_height
from lis_grasp.pipeline.regrasp import lift_options
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray

TOUCHES = 40
ESTIMATORS = ("gpis", "blend", TRUTH)


def run(job: Job) -> list[Row]:
    """Return a row for each estimator and simulator of a trial."""
    import_module("lis_grasp.simulation.simulate_lift")  # so that Drake's threads are limited, too
    with single_thread():
        return [row for name in job.variants for row in _rows(job.trial, name)]


def _rows(trial: Trial, estimator: str) -> list[Row]:
    names = ("hand", "touches", "noise", "seed")
    facts = {"object": label(trial.object)} | {name: getattr(trial, name) for name in names}
    facts |= {"estimator": estimator}
    try:
        outcomes = _outcomes(trial, estimator)
    except LisGraspError as error:
        outcomes = {name: _not_lifted(FAILED) | {"failure": str(error)} for name in SIMULATORS}
    return [facts | {"simulator": name} | outcome for name, outcome in outcomes.items()]


def _outcomes(trial: Trial, estimator: str) -> dict[str, Row]:
    """Plan the best grasp of an estimator, and return its outcome in each simulator."""
    shape, hand = trial.find_object(), Hand.load(trial.hand)
    touched = touch(trial, trial.explorer(estimator))
    if estimator == TRUTH:
        mesh = shape_at(shape, touched.X_EO).mesh
    else:
        mesh = estimate(trial, estimator, touched.contacts)
    grasps = plan(trial, mesh, shape, hand).grasps
    if not grasps:
        return {name: _not_lifted(NO_GRASP) for name in SIMULATORS}
    predicted = float(grasps[0].quality["success_probability"])
    found = {}
    for name, simulate in SIMULATORS.items():
        outcome = simulate(trial, grasps[0], shape, hand, touched.X_EO)
        facts = ("held", "lifted", "reason", "slip", "turn")
        found[name] = {fact: getattr(outcome, fact) for fact in facts}
        found[name]["success_probability"] = predicted
    return found


def _not_lifted(reason: str) -> Row:
    return {"held": False, "lifted": False, "reason": reason}


def _lift_in_mujoco(
    trial: Trial, grasp: Grasp, shape: Shape, hand: Hand, X_EO: FloatArray | None
) -> LiftOutcome:
    from lis_grasp.mujoco_simulation.simulate_in_mujoco import simulate_in_mujoco

    return simulate_in_mujoco(
        shape.mesh,
        hand,
        grasp,
        support_height=support_height(shape),
        mass=trial.setup.mass,
        friction=trial.setup.friction,
        options=lift_options(trial.run_config().load_prior(shape.mesh)),
        X_WO=X_EO,
        pieces=_pieces(trial),
    )


@cache
def _pieces(trial: Trial) -> tuple[trimesh.Trimesh, ...]:
    from lis_grasp.mujoco_simulation.convex_pieces import convex_pieces

    return convex_pieces(trial.find_object().mesh)


SIMULATORS: dict[str, Callable[..., LiftOutcome]] = {"drake": lift, "mujoco": _lift_in_mujoco}
_LABELS = {"drake": "Drake", "mujoco": "MuJoCo"}


def held_table(rows: Sequence[Row]) -> TextTable:
    """Return the rates of each estimator in both simulators, in percent, and their agreement.

    Agreement is that of `held`, of grasps that were executed.
    """
    body = []
    for name in names(rows, "estimator"):
        own = [row for row in rows if row["estimator"] == name]
        both = [_by_trial(own, simulator) for simulator in SIMULATORS]
        executed = [key for key, row in both[0].items() if row["reason"] not in (FAILED, NO_GRASP)]
        agree = sum(both[0][key]["held"] == both[1][key]["held"] for key in executed)
        rates = [100.0 * np.mean([row["held"] for row in of.values()]) for of in both]
        share = f"{agree} of {len(executed)} ({100.0 * agree / max(len(executed), 1):.0f} %)"
        body.append((estimator_label(name), str(len(both[0])), *(f"{r:.0f}" for r in rates), share))
    head = ("planned on", "trials", *(f"held in {x} [%]" for x in _LABELS.values()), "agree")
    return TextTable("simulators", "Held in both simulators", head, tuple(body))


def difference_table(rows: Sequence[Row], estimator: str, reference: str) -> TextTable:
    """Return the difference of both estimators' rates in each simulator, in points, by hand."""
    hands = names(rows, "hand")
    body = []
    for simulator, text in _LABELS.items() if rows else ():
        own = [row for row in rows if row["simulator"] == simulator]
        pairs = pairs_of(own, [estimator], reference)
        parts = [[pair for pair in pairs if pair[0]["hand"] == hand] for hand in hands]
        body.append((text, *(difference(part, over_objects=True) for part in (*parts, pairs))))
    return TextTable("by_hand", "Difference in points", ("simulator", *hands, "all"), tuple(body))


def _by_trial(rows: Sequence[Row], simulator: str) -> dict[tuple, Row]:
    return {
        (row["object"], row["hand"], row["seed"]): row
        for row in rows
        if row["simulator"] == simulator
    }


def main() -> None:
    """Run the trials that are missing, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--meshes", type=Path, required=True, help="folder of the six scans")
    parser.add_argument("--hands", nargs="+", default=list(SEEDS), choices=SEEDS)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--output", type=Path, default=Path("results/unknown/simulators.jsonl"))
    options = parser.parse_args()
    trials = [
        trial
        for hand in options.hands
        for trial in trials_of(hand, SEEDS[hand][:1], TOUCHES, options.meshes)
    ]
    results = TrialResults(options.output, "simulators")
    known = {(r["object"], r["hand"], r["seed"], r["estimator"]) for r in results.read()}
    jobs = missing_jobs(
        trials, ESTIMATORS, known, lambda t, name: (label(t.object), t.hand, t.seed, name)
    )
    for done, of in run_trials(jobs, len(trials), results, local_scheduler(options.jobs), run):
        print(f"\r{done} of {of}", end="", flush=True)
    rows = results.read()
    print(
        f"\n{held_table(rows).markdown()}\n\n{difference_table(rows, 'blend', 'gpis').markdown()}"
    )


if __name__ == "__main__":
    main()
