"""Parts with lifts: grasps on unknown objects, both simulators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from lis_grasp.io.json_lines import Row
from lis_grasp.task.task import option_default
from lis_grasp_studies.evaluation.grasp_tables import (
    REFERENCE,
    SUBJECT,
    attempts_table,
    families_table,
    held_rate,
    lost_table,
    rates_chart,
    stages_table,
    tested,
    ways_table,
)
from lis_grasp_studies.evaluation.part import Part, Places, group_of, interleaved
from lis_grasp_studies.evaluation.simulators import (
    SIMULATIONS,
    agreements,
    difference_table,
    disagreements_table,
    held_table,
)
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.page import Picture
from lis_grasp_studies.harness.rows import Job
from lis_grasp_studies.harness.tables import Table, split, where
from lis_grasp_studies.study.cells import difference, held_text
from lis_grasp_studies.study.comparison import pairs_of
from lis_grasp_studies.study.run import DRAKE, rows_of
from lis_grasp_studies.study.tables import calibration_table, reasons_table, summary_table
from lis_grasp_studies.study.trial import Setup, Trial, columns_of

# Objects are touched as a run does by default.
_UNKNOWN = Setup(prober="dynamic", conditions="unknown", policy=option_default("policy"))


@dataclass(frozen=True, slots=True)
class GraspTrial:
    """One exploration, and the grasps that are planned after some of its touches."""

    trial: Trial
    """Without the numbers of touches, attempts and closings, which are not used."""
    budgets: str
    """Numbers of touches, from small to large, joined by spaces: after "20", the best grasp is
    lifted as planned; "20x3" permits three attempts, whose grasps are tested first, as in a run."""
    tested: tuple[str, ...]
    """Estimators whose grasps are tested; those of the others are lifted as planned only."""

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
        if attempts and estimator not in task.tested:
            continue
        setup = task.trial.setup
        if attempts:
            setup = replace(setup, attempts=int(attempts), closings=option_default("closings"))
        rows += rows_of(Job(replace(task.trial, touches=int(touches), setup=setup), (estimator,)))
    return rows


GRASPS = Experiment("grasps", measure_grasps, GraspTrial.facts, modules=(DRAKE,))
"""The experiment; its variants are estimators, or "truth"."""


class LiftsPart(Part):
    """Lifts of objects of which nothing is known, with several hands."""

    objects: dict[str, list[str]]
    """By groups, such as families."""
    hands: list[dict[str, int]] = Field(min_length=1)
    """The hands of each round with their seeds."""
    turns: bool = False
    """Whether an object is lifted by one of the hands: they take turns from object to object, and
    change places with the next round."""
    noise: str
    touches: int = 1
    known: bool = False
    """Whether place, size and load are known, and the object is fixed and touched by geometry."""

    def rounds(self, places: Places) -> list[list[Any]]:
        """Return the trials of each round: hands in turn, objects of all groups in turn."""
        setup = Setup() if self.known else _UNKNOWN
        names = [name for _, name in interleaved(self.objects)]
        return [
            [
                self.trial(Trial(found, hand, self.touches, self.noise, seed, setup))
                for turn, name in enumerate(names, start=number)
                for found in places.find([name])
                for hand, seed in self._hands_of(turn, hands)
            ]
            for number, hands in enumerate(self.hands)
        ]

    def _hands_of(self, turn: int, hands: dict[str, int]) -> list[tuple[str, int]]:
        """Return the hands that lift an object, with their seeds."""
        every = list(hands.items())
        return [every[turn % len(every)]] if self.turns else every

    def trial(self, trial: Trial) -> Any:
        """Return the trial of the experiment for a study's trial."""
        return trial


