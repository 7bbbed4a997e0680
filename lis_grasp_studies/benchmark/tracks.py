"""Tracks of the benchmark: surfaces and tasks, lifts, own touches, policies, planners, hands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Literal

import trimesh
from pydantic import Field

from lis_grasp import pipeline
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.exceptions import LisGraspError
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.samplers import PLANNER_NAMES, make_planner
from lis_grasp.io.json_lines import Row
from lis_grasp.shapes import Shape
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES, ESTIMATORS
from lis_grasp_studies.benchmark.objects import GUIDE, stored_object
from lis_grasp_studies.evaluation.part import Part, Places
from lis_grasp_studies.evaluation.tasks import task_rows
from lis_grasp_studies.evaluation.touched_shapes import (
    HULL,
    TRUTH,
    estimated_mesh,
    scenario_of,
    touched,
)
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.tables import Table, grouped_table, mean_cell, split
from lis_grasp_studies.study.run import DRAKE

Compared = Literal["estimator", "policy", "planner", "hand"]

TOLERANCE = 0.025
"""Root mean square distance from truth to estimate at which an object is known, in its sizes."""

_EVERY, _MOST = 5, 40  # touches between two estimates of a policy's track, and their end
_PLANNED_ON = "blend"  # estimator whose surface planners and hands plan on
_SAMPLES = 2000  # of each surface
_SEED = 0


@dataclass(frozen=True, slots=True)
class StoredTrial:
    """One object of a protocol with its stored contacts."""

    protocol: int
    number: int


@dataclass(frozen=True, slots=True)
class LiftTrial:
    """One object of a protocol, lifted by a grasp that is planned on an estimate."""

    protocol: int
    number: int
    hand: str
    """Name of the hand; empty where hands are compared."""
    touches: int
    own: bool
    """Whether the estimator guides the touches itself; else the stored contacts are used."""


def measure_surfaces(trial: StoredTrial, estimator: str) -> list[Row]:
    """Return a row of tasks and errors for each number of contacts."""
    shape, contacts = stored_object(trial.protocol, trial.number)
    return task_rows(shape, contacts, estimator, seed=_SEED, number=trial.number)


def measure_lift(trial: LiftTrial, estimator: str) -> Row:
    """Return whether the best grasp on an estimate holds the true object."""
    return _lifted(trial, estimator, trial.hand)


def measure_hand(trial: LiftTrial, hand: str) -> Row:
    """Return whether the best grasp of a hand holds the true object."""
    return _lifted(trial, _PLANNED_ON, hand)


def measure_planner(trial: LiftTrial, planner: str) -> Row:
    """Return whether the first grasp of a planner holds the true object."""
    return _lifted(trial, _PLANNED_ON, trial.hand, planner)


def measure_policy(trial: StoredTrial, policy: str) -> Row:
    """Return the error after some touches, and the touches until the object is known."""
    shape, _ = stored_object(trial.protocol, trial.number)
    contacts = touched(shape, _SEED, policy=policy, estimator=GUIDE, touches=_MOST)
    row: Row = {"object": shape.name, "touches": _MOST + _EVERY, "contacts": len(contacts)}
    for count in range(_EVERY, _MOST + 1, _EVERY):
        try:
            mesh = estimated_mesh(GUIDE, shape, contacts[:count])
            found = surface_error(mesh, shape, samples=_SAMPLES).rmsd_truth_to_estimate
        except LisGraspError:
            continue
        row[f"error_{count}"] = found
        if found <= TOLERANCE * shape.size:
            row["touches"] = min(row["touches"], count)
    return row


def _lifted(trial: LiftTrial, estimator: str, hand: str, planner: str = "") -> Row:
    shape, contacts = stored_object(trial.protocol, trial.number)
    row: Row = {"object": shape.name, "held": 0, "slip": None, "reason": "", "predicted": None}
    options = {"hand": hand, "touches": trial.touches, "grasps": 1}
    try:
        mesh = _mesh_to_grasp(trial, estimator, shape, contacts, options)
        scenario = scenario_of(shape, _SEED, **options)
        if planner:
            height = scenario.agent.support_height
            sampler = make_planner(planner, scenario.agent.hand)
            found: Sequence[Grasp] = sampler.sample(mesh, rng=_SEED, support_height=height, count=1)
        else:
            found = plan_grasps(scenario.agent, mesh)
        if not len(found):
            return row | {"reason": "no grasp"}
        outcome = pipeline.lift(scenario, found[0])
    except LisGraspError as error:
        return row | {"reason": str(error)}
    predicted = found[0].success_probability
    known = {"reason": outcome.reason, "predicted": predicted, "slip": outcome.slip}
    return row | known | {"held": int(outcome.held)}


def _mesh_to_grasp(
    trial: LiftTrial, estimator: str, shape: Shape, stored: Contacts, options: Row
) -> trimesh.Trimesh:
    """Return the estimate from the stored contacts, or from those that it guided itself."""
    if not trial.own:
        return estimated_mesh(estimator, shape, stored[: trial.touches])
    guide = GUIDE if estimator in (HULL, TRUTH) else estimator
    return estimated_mesh(estimator, shape, touched(shape, _SEED, estimator=guide, **options))


def _source_of_estimator(name: str) -> str:
    return "" if name in (*ESTIMATORS, HULL, TRUTH) else ESTIMATOR_NAMES.digest(name)


def _source_of_policy(name: str) -> str:
    return POLICY_NAMES.digest(name)


def _source_of_planner(name: str) -> str:
    return PLANNER_NAMES.digest(name)


_SURFACES = Experiment("stored_tasks", measure_surfaces, asdict, source=_source_of_estimator)
_LIFTS = Experiment(
    "stored_lifts", measure_lift, asdict, source=_source_of_estimator, modules=(DRAKE,)
)
_POLICIES = Experiment(
    "stored_policies", measure_policy, asdict, variant="policy", source=_source_of_policy
)
_PLANNERS = Experiment(
    "stored_planners",
    measure_planner,
    asdict,
    variant="planner",
    source=_source_of_planner,
    modules=(DRAKE,),
)
_HANDS = Experiment("stored_hands", measure_hand, asdict, variant="hand", modules=(DRAKE,))


class Track(Part):
    """A part of a protocol: a measure of one kind of plug-in over its first objects."""

    protocol: int = Field(ge=1)
    objects: int = Field(ge=6)
    quick: int = Field(ge=6)
    """Objects of a quick run."""
    measure: str

    compares: ClassVar[Compared]

    def rounds(self, places: Places) -> list[list[Any]]:
        """Return the trials, all in one round."""
        return [[self.trial(number) for number in range(self.objects)]]

    def trial(self, number: int) -> Any:
        """Return the trial of an object."""
        return StoredTrial(self.protocol, number)

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the means of all measures, as they are in the rows."""
        kind = self.experiment.variant
        names = [
            name
            for name, value in rows[0].items()
            if isinstance(value, float) or name in ("held", "touches")
        ]
        columns = [(name, mean_cell(name, digits=4)) for name in names]
        return [grouped_table(self.measure, self.title, kind, split(rows, kind), columns)]


