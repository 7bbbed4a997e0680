"""Experiment: runs beside other bodies, paired with the same runs alone.

The plan, written before a run. Two objects that were never used while worlds were developed, one
with flat faces and one organic, both held alone in earlier studies, rest at the origin of a table,
free, with 0.2 kg. Of each, everything but a region of 0.2 x 0.2 x 0.2 m is unknown; the bodies
beside it are known. It is touched 20 times, and grasped in one attempt, in each of 24 scenes, the
hands in turns from scene to scene and from object to object; with the same seed alone by each hand;
and in a closed box without a way in, by each hand. An object that does not fit is a row with that
reason, and counts in no rate. One seed: 56 runs.

Measured, with the goals. Held, with at most 2 N on any other body, of those held alone: 98 %, in
tight scenes 93 %. Maps lost though no touch had moved the object by 2 mm: none. Blocked probes:
alone 5 %, bin 8 %, shelf and corner 12 %, two boxes at 30 mm 15 %, at 10 mm 20 %. Runs with more
than 2 N on another body: 2 %. Neighbours moved by more than 10 mm: none. Contacts given to the
right body: 99.9 %. No way in: said after at most 20 probes, naming a body, always. CPU, median of
paired ratios: bin 1.1, shelf and corner 1.25. The last grasp, lifted as planned in MuJoCo from
where Drake's lift began, is held or not as in Drake: 95 %.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
import trimesh
from pydantic import Field
from scipy.spatial.transform import Rotation

from lis_grasp import Hand, Shape, pipeline
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.exceptions import LisGraspError
from lis_grasp.exploration import Exploration
from lis_grasp.geometry import make_pose, tangent_frame
from lis_grasp.io.json_lines import Row
from lis_grasp.results.report import world_facts
from lis_grasp.shapes import placed
from lis_grasp.shapes.resting import rest_from, resting_poses
from lis_grasp.stages.lift import lift_object
from lis_grasp.stages.regrasp import Attempt, grasp_with_tactile_check
from lis_grasp.stages.touch import disturbance_by, make_prober, touch, true_pose
from lis_grasp.task.task import Task
from lis_grasp.typing import FloatArray
from lis_grasp.world.touching import bodies_touching
from lis_grasp_studies.evaluation.part import Places, SeedsPart
from lis_grasp_studies.evaluation.world_scenes import CLOSED, SCENES, make_scene
from lis_grasp_studies.evaluation.worlds_tables import (
    ALLOWED,
    ALONE,
    DOES_NOT_FIT,
    losses_table,
    published,
    worlds_table,
)
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.tables import Table
from lis_grasp_studies.study.run import DRAKE
from lis_grasp_studies.study.trial import Setup, find_object

_REGION = (0.2, 0.2, 0.2)
_UPRIGHT = 1e-3  # tilt of an object that needs none [rad]
# An object that a touch does not topple comes back from this tilt [rad], to so many sides.
_TILT, _SIDES = float(np.radians(5.0)), 8
_STILL = 0.002  # an object that no touch moved farther was not lost in truth [m]


@dataclass(frozen=True, slots=True)
class WorldTrial:
    """One run of an object in a scene, or alone."""

    object: str
    hand: str
    scene: str
    seed: int
    prober: str = "dynamic"
    touches: int = 20


def measure_world(trial: WorldTrial, policy: str) -> Row:
    """Return what one run with a policy measures."""
    shape = at_rest(find_object(trial.object, Setup()))
    options: dict[str, Any] = {}
    if trial.scene != ALONE:
        options["world"] = make_scene(trial.scene, shape.mesh, seed=trial.seed)
        if bodies_touching(options["world"], shape.mesh):
            return {"held": False, "reason": DOES_NOT_FIT}
    task = Task.of(
        hand=trial.hand,
        region=_REGION,
        prober=trial.prober,
        touches=trial.touches,
        policy=policy,
        attempts=1,
        seed=trial.seed,
        **options,
    )
    hand = Hand.load(trial.hand)
    scenario = pipeline.Scenario.from_config(task, shape, hand, recorded={"X_EO": None})
    try:
        return _run(scenario)
    except LisGraspError as error:
        return {"held": False, "reason": type(error).__name__, "failure": str(error)}


def _run(scenario: pipeline.Scenario) -> Row:
    """Return the measures of a run of a scenario."""
    start = time.process_time()
    prober = make_prober(scenario, ())
    exploration = touch(scenario, prober=prober)
    touched = time.process_time() - start
    row = {"held": False, "cpu_touch": touched, **_exploration_facts(exploration)}
    if not exploration.made:
        return row | {"reason": "no_contact", "cpu": touched}
    disturbance = disturbance_by(prober)
    after = scenario.after(exploration, true_pose(prober), disturbance)
    attempts = list(grasp_with_tactile_check(after, exploration.contacts))
    spent = time.process_time() - start
    last = attempts[-1]
    world = world_facts(attempts).get("world", {"touch": {}, "lift": {}})
    felt, given = world["touch"].get("contacts", {}), exploration.touched_beside
    error = surface_error(last.mesh, last.scenario.truth.shape_now, samples=2000)
    if last.outcome is not None:
        row |= _judged_in_mujoco(last)
    return row | {
        "held": last.outcome is not None and last.outcome.held,
        "reason": "no_grasp" if last.outcome is None else last.outcome.reason,
        "contacts_of_bodies": sum(felt.values()),
        "given_wrongly": sum(abs(felt.get(n, 0) - given[n]) for n in {*felt, *given}),
        "touch_force": max(world["touch"].get("forces", {}).values(), default=0.0),
        "lift_force": max(world["lift"].get("forces", {}).values(), default=0.0),
        "moved_mm": max([*_moved(world["touch"]), *_moved(world["lift"])], default=0.0),
        "pushed": ", ".join(sorted(n for n, f in _forces(world).items() if f > ALLOWED)),
        "rmsd": error.rmsd,
        "cpu": spent,
    }


def _judged_in_mujoco(attempt: Attempt) -> Row:
    """Return how the grasp of an attempt ends in MuJoCo, from where Drake's lift began."""
    scenario = attempt.scenario
    scenario = replace(scenario, task=scenario.task.having(simulator="mujoco"))
    grasp = attempt.search.grasps[attempt.rank]
    outcome = lift_object(scenario, grasp, estimate=attempt.mesh)
    return {
        "held_in_mujoco": outcome.held,
        "reason_in_mujoco": outcome.reason,
        "force_in_mujoco": max(outcome.forces.values(), default=0.0),
    }