class GraspsPart(LiftsPart):
    """Grasps after several numbers of touches and attempts."""

    measure: Literal["grasps"]
    budgets: str
    tested: list[str] = Field(default_factory=list)
    experiment: ClassVar[Experiment] = GRASPS

    def trial(self, trial: Trial) -> GraspTrial:
        """Return the trial with all budgets."""
        return GraspTrial(trial, self.budgets, tuple(self.tested))

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the rates by family, lost objects, ways to grasp, attempts, calibration, times."""
        once = _as_planned(rows)
        return [
            families_table(once, self.objects),
            lost_table(once),
            summary_table(once, REFERENCE),
            ways_table(once),
            attempts_table(rows),
            calibration_table(once),
            reasons_table(once),
            stages_table(sorted(once, key=itemgetter("hand", "touches"))),
        ]

    def pictures(self, rows: Sequence[Row]) -> list[Picture]:
        """Return the chart of rates by touches, and by family."""
        once, family = _as_planned(rows), group_of(self.objects)
        by_touches = sorted(once, key=itemgetter("touches"))
        by_family = sorted(once, key=lambda row: list(self.objects).index(family[row["object"]]))
        return [
            rates_chart(by_touches, lambda row: f"{row['touches']} touches", "Held"),
            rates_chart(by_family, lambda row: family[row["object"]], "Held by family"),
        ]

    def answers(self, rows: Sequence[Row]) -> dict[str, str]:
        """Return the rates of grasps lifted as planned, and of tested ones."""
        once, more = _as_planned(rows), tested(rows)
        found = {}
        for question, part in (
            ("How often is an unknown object held, by one grasp?", once),
            ("And if grasps are tested by touch, in one to several attempts?", more),
        ):
            if part and not self.known:
                texts = [
                    f"{estimator_label(name)}: {held_text(of)} % of {len(of)} trials"
                    for name, of in split(part, "estimator").items()
                ]
                lead = difference(pairs_of(part, [SUBJECT], REFERENCE))
                texts.append(f"blend minus GPIS, for other objects: {lead} points")
                found[question] = "; ".join(texts)
        return found

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return the trials of an estimator, held rates [%], of families and tested grasps too.

        "predicted" is the mean probability of success of the grasps of `blend` that were tried,
        and "observed" the rate at which they held.
        """
        family, once = group_of(self.objects), _as_planned(rows)
        tried = [r for r in where(once, estimator=SUBJECT) if r["success_probability"] is not None]
        named = [r | {"family": family[r["object"]]} for r in once]
        more = [
            r | {"attempts": f"x{r['attempts']}", "family": family[r["object"]]}
            for r in tested(rows)
        ]
        groups = split(named, "estimator", "touches") | split(named, "estimator", "family")
        groups |= split(named, "estimator", "family", "touches")
        groups |= split(more, "estimator", "attempts")
        groups |= split(more, "estimator", "family", "attempts")
        found = {name: held_rate(of) for name, of in split(once, "estimator").items()}
        found |= {" ".join(map(str, key)): held_rate(of) for key, of in groups.items()}
        if tried:
            found["predicted"] = 100.0 * float(np.mean([r["success_probability"] for r in tried]))
            found["observed"] = held_rate(tried)
        return found | {"trials": len(where(once, estimator=SUBJECT))}


def _as_planned(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of grasps that were lifted as planned; all rows, if every one was tested."""
    return where(rows, closings=0) or list(rows)


class SimulatorsPart(LiftsPart):
    """The best grasp of each estimator, lifted in Drake and in MuJoCo."""

    measure: Literal["simulators"]
    experiment: ClassVar[Experiment] = SIMULATIONS

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return each disagreement, the rates and their differences."""
        return [
            disagreements_table(rows),
            held_table(rows),
            difference_table(rows, SUBJECT, REFERENCE),
        ]

    def answers(self, rows: Sequence[Row]) -> dict[str, str]:
        """Return how many grasps have the same outcome."""
        text = "Drake and MuJoCo agree on {agree} of {grasps} grasps".format(**self.numbers(rows))
        return {"Does a second simulator agree?": text}

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return how many grasps were executed, and how many of these have the same outcome."""
        return dict(zip(("agree", "grasps"), agreements(rows), strict=True))
