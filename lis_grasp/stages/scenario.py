"""Scenario of a run: what is true of the object, and what the robot knows of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import DEFAULT_REGION, STEP_FRACTION, Exploration, Region, Workspace
from lis_grasp.exploration.disturbance import Disturbance
from lis_grasp.geometry import require_pose
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.records import reduce_record
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import NAMES, Shape, default_mass, draw_pose, find, placed
from lis_grasp.shapes.object_mass import note_density
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.configured_arm import station_facts
from lis_grasp.stages.looking import views_of
from lis_grasp.stages.random_streams import Stream
from lis_grasp.stages.surroundings import believed, find_surroundings, require_apart
from lis_grasp.task.task import Task
from lis_grasp.task.world import World
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

# Width of the table around a region in which sweeps of a hand without an arm begin [m].
_AROUND = 0.12


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Truth:
    """The true object: what simulation and evaluation use, and the robot never.

    Examples
    --------
    >>> pipeline.Scenario.from_config(Task.of("box")).truth.mass
    0.2
    """

    shape: Shape  #: where it is before the first touch, in the frame W of the table
    mass: float  #: [kg]
    friction: float  #: Coulomb's coefficient on hand and table
    X_WO: FloatArray  #: (4, 4), the pose of `shape`; the identity for its mesh's own
    #: (4, 4), motion of `shape` by touches and grasps, in the frame E of the contacts
    X_EO: FloatArray
    surroundings: Surroundings = ALONE  #: the bodies beside it, in E
    disturbance: Disturbance = field(default_factory=Disturbance)  #: of these, by all touches
    #: how far touches moved any point of each free body beside it [m], at most
    pushed: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return reduce_record(self)

    @cached_property
    def shape_now(self) -> Shape:
        """The object where it is now, in the frame of the contacts."""
        has_moved = not np.array_equal(self.X_EO, np.eye(4))
        return placed(self.shape, self.X_EO) if has_moved else self.shape


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """Everything that a run derives from its task: the true object, and the agent that decides.

    Examples
    --------
    >>> scenario = pipeline.Scenario.from_config(Task.of("box", hand="wsg50"))
    >>> scenario.truth.shape.name
    'box'
    """

    task: Task
    truth: Truth
    agent: Agent

    @classmethod
    def from_config(
        cls,
        task: Task,
        shape: Shape | None = None,
        hand: Hand | None = None,
        *,
        recorded: Mapping[str, Any] | None = None,
    ) -> Scenario:
        """Return the scenario of a task.

        Parameters
        ----------
        task
            The task.
        shape
            The true object in its own frame O; None for the task's.
        hand
            The hand; None for the task's.
        recorded
            Facts of a results file: its poses ``X_WO``, ``X_EO``, ``X_EA`` and ``X_WE`` of object,
            moved object, arm and frame replace the poses given by the task and its seed.

        Raises
        ------
        InvalidOptionError
            If the object does not fit into its region, or touches another body, or `units` or `up`
            are given for a built-in shape.
        InvalidMeshError, InvalidHandError, InvalidArmError, InvalidFileError
            If a file cannot be used.
        """
        world = task.world
        shape = find_object(world) if shape is None else shape
        poses = {} if recorded is None else recorded
        if recorded is None:
            shape, X_WO = place_object(shape, task)
        else:
            X_WO = _pose("X_WO", poses.get("X_WO"))
            shape = shape if poses.get("X_WO") is None else placed(shape, X_WO)
        support_height = 0.0 if world.pose is not None else lowest_point(shape)
        surroundings = find_surroundings(task, support_height)
        agent = Agent.of(
            task,
            support_height,
            hand=hand,
            poses=poses,
            surroundings=surroundings,
        ).placed(_prior_space(shape, task))
        if recorded is None:
            agent = replace(agent, views=views_of(task, shape, support_height))
        surroundings = surroundings.in_frame(agent.X_WE)
        if recorded is None:
            require_apart(surroundings, shape)
        mass = default_mass(shape.mesh, world.object) if world.mass is None else world.mass
        note_density(mass, shape.mesh)
        X_EO = _pose("X_EO", poses.get("X_EO"))
        return cls(task, Truth(shape, mass, world.friction, X_WO, X_EO, surroundings), agent)

    def after(
        self,
        exploration: Exploration,
        X_EO: FloatArray | None,
        disturbance: Disturbance | None = None,
    ) -> Scenario:
        """Return the scenario after an exploration, in the frame of its contacts.

        The frame, and the station in it, moved with the believed object. Touches moved the object
        to the true pose `X_EO` (4, 4); None if it is fixed. `disturbance` is what they did to the
        bodies beside it; None for nothing. The robot believes these where it touched them.
        """
        belief, known = exploration.belief, self.agent.known_bodies
        after = self if disturbance is None else self._disturbed(disturbance)
        touches = [touch for o in exploration.observations for touch in o.beside]
        if known is not None and touches:
            corrected = known.corrected(touches).surroundings
            after = replace(after, agent=after.agent.knowing(corrected))
        if sum(o.is_lost - o.is_joined for o in exploration.observations) > 0:
            after = replace(after, agent=replace(after.agent, views=None))  # of another map
        after = after if belief is None else after.in_frame(belief.X_WE)
        return after if X_EO is None else after.moved(X_EO)

    def _disturbed(self, disturbance: Disturbance) -> Scenario:
        """Return the scenario with the bodies beside the object as touches left them, in E."""
        truth, pushed = self.truth, dict(self.truth.pushed)
        surroundings = truth.surroundings.placed(disturbance.poses)
        for before, now in zip(truth.surroundings, surroundings, strict=True):
            if not now.is_fixed:
                pushed[now.name] = pushed.get(now.name, 0.0) + now.displacement(before.X_EB)
        truth = replace(
            truth,
            surroundings=surroundings,
            disturbance=truth.disturbance.after(disturbance),
            pushed=MappingProxyType(pushed),
        )
        return replace(self, truth=truth)

    def in_frame(self, X_EF: FloatArray) -> Scenario:
        """Return the scenario in a frame F of pose `X_EF` (4, 4); the pose of the object stays."""
        surroundings = self.truth.surroundings.in_frame(X_EF)
        truth = replace(self.truth, surroundings=surroundings)
        return replace(self, agent=self.agent.in_frame(X_EF), truth=truth)

    def moved(self, X_EO: FloatArray) -> Scenario:
        """Return the scenario with the object at another pose (4, 4) in the frame E."""
        return replace(self, truth=replace(self.truth, X_EO=X_EO))

    def after_lift(self, outcome: LiftOutcome) -> Scenario:
        """Return the scenario after a lift, which moved the object and bodies beside it.

        The robot looks again where the bodies are.
        """
        surroundings = self.truth.surroundings.placed(outcome.X_EB)
        truth = replace(self.truth, X_EO=outcome.X_WO, surroundings=surroundings)
        after = replace(self, truth=truth)
        return looked_at(after) if outcome.X_EB else after

    def warnings(self, contacts: Contacts) -> dict[str, list[str]]:
        """Return a warning, as a fact, if ends of the object were not found.

        Grasps are still planned, as if the object ended with the estimate.
        """
        ends = self.agent.unseen_ends(contacts) if len(contacts) else ()
        return {"warnings": [f"not found: {', '.join(map(str, ends))}"]} if ends else {}

    def facts(self) -> dict[str, Any]:
        """Return the support and the poses of object, arm and frame, as values for file headers."""
        moved = not np.array_equal(self.truth.X_EO, np.eye(4))
        return {
            "support_height": self.agent.support_height,
            "X_WO": None if self.task.world.pose is None else self.truth.X_WO.tolist(),
            **({"X_EO": self.truth.X_EO.tolist()} if moved else {}),
            **({"X_WE": self.agent.X_WE.tolist()} if len(self.agent.surroundings) else {}),
            **({"seen": len(self.agent.seen_by)} if self.task.sees else {}),
            **station_facts(self.agent.station),
        }


def looked_at(scenario: Scenario) -> Scenario:
    """Return a scenario whose agent believes the bodies where they are now, up to its error.

    The error of a body's place is the same as at the start.
    """
    agent, bodies = scenario.agent, scenario.truth.surroundings
    seen = believed(bodies, agent.robot.body_error, agent.seed)
    return replace(scenario, agent=agent.knowing(seen))


def find_object(world: World) -> Shape:
    """Return the object of a world in its own frame O.

    Raises `InvalidOptionError` if there is none of that name, or `units` or `up` are given for a
    built-in shape, and `InvalidFileError`, `InvalidMeshError` if its file cannot be used.
    """
    for name, value, usual in (("units", world.units, "m"), ("up", world.up, "z")):
        if value not in (None, usual) and world.object in NAMES:
            raise InvalidOptionError(
                f"`{name}` is for mesh files; it is {value} for the built-in {world.object}: leave"
                " it out (the largest extent is `size`)",
                option=name,
                value=value,
            )
    return find(world.object, size=world.size, units=world.units, up=world.up)


def place_object(shape: Shape, task: Task) -> tuple[Shape, FloatArray]:
    """Return an object at its pose in a task, and this pose X_WO (4, 4) on the table z = 0.

    Without a pose, it stays in its own frame. Raises `InvalidOptionError` if it does not fit into
    its region.
    """
    pose = task.world.pose
    if pose is None:
        return shape, np.eye(4)
    rng = Stream.PLACE.rng(task.seed)
    X_WO = draw_pose(shape, pose, task.known.region or DEFAULT_REGION, rng=rng)
    return placed(shape, X_WO), X_WO


def lowest_point(shape: Shape) -> float:
    """Return the height of the lowest point of an object in its frame [m]."""
    return float(shape.mesh.bounds[0, 2])


def known_place(shape: Shape, *, on_table: bool = False) -> Workspace:
    """Return an object's known place: the centre of its bounding box and its largest extent."""
    center = shape.mesh.bounds.mean(axis=0)
    height = lowest_point(shape) if on_table else None
    return Workspace(STEP_FRACTION * shape.size, center, shape.size, height)


def _prior_space(shape: Shape, task: Task) -> Workspace | Region:
    """Return what is known before the first touch: the region, or else the place of the object.

    With a region, nothing of the true object is used. The simulated table is free around it, and a
    hand without an arm begins its sweeps there.
    """
    if task.known.region is None:
        return known_place(shape, on_table=task.on_table)
    return Region(task.known.region, around=_AROUND if task.robot.arm is None else 0.0)


def _pose(name: str, X: Any) -> FloatArray:
    """Return a pose (4, 4), checked if it is recorded; the identity for None."""
    return np.eye(4) if X is None else require_pose(name, X)
