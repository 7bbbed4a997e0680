"""Lifts of grasps on unknown objects in each simulator: Drake, CENIC and MuJoCo.

A grasp is planned once, and executed in each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import combinations

import numpy as np

from lis_grasp import Hand
from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.task.world import SIMULATORS
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.tables import Column, Table, columns_by, grouped_table, split, where
from lis_grasp_studies.study.cells import difference
from lis_grasp_studies.study.columns import FAILED, NO_GRASP
from lis_grasp_studies.study.comparison import pairs_of
from lis_grasp_studies.study.run import (
    DRAKE,
    estimate,
    lift,
    plan,
    shape_at,
    touch,
)
from lis_grasp_studies.study.trial import TRUTH, Trial, columns_of

_OUTCOME = ("held", "lifted", "reason", "slip", "turn")
_LABELS = {"drake": "Drake", "cenic": "CENIC", "mujoco": "MuJoCo"}
_KEY = ("object", "hand", "seed", "estimator")
_PAIR = ("drake", "mujoco")


def lift_in_each(trial: Trial, estimator: str) -> list[Row]:
    """Touch, estimate and plan; return the outcome of the best grasp in each simulator."""
    no_lift: Row = {"held": False, "lifted": False, "reason": NO_GRASP}
    outcomes = dict.fromkeys(SIMULATORS, no_lift)
    try:
        shape, hand = trial.find_object(), Hand.load(trial.hand)
        touched = touch(trial, trial.explorer(estimator))
        if estimator == TRUTH:
            mesh = shape_at(shape, touched.X_EO).mesh
        else:
            mesh = estimate(trial, estimator, touched.contacts)
        for grasp in plan(trial, mesh, shape, hand).grasps[:1]:
            known = {"success_probability": grasp.quality["success_probability"]}
            for name in SIMULATORS:
                outcome = lift(trial, grasp, shape, hand, touched.X_EO, simulator=name)
                outcomes[name] = {key: getattr(outcome, key) for key in _OUTCOME} | known
    except LisGraspError as error:
        outcomes = dict.fromkeys(SIMULATORS, no_lift | {"reason": FAILED, "failure": str(error)})
    return [{"simulator": name} | outcome for name, outcome in outcomes.items()]


SIMULATIONS = Experiment("simulators", lift_in_each, columns_of, modules=(DRAKE,))
"""All grasps in each simulator."""


def agreements(rows: Sequence[Row], pair: Sequence[str] = _PAIR) -> tuple[int, int]:
    """Return how many grasps have the same outcome in two simulators, of how many executed."""
    executed = (row for row in rows if row["reason"] not in (FAILED, NO_GRASP))
    lifts = split((row for row in executed if row["simulator"] in pair), *_KEY)
    return sum(len({row["held"] for row in lift}) == 1 for lift in lifts.values()), len(lifts)


def held_table(rows: Sequence[Row]) -> Table:
    """Return the rates of each estimator in each simulator, in percent, and their agreement.

    Agreement is that of `held`, of grasps that were executed, for each two simulators.
    """

    def agreement(rows: Sequence[Row], pair: Sequence[str]) -> str:
        same, lifts = agreements(rows, pair)
        return f"{same} of {lifts} ({100.0 * same / max(lifts, 1):.0f} %)"

    def rate(rows: Sequence[Row]) -> str:
        return f"{100.0 * np.mean([row['held'] for row in rows]):.0f}"

    names = [name for name in _LABELS if where(rows, simulator=name)]
    columns: list[Column] = [
        ("trials", lambda rows: str(len(split(rows, *_KEY)))),
        *columns_by("simulator", rows, rate, lambda name: f"held in {_LABELS[name]} [%]"),
        *((_agree(pair), partial(agreement, pair=pair)) for pair in combinations(names, 2)),
    ]
    groups = {estimator_label(name): part for name, part in split(rows, "estimator").items()}
    return grouped_table("simulators", "Held in each simulator", "planned on", groups, columns)


def _agree(pair: tuple[str, str]) -> str:
    return "agree" if pair == _PAIR else " and ".join(_LABELS[name] for name in pair) + " agree"


def difference_table(rows: Sequence[Row], estimator: str, reference: str) -> Table:
    """Return the difference of both estimators' rates in each simulator, in points, by hand."""

    def cell(rows: Sequence[Row]) -> str:
        return difference(pairs_of(rows, [estimator], reference))

    groups = {text: where(rows, simulator=name) for name, text in _LABELS.items()}
    columns = [*columns_by("hand", rows, cell), ("all", cell)]
    return grouped_table("by_hand", "Difference in points", "simulator", groups, columns)


def disagreements_table(rows: Sequence[Row]) -> Table:
    """Return the grasps held in one simulator only."""

    def end(lift: Sequence[Row]) -> str:
        (row,) = lift
        turn = f"{np.degrees(row.get('turn') or 0.0):.0f}°"
        return f"{row['reason']}, {1e3 * (row.get('slip') or 0.0):.0f} mm, {turn}"

    columns = columns_by("simulator", rows, end, lambda name: _LABELS[name])
    groups = {
        (name, f"`{hand}`", estimator_label(estimator)): lift
        for (name, hand, _, estimator), lift in split(rows, *_KEY).items()
        if len({row["held"] for row in lift}) > 1
    }
    title = "Held in one simulator only"
    return grouped_table("disagreements", title, "object | hand | planned on", groups, columns)
