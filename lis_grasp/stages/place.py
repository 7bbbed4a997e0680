"""Place stage: where a held object is to stand, planned on its estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from lis_grasp.arms.carrying import CarryingArm
from lis_grasp.arms.station import Station
from lis_grasp.geometry import apply_pose, inverse_pose, rotate
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.lift_path import LIFT_STEP, LiftPath
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.place_plan import PlacePlan
from lis_grasp.lifting.planned_places import Corner, PlaceSearch, stands_of
from lis_grasp.lifting.setup import ArmLift
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.random_streams import Stream
from lis_grasp.stages.scenario import Scenario
from lis_grasp.typing import FloatArray
from lis_grasp.world import Body, Surroundings

CORNER = (0.05, 0.5)
"""Place of the corner that a task adds, in the frame W of the table [m]: in reach of the arms."""
# Length, thickness and height of its walls [m].
_LENGTH, _THICKNESS, _HEIGHT = 0.2, 0.02, 0.15
_NAMES = ("wall_x", "wall_y")


def plan_place(
    agent: Agent,
    grasp: Grasp,
    estimate: trimesh.Trimesh,
    options: LiftOptions,
    arm: ArmLift | None = None,
) -> PlacePlan | None:
    """Return where an object is to stand that a grasp holds; None if no free place is found.

    Everything is planned on the estimate. On the table it is the nearest free place at least 10 cm
    aside; in a corner the place nearest to both walls that leaves room for the estimate's band and
    for the fingers. The object stands as it was seen standing before; where that leaves no place,
    in another resting pose of the estimate, the surest first. An `arm` that lifts it must be able
    to carry it there.

    Examples
    --------
    >>> agent = pipeline.Scenario.from_config(Task.of("box", hand="wsg50", place="table")).agent
    >>> mesh = shapes.find("box").mesh
    >>> plan = plan_place(agent, pipeline.plan(agent, mesh).best, mesh, LiftOptions())
    >>> plan.motion[:3, 3].round(3).tolist()
    [0.1, 0.0, 0.0]
    """
    carrying = None
    if agent.station is not None and arm is not None:
        carrying = _lifted(agent.station, arm, grasp, options)
        if carrying is None:
            return None
    search = PlaceSearch(
        agent.hand,
        grasp,
        estimate,
        agent.table,
        options.lift_height,
        options.standoff,
        agent.robot.body_error,
        carrying,
    )
    corner = _corner(agent.X_WE, agent.support_height)
    is_corner, rng = agent.decide.place == "corner", Stream.PLACING.rng(agent.seed)
    for stand in stands_of(estimate, agent.support_height, rng=rng):
        plan = search.in_corner(corner, stand) if is_corner else search.on_table(stand)
        if plan is not None:
            return plan
    return None


def with_place(scenario: Scenario) -> Scenario:
    """Return a scenario with the walls of its corner, if an object is to be placed in one."""
    agent, truth = scenario.agent, scenario.truth
    if agent.decide.place != "corner":
        return scenario
    walls = corner_walls(agent.support_height).in_frame(agent.X_WE)
    agent = agent.knowing(Surroundings((*agent.surroundings, *walls)))
    truth = replace(truth, surroundings=Surroundings((*truth.surroundings, *walls)))
    return replace(scenario, agent=agent, truth=truth)


def _lifted(
    station: Station, arm: ArmLift, grasp: Grasp, options: LiftOptions
) -> CarryingArm | None:
    """Return the arm as it holds the object lifted; None if it cannot follow the way there."""
    X_OH = np.asarray(grasp.X_OH)
    rise = LiftPath.straight(options.lift_height).palms(station.hand, X_OH)
    approach = np.repeat(X_OH[None], 1 + round(options.standoff / LIFT_STEP), axis=0)
    away = np.linspace(-options.standoff, 0.0, len(approach))
    approach[:, :3, 3] += away[:, None] * grasp.approach_O
    opened = CarryingArm(station, arm.transit.positions[-1], grasp.joint_positions)
    return opened.after(np.concatenate([approach, rise]))


def corner_walls(height: float) -> Surroundings:
    """Return two fixed walls at right angles on a table at a height [m], in its frame W."""
    x, y = CORNER
    along, center = 0.5 * (_LENGTH - _THICKNESS), height + 0.5 * _HEIGHT
    beyond = 0.5 * _THICKNESS
    return Surroundings(
        (
            Body.box(_NAMES[0], (_THICKNESS, _LENGTH, _HEIGHT), (x + beyond, y - along, center)),
            Body.box(_NAMES[1], (_LENGTH, _THICKNESS, _HEIGHT), (x - along, y + beyond, center)),
        )
    )


def _corner(X_WE: FloatArray, height: float) -> Corner:
    """Return the corner of `corner_walls` in the frame E of the contacts."""
    X_EW = inverse_pose(X_WE)
    vertex = apply_pose(X_EW, np.array([*CORNER, height]))
    return Corner(vertex, rotate(X_EW, np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])), _NAMES)