def _exploration_facts(exploration: Exploration) -> Row:
    """Return what happened in an exploration; `lost_wrongly` counts the false alarms."""
    moved, lost, lost_wrongly = 0.0, 0, 0
    for observation in exploration.observations:
        moved = max(moved, observation.outcome.moved)
        lost += observation.is_lost
        lost_wrongly += observation.is_lost and moved < _STILL
    outcomes = exploration.outcomes
    return {
        "contacts": exploration.made,
        "felt": sum(len(outcome.contacts) for outcome in outcomes)
        + exploration.touched_beside.total(),
        "probes": len(outcomes),
        "blocked": sum(outcome.status == "blocked" for outcome in outcomes),
        "refused": sum(len(one.refused) for one in exploration.observations),
        "lost": lost,
        "lost_wrongly": lost_wrongly,
        "robot_seconds": exploration.duration,
        "ended": exploration.ended,
    }


def _moved(part: Mapping[str, Any]) -> list[float]:
    return list(part.get("moved", {}).values())


def _forces(world: Mapping[str, Any]) -> dict[str, float]:
    """Return the largest force [N] on each body in touch and lift."""
    forces: dict[str, float] = {}
    for part in (world["touch"], world["lift"]):
        for name, force in part.get("forces", {}).items():
            forces[name] = max(force, forces.get(name, 0.0))
    return forces


def at_rest(shape: Shape) -> Shape:
    """Return an object at rest on the table, its bounding box's middle at x = y = 0.

    Of the resting poses that it stays in, it has that nearest to upright: one that falls over would
    hit others.
    """
    ups = np.array([pose.rotation[2] for pose in resting_poses(shape.mesh, merged=_TILT)])
    ups = ups[np.argsort(-ups[:, 2], kind="stable")]
    up = next((up for up in ups if _stays(shape.mesh, up)), ups[0])
    turn = np.cross(up, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(turn))
    if sine > _UPRIGHT:
        turn *= np.arctan2(sine, up[2]) / sine
        shape = placed(shape, make_pose(Rotation.from_rotvec(turn).as_matrix()))
    low, high = shape.mesh.bounds
    middle = 0.5 * (low + high)
    return placed(shape, make_pose(np.eye(3), np.array([-middle[0], -middle[1], -low[2]])))


def _stays(mesh: trimesh.Trimesh, up: FloatArray) -> bool:
    """Return whether an object at rest, tilted to any side, comes to rest near where it was.

    An egg on its end does not: any touch topples it. One on its side may roll a little.
    """
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    level = np.column_stack([np.cos(angles), np.sin(angles)]) @ tangent_frame(up)
    tilted = -np.cos(_TILT) * up + np.sin(_TILT) * level
    return all(rest_from(mesh, down) @ -up > np.cos(2.0 * _TILT) for down in tilted)


WORLDS = Experiment("worlds", measure_world, asdict, variant="policy", modules=(DRAKE,))
"""The experiment; its variants are policies of exploration."""


class WorldsPart(SeedsPart):
    """Runs beside other bodies and alone."""

    measure: Literal["worlds"]
    objects: list[str]
    hands: list[str]
    scenes: list[str] = Field(default_factory=lambda: list(SCENES))
    prober: Literal["dynamic", "kinematic"] = "dynamic"
    touches: int = 20
    experiment: ClassVar[Experiment] = WORLDS

    def trials(self, seed: int, places: Places) -> Iterator[WorldTrial]:
        """Yield the trials of a seed: those alone, then of each scene with a hand for each object.

        A number of seeds as large as that of hands gives each object and scene every hand.
        """
        for scene in (ALONE, CLOSED):
            for name in self.objects:
                for hand in self.hands:
                    yield WorldTrial(name, hand, scene, seed, self.prober, self.touches)
        for k, scene in enumerate(self.scenes):
            for i, name in enumerate(self.objects):
                hand = self.hands[(seed + k + i) % len(self.hands)]
                yield WorldTrial(name, hand, scene, seed, self.prober, self.touches)

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return what was lost, and the measures by scene."""
        return [losses_table(rows), worlds_table(rows)]

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return the rates and ratios of the plan, in percent or as ratios."""
        return published(rows)
