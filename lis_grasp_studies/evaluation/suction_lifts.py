"""Experiment: lifts with a suction cup of objects with flat faces, planned on each surface.

The plan, written before a run. Objects of a salt that is taken after everything that is compared is
fixed: nobody saw them. Each rests on the table in its likeliest pose, weighs 0.2 kg, is fixed at a
known place and touched 40 times by the four-finger hand's kinematic prober, with 0.5 mm and 3
degrees of noise. The shipped cup of 10 mm is planned on each estimate, and the first grasp is
lifted and shaken in Drake: one attempt.

The primary endpoint is the fraction of lifts that are held, of objects that the cup can hold: those
where planning on the true mesh finds a place that holds through the shake in more than half of the
loads that the planner draws (`CARRIES`). A plan without a grasp is a loss. Goals: 95 % on `blend`,
99 % on `truth`. Beside it: plans whose cup truly seals, and predicted against observed seals.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import ClassVar, Literal

from lis_grasp import Contacts, pipeline
from lis_grasp.exceptions import LisGraspError
from lis_grasp.geometry import make_pose
from lis_grasp.grasping.seals import press_cups
from lis_grasp.io.json_lines import Row
from lis_grasp.shapes import Shape, resting_poses
from lis_grasp.shapes.mesh_distance import MeshTree
from lis_grasp.shapes.placement import placed
from lis_grasp.stages.plan import plan_grasps
from lis_grasp_studies.evaluation.part import SaltedPart, SaltedTrial
from lis_grasp_studies.evaluation.touched_shapes import (
    TRUTH,
    estimated_mesh,
    scenario_of,
    touched,
)
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.statistics import rate_with_interval
from lis_grasp_studies.harness.tables import Column, Table, grouped_table, mean_cell, split
from lis_grasp_studies.study.run import DRAKE
from lis_grasp_studies.test_objects.salted import salted_shape

CARRIES = 0.5
"""Predicted success on the true mesh above which the cup can hold an object."""

_MASS = 0.2  # [kg]
_NO_GRASP = "no grasp"


def measure_suction(trial: SaltedTrial, estimator: str) -> Row:
    """Return the first grasp that is planned on an estimate, and its lift of the true object."""
    shape, contacts = explored(trial)
    row: Row = {"object": shape.name, "family": shape.name.split("-")[0]}
    row |= {"held": 0, "lifted": 0, "seals": 0, "reason": _NO_GRASP}
    scenario = scenario_of(shape, trial.seed, hand="cup", grasps=1, mass=_MASS)
    cup = scenario.agent.hand.cup
    assert cup is not None
    try:
        search = plan_grasps(scenario.agent, estimated_mesh(estimator, shape, contacts))
        if not search.grasps:
            return row
        best, tree = search.best, MeshTree(shape.mesh)
        row |= {k: best.quality[f"{k}_probability"] for k in ("closure", "success")}
        row |= {"acceleration": best.quality["acceleration"]}
        _, _, nearest = tree.nearest(best.contact_points)
        row["seals"] = int(press_cups(tree, nearest, best.contact_normals, cup).sealed[0])
        outcome = pipeline.lift(scenario, best)
    except LisGraspError as error:
        return row | {"reason": str(error)}
    row |= {"held": int(outcome.held), "lifted": int(outcome.lifted), "reason": outcome.reason}
    return row | {"slip": outcome.slip, "turn": outcome.turn}


@lru_cache(maxsize=2)  # all estimators get the same contacts
def explored(trial: SaltedTrial) -> tuple[Shape, Contacts]:
    """Return the object in its likeliest resting pose, and the contacts of its exploration."""
    shape = salted_shape(trial.salt, trial.number)
    shape = placed(shape, make_pose(resting_poses(shape.mesh)[0].rotation))
    return shape, touched(shape, trial.seed)


SUCTION = Experiment("suction", measure_suction, asdict, modules=(DRAKE,))
"""The experiment; its variants are estimators and `TRUTH`."""


class SuctionPart(SaltedPart):
    """Lifts with a suction cup of objects with flat faces."""

    measure: Literal["suction"]
    experiment: ClassVar[Experiment] = SUCTION

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the lifts of objects that the cup can hold, and of all."""
        columns: list[Column] = [
            ("held (95 %)", _held),
            ("held, of all", lambda rows: rate_with_interval(_count(rows), len(rows))),
            ("truly seals [%]", mean_cell("seals", 100.0, 0)),
            ("predicted to seal [%]", mean_cell("closure", 100.0, 0)),
            ("predicted to hold [%]", mean_cell("success", 100.0, 0)),
            ("reasons of losses", lambda rows: reasons(r for r in rows if not r["held"])),
        ]
        title = "Lifts with the first cup"
        groups = split(with_holdable(rows), "estimator")
        return [grouped_table("suction", title, "planned on", groups, columns)]

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return how many lifts were held, of objects that the cup can hold."""
        found: dict[str, float] = {}
        for name, of in split(with_holdable(rows), "estimator").items():
            able = [row for row in of if row["holdable"]]
            found |= {f"held {name}": _count(able), f"lifts {name}": len(able)}
        return found


def with_holdable(rows: Sequence[Row]) -> list[Row]:
    """Return rows with a column `holdable`: whether the cup can hold the object, by its truth."""
    able = {
        (row["number"], row["seed"])
        for row in rows
        if row["estimator"] == TRUTH and row.get("success", 0.0) > CARRIES
    }
    return [row | {"holdable": (row["number"], row["seed"]) in able} for row in rows]


def _count(rows: Sequence[Row]) -> int:
    return sum(row["held"] for row in rows)


def _held(rows: Sequence[Row]) -> str:
    able = [row for row in rows if row["holdable"]]
    return rate_with_interval(_count(able), len(able))


def reasons(rows: Iterable[Row]) -> str:
    """Return how lifts ended, with their numbers, in the order of the reasons' names."""
    lost = sorted(split(rows, "reason").items())
    return ", ".join(f"{reason} {len(of)}" for reason, of in lost)
