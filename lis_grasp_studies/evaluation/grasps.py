"""Experiment: grasps on unknown objects after several numbers of touches and of attempts."""

from __future__ import annotations

from dataclasses import dataclass, replace

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.rows import Job
from lis_grasp_studies.study.run import DRAKE, rows_of
from lis_grasp_studies.study.trial import Trial, columns_of


@dataclass(frozen=True, slots=True)
class GraspTrial:
    """One exploration, and the grasps that are planned after some of its touches."""

    trial: Trial
    """Without the numbers of touches and attempts, which are not used."""
    budgets: str
    """Numbers of touches, from small to large, joined by spaces: "20x3" permits three attempts."""

    def facts(self) -> Row:
        """Return the columns that identify the trial."""
        columns = columns_of(self.trial)
        del columns["touches"]
        return columns | {"budgets": self.budgets}


def measure_grasps(task: GraspTrial, estimator: str) -> list[Row]:
    """Return the row of a study's trial for each number of touches and attempts."""
    rows: list[Row] = []
    for budget in task.budgets.split():
        touches, _, attempts = budget.partition("x")
        setup = replace(task.trial.setup, attempts=int(attempts or 1))
        rows += rows_of(Job(replace(task.trial, touches=int(touches), setup=setup), (estimator,)))
    return rows


GRASPS = Experiment("grasps", measure_grasps, GraspTrial.facts, modules=(DRAKE,))
"""The experiment; its variants are estimators, or "truth"."""
