"""Experiment: objects with flat faces are lifted and put down, planned on each surface.

The plan, written before a run. Objects of a salt that is taken after everything that is compared is
fixed: nobody saw them. Each rests on the table in its likeliest pose, weighs 0.2 kg, is fixed at a
known place and touched 40 times by the four-finger hand's kinematic prober, with 0.5 mm and 3
degrees of noise. The hands, in turns from object to object, lift it by the grasp that is planned
best on each surface, and put it down on the table, and in a corner: one attempt each, in Drake and
in MuJoCo.

The primary endpoint is the fraction of placed objects (`PlaceOutcome.placed`: within 5 mm and 5
degrees of the plan, released, no wall pushed by more than 2 N) in Drake, of those that were held
after the shake. Goals: 92 % on `blend`, 97 % on `truth`. A plan without a free place is a loss.
Beside it: how often both simulators agree on `placed`, of the objects held in both; goal 95 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import ClassVar, Literal

import numpy as np
import trimesh

from lis_grasp.exceptions import LisGraspError
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.io.json_lines import Row
from lis_grasp.stages.lift import lift_object
from lis_grasp.stages.place import with_place
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.stages.scenario import Scenario
from lis_grasp_studies.evaluation.part import SaltedPart, SaltedTrial
from lis_grasp_studies.evaluation.suction_lifts import explored, reasons
from lis_grasp_studies.evaluation.touched_shapes import estimated_mesh, scenario_of
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.statistics import rate_with_interval
from lis_grasp_studies.harness.tables import NONE, Column, Table, grouped_table, split, where
from lis_grasp_studies.study.run import DRAKE

_HANDS = ("wsg50", "allegro")
_GOALS = ("table", "corner")
_SIMULATORS = ("drake", "mujoco")
_MASS = 0.2  # [kg]


def measure_placings(trial: SaltedTrial, estimator: str) -> list[Row]:
    """Return what became of an object on the table and in a corner, a row a simulator."""
    shape, contacts = explored(trial)
    mesh = estimated_mesh(estimator, shape, contacts)
    facts = {"object": shape.name, "hand": _HANDS[trial.number % len(_HANDS)]}
    rows = []
    for goal in _GOALS:
        options = {"hand": facts["hand"], "place": goal}
        scenarios = {
            name: with_place(
                scenario_of(shape, trial.seed, grasps=1, mass=_MASS, simulator=name, **options)
            )
            for name in _SIMULATORS
        }
        grasp = _planned(scenarios[_SIMULATORS[0]], mesh)  # the plan knows no simulator
        for name, scenario in scenarios.items():
            row = {"goal": goal, "simulator": name, "held": False, "placed": False}
            end = grasp if isinstance(grasp, dict) else _put_down(scenario, grasp, mesh)
            rows.append(facts | row | end)
    return rows


def _planned(scenario: Scenario, mesh: trimesh.Trimesh) -> Grasp | Row:
    """Return the best grasp on a mesh, or the row of a trial without one."""
    try:
        search = plan_grasps(scenario.agent, mesh)
    except LisGraspError as error:
        return _failed(error)
    return search.best if search.grasps else {"reason": "no_grasp"}


def _put_down(scenario: Scenario, grasp: Grasp, mesh: trimesh.Trimesh) -> Row:
    """Return the outcome of a grasp on a mesh, lifted and put down."""
    try:
        outcome = lift_object(scenario, grasp, estimate=mesh)
    except LisGraspError as error:
        return _failed(error)
    place = outcome.place
    assert place is not None  # the task asks for one
    measured = {key: getattr(place, key) for key in ("moved", "turned", "leaning", "felt")}
    return {"held": outcome.held, "placed": place.placed, "reason": place.reason} | measured


def _failed(error: LisGraspError) -> Row:
    return {"reason": type(error).__name__, "failure": str(error)}


PLACINGS = Experiment("placings", measure_placings, asdict, modules=(DRAKE,))
"""The experiment; its variants are estimators and `TRUTH`."""


class PlacingsPart(SaltedPart):
    """Objects put down on the table and in a corner."""

    measure: Literal["placings"]
    experiment: ClassVar[Experiment] = PLACINGS

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the placed objects of those held, for each surface and goal."""
        columns: list[Column] = [
            ("placed, of those held (95 %)", lambda of: _rate(_held(of))),
            ("on the table", lambda of: _rate(where(_held(of), goal="table"))),
            ("in a corner", lambda of: _rate(where(_held(of), goal="corner"))),
            ("moved [mm]", lambda of: _median(of, "moved", 1e3)),
            ("turned [deg]", lambda of: _median(of, "turned", 180.0 / np.pi)),
            ("other ends", lambda of: reasons(r for r in _held(of) if not r["placed"])),
            ("MuJoCo agrees", lambda of: "{} of {}".format(*_agreement(of))),
        ]
        title = "Put down after the lift"
        return [grouped_table("placings", title, "planned on", split(rows, "estimator"), columns)]

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return how many objects were placed, of those held, and how often MuJoCo agrees."""
        found: dict[str, float] = {}
        for name, of in split(rows, "estimator").items():
            held, (alike, judged) = _held(of), _agreement(of)
            found |= {f"placed {name}": _placed(held), f"held {name}": len(held)}
            found |= {f"alike {name}": alike, f"judged {name}": judged}
        return found


def _held(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of objects that Drake held after the shake."""
    return [row for row in where(rows, simulator="drake") if row["held"]]


def _placed(rows: Sequence[Row]) -> int:
    return sum(row["placed"] for row in rows)


def _rate(rows: Sequence[Row]) -> str:
    return rate_with_interval(_placed(rows), len(rows)) if rows else NONE


def _agreement(rows: Sequence[Row]) -> tuple[int, int]:
    """Return how many placings end alike in both simulators, of how many held in both."""
    pairs = split((row for row in rows if row["held"]), "estimator", "number", "seed", "goal")
    both = [pair for pair in pairs.values() if len(pair) == len(_SIMULATORS)]
    return sum(len({row["placed"] for row in pair}) == 1 for pair in both), len(both)


def _median(rows: Sequence[Row], name: str, scale: float) -> str:
    values = [row[name] for row in _held(rows) if row.get(name) is not None]
    return f"{scale * np.median(values):.1f}" if values else NONE