class SurfacesTrack(Track):
    """Surfaces and tasks from stored contacts."""

    measure: Literal["stored_tasks"]
    experiment: ClassVar[Experiment] = _SURFACES
    compares: ClassVar[Compared] = "estimator"


class LiftsTrack(Track):
    """Grasps on estimates from stored contacts, or from contacts that the estimator guided."""

    measure: Literal["stored_lifts"]
    hand: str
    touches: int = Field(ge=1)
    own: bool
    experiment: ClassVar[Experiment] = _LIFTS
    compares: ClassVar[Compared] = "estimator"

    def trial(self, number: int) -> LiftTrial:
        """Return the trial of an object."""
        return LiftTrial(self.protocol, number, self.hand, self.touches, self.own)


class PoliciesTrack(Track):
    """Touches until objects are known."""

    measure: Literal["stored_policies"]
    experiment: ClassVar[Experiment] = _POLICIES
    compares: ClassVar[Compared] = "policy"


class PlannersTrack(Track):
    """Grasps of planners on estimates from stored contacts."""

    measure: Literal["stored_planners"]
    hand: str
    touches: int = Field(ge=1)
    experiment: ClassVar[Experiment] = _PLANNERS
    compares: ClassVar[Compared] = "planner"

    def trial(self, number: int) -> LiftTrial:
        """Return the trial of an object; the planner is the variant."""
        return LiftTrial(self.protocol, number, self.hand, self.touches, own=False)


class HandsTrack(Track):
    """Grasps of hands on estimates from stored contacts."""

    measure: Literal["stored_hands"]
    touches: int = Field(ge=1)
    experiment: ClassVar[Experiment] = _HANDS
    compares: ClassVar[Compared] = "hand"

    def trial(self, number: int) -> LiftTrial:
        """Return the trial of an object; the hand is the variant."""
        return LiftTrial(self.protocol, number, "", self.touches, own=False)
