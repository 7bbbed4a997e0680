"""Lift grasps of the study of unknown objects in both simulators, Drake and MuJoCo; see plan.md.

python docs/study/simulators.py --meshes ycb     # continues where it stopped

Objects, conditions and estimators are the study's; 40 touches, the first seed of each hand. A grasp
is planned once, and executed in both simulators. Where they disagree, it is lifted again with a
tenth less and more mass and friction, and with the object half a millimetre aside along x and y.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from write_studies import SEEDS, trials_of

from lis_grasp import Grasp, Hand
from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.run_config import SIMULATORS
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.report_page import TextTable
from lis_grasp_studies.runner import Runner, local_scheduler, run_trials
from lis_grasp_studies.study.comparison import names, pairs_of
from lis_grasp_studies.study.paired_tables import difference
from lis_grasp_studies.study.study_trial import (
    FAILED,
    NO_GRASP,
    estimate,
    lift,
    plan,
    shape_at,
    single_threaded_drake,
    touch,
)
from lis_grasp_studies.study.trial import TRUTH, Trial, label
from lis_grasp_studies.trial_results import Job, TrialResults, missing_jobs

KINDS = ("simulators", "limits")
"""Files of rows: all grasps in both simulators; and again where these disagree."""

TOUCHES = 40
ESTIMATORS = ("gpis", "blend", TRUTH)
_ASIDE = 5e-4  # displacement of an object, to see whether an outcome is at a limit [m]
_OUTCOME = ("held", "lifted", "reason", "slip", "turn")
_LABELS = {"drake": "Drake", "mujoco": "MuJoCo"}


def run(job: Job) -> list[Row]:
    """Return a row for each estimator and simulator of a trial."""
    return _alone(_rows, job)


def run_limits(job: Job) -> list[Row]:
    """Return a row for each estimator, change of the conditions and simulator of a trial."""
    return _alone(_changed_rows, job)


def _alone(rows: Callable[[Trial, str], list[Row]], job: Job) -> list[Row]:
    with single_threaded_drake():
        return [row for name in job.variants for row in rows(job.trial, name)]


def _facts(trial: Trial, estimator: str) -> Row:
    names = ("hand", "touches", "noise", "seed")
    facts = {"object": label(trial.object)} | {name: getattr(trial, name) for name in names}
    return facts | {"estimator": estimator}


def _rows(trial: Trial, estimator: str) -> list[Row]:
    outcome: Row = {"held": False, "lifted": False, "reason": NO_GRASP}
    outcomes = dict.fromkeys(SIMULATORS, outcome)
    try:
        planned = _plan(trial, estimator)
        if planned is not None:
            outcomes = {name: planned.lift(trial, name) for name in SIMULATORS}
    except LisGraspError as error:
        outcomes = dict.fromkeys(SIMULATORS, outcome | {"reason": FAILED, "failure": str(error)})
    facts = _facts(trial, estimator)
    return [facts | {"simulator": name} | found for name, found in outcomes.items()]


@dataclass(frozen=True, slots=True)
class _Planned:
    """The best grasp of an estimator, and the true object at its pose X_EO (4, 4)."""

    grasp: Grasp
    shape: Shape
    hand: Hand
    X_EO: FloatArray | None

    def lift(self, trial: Trial, simulator: str) -> Row:
        """Return the outcome of the grasp in the conditions of a trial."""
        outcome = lift(trial, self.grasp, self.shape, self.hand, self.X_EO, simulator=simulator)
        found = {fact: getattr(outcome, fact) for fact in _OUTCOME}
        return found | {"success_probability": self.grasp.quality["success_probability"]}


def _plan(trial: Trial, estimator: str) -> _Planned | None:
    """Touch, estimate and plan; return the best grasp, None if there is none."""
    shape, hand = trial.find_object(), Hand.load(trial.hand)
    touched = touch(trial, trial.explorer(estimator))
    if estimator == TRUTH:
        mesh = shape_at(shape, touched.X_EO).mesh
    else:
        mesh = estimate(trial, estimator, touched.contacts)
    grasps = plan(trial, mesh, shape, hand).grasps
    return _Planned(grasps[0], shape, hand, touched.X_EO) if grasps else None


def _changed_rows(trial: Trial, estimator: str) -> list[Row]:
    planned = _plan(trial, estimator)
    if planned is None:
        return []
    facts, setup = _facts(trial, estimator), trial.setup
    changed = {
        f"{name} x {factor}": (
            replace(trial, setup=replace(setup, **{name: factor * getattr(setup, name)})),
            planned,
        )
        for name in ("mass", "friction")
        for factor in (0.9, 1.1)
    }
    for name, axis in (("x", 0), ("y", 1)):
        X_EO = np.eye(4) if planned.X_EO is None else planned.X_EO.copy()
        X_EO[axis, 3] += _ASIDE
        changed[f"{name} + {1e3 * _ASIDE} mm"] = trial, replace(planned, X_EO=X_EO)
    return [
        facts | {"change": change, "simulator": name} | it.lift(conditions, name)
        for change, (conditions, it) in changed.items()
        for name in SIMULATORS
    ]


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
        agreed = f"{agree} of {len(executed)} ({100.0 * agree / max(len(executed), 1):.0f} %)"
        cells = (*(f"{rate:.0f}" for rate in rates), agreed)
        body.append((estimator_label(name), str(len(both[0])), *cells))
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


def disagreements_table(rows: Sequence[Row], changed: Sequence[Row]) -> TextTable:
    """Return the grasps held in one simulator only, and how often they are held when changed."""
    body = []
    for key in disagreements(rows):
        outcomes, again = [], []
        for name in SIMULATORS:
            (row,) = (row for row in rows if _key(row) == key and row["simulator"] == name)
            turn = f"{np.degrees(row.get('turn', 0.0)):.0f}°"
            outcomes.append(f"{row['reason']}, {1e3 * row.get('slip', 0.0):.0f} mm, {turn}")
            held = [r["held"] for r in changed if _key(r) == key and r["simulator"] == name]
            again.append(f"{sum(held)} of {len(held)}" if held else "–")
        place, hand, _, estimator = key
        body.append((place, f"`{hand}`", estimator_label(estimator), *outcomes, *again))
    head = ("object", "hand", "planned on", *_LABELS.values())
    head += tuple(f"held when changed, {name}" for name in _LABELS.values())
    return TextTable("disagreements", "Held in one simulator only", head, tuple(body))


def disagreements(rows: Sequence[Row]) -> list[tuple]:
    """Return the keys of the grasps that one simulator holds only."""
    held: dict[tuple, set[bool]] = {}
    for row in rows:
        held.setdefault(_key(row), set()).add(row["held"])
    return [key for key, outcomes in held.items() if len(outcomes) > 1]


def _key(row: Row) -> tuple:
    return row["object"], row["hand"], row["seed"], row["estimator"]


def _trial_key(trial: Trial, estimator: str) -> tuple:
    return label(trial.object), trial.hand, trial.seed, estimator


def _by_trial(rows: Sequence[Row], simulator: str) -> dict[tuple, Row]:
    return {_key(row)[:3]: row for row in rows if row["simulator"] == simulator}


def main() -> None:
    """Run the trials that are missing, lift again where the simulators disagree; print tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--meshes", type=Path, required=True, help="folder of the six scans")
    parser.add_argument("--hands", nargs="+", default=list(SEEDS), choices=SEEDS)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--output", type=Path, default=Path("results/unknown"), help="folder")
    options = parser.parse_args()
    trials = [
        trial
        for hand in options.hands
        for trial in trials_of(hand, SEEDS[hand][:1], TOUCHES, options.meshes)
    ]
    lifts, limits = (TrialResults(options.output / f"{k}.jsonl", k) for k in KINDS)
    all_grasps = {_trial_key(trial, name) for trial in trials for name in ESTIMATORS}

    def run_all(results: TrialResults, runner: Runner, wanted: set[tuple]) -> list[Row]:
        known = {_key(row) for row in results.read()} | (all_grasps - wanted)
        jobs = missing_jobs(trials, ESTIMATORS, known, _trial_key)
        for done, of in run_trials(
            jobs, len(trials), results, local_scheduler(options.jobs), runner
        ):
            print(f"\r{results.kind}: {done} of {of}", end="", flush=True)
        print("\n")
        return results.read()

    rows = run_all(lifts, run, all_grasps)
    print(held_table(rows).markdown(), difference_table(rows, "blend", "gpis").markdown())
    changed = run_all(limits, run_limits, all_grasps & set(disagreements(rows)))
    print(disagreements_table(rows, changed).markdown())


if __name__ == "__main__":
    main()
