"""The robot as it decides: hand, arm, what it knows, and how; nothing of the true object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import trimesh

from lis_grasp.arms.placement import choose_base
from lis_grasp.arms.station import Station, Table
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.exploration import Region, Workspace
from lis_grasp.exploration.extent import End, unseen_ends
from lis_grasp.geometry import inverse_pose, make_pose, require_pose
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import default_mass
from lis_grasp.shapes.loading import load_obstacles
from lis_grasp.shapes.object_mass import USUAL_FRICTION, USUAL_MASS, published_mass
from lis_grasp.stages.contact_sources import ContactSource, load_source
from lis_grasp.stages.estimate import Perception
from lis_grasp.task.decide import Decide
from lis_grasp.task.known import Known
from lis_grasp.task.robot import Robot
from lis_grasp.task.task import Task
from lis_grasp.typing import FloatArray

UNKNOWN_LOAD = LoadPrior(USUAL_FRICTION, USUAL_MASS, friction_spread=0.25, mass_spread=np.log(2))
"""Household objects and fingertips of rubber: 0.06 to 0.7 kg, friction 0.5 to 1.2."""


@dataclass(frozen=True, eq=False, kw_only=True)  # no slots: for cached_property
class Agent:
    """The robot, what it knows beforehand, and how it decides.

    Nothing of the true object is part of it. Poses and heights are in the frame E of the contacts.

    Examples
    --------
    >>> agent = pipeline.Scenario.from_config(Task.of("box", hand="wsg50")).agent
    >>> agent.hand.name, agent.decide.estimator
    ('wsg50', 'blend')
    """

    robot: Robot  #: as configured: names, and the sensor
    known: Known  #: as configured
    decide: Decide  #: how it decides
    seed: int  #: of every random draw
    hand: Hand
    station: Station | None = None  #: the arm that carries the hand; None for a free hand
    #: the region that contains the object, or its position and size; None if neither is known
    space: Workspace | Region | None = None
    support_height: float  #: of the plane under the object [m]
    on_table: bool  #: whether that plane is a table; else the object is held in the air
    may_slide: bool = False  #: whether fingertips may slide along the object
    load_prior: LoadPrior  #: distribution of mass and friction
    mass_by_volume: bool = False  #: whether its mass is replaced by `default_mass` of an estimate
    keep_out: trimesh.Trimesh | None = None  #: what hand and arm must not hit [m]

    @classmethod
    def of(
        cls,
        task: Task,
        support_height: float,
        *,
        space: Workspace | Region | None = None,
        hand: Hand | None = None,
        X_EA: FloatArray | None = None,
    ) -> Agent:
        """Return the agent of a task whose object is on a plane at a height [m], in a space.

        `hand` is None for the configured one. `X_EA` (4, 4) is the pose of the arm's base in the
        frame of the contacts, as recorded; None for the configured one.

        Raises `InvalidHandError`, `InvalidArmError` and `InvalidFileError` if a file cannot be
        used.
        """
        world, robot, known = task.world, task.robot, task.known
        hand = Hand.load(robot.hand) if hand is None else hand
        is_known = known.load != "unknown"
        mass = world.mass if world.mass is not None else published_mass(world.object)
        load = LoadPrior(world.friction, USUAL_MASS if mass is None else mass)
        keep_out = find_obstacles(task)
        return Agent(
            robot=robot,
            known=known,
            decide=task.decide,
            seed=task.seed,
            hand=hand,
            station=_make_station(robot, hand, Table(support_height, obstacles=keep_out), X_EA),
            support_height=support_height,
            on_table=task.on_table,
            may_slide=task.may_slide,
            load_prior=load if is_known else UNKNOWN_LOAD,
            mass_by_volume=is_known and mass is None,
            keep_out=keep_out,
        ).placed(space)

    def placed(self, space: Workspace | Region | None) -> Agent:
        """Return the same, knowing that the object is in a space."""
        radii = [posture.radius for posture in self.hand.probe_postures.values()]
        if space is not None and radii:  # of the thickest fingertip
            space = replace(space, tip_radius=max(radii))
        return replace(self, space=space)

    @property
    def known_space(self) -> Workspace | Region:
        """The space, of an agent that is to touch: it knows one."""
        assert self.space is not None
        return self.space

    @cached_property
    def perception(self) -> Perception:
        """The settings of its estimates."""
        height = self.support_height if self.on_table else None
        return Perception.of(self.robot, self.decide, height)

    @cached_property
    def cloud_contacts(self) -> Contacts:
        """Contacts that are known before the first touch; errors are those of `load_source`."""
        if self.known.cloud is None:
            return Contacts.empty()
        try:
            return load_source(ContactSource(self.known.cloud))
        except InvalidContactsError as error:  # options of `estimate` would help
            advice = "in lis-grasp estimate: name the contacts.ply that it writes as `cloud`"
            raise InvalidContactsError(f"{error}, {advice}", field=error.field) from None

    def deciding(self, **decisions: Any) -> Agent:
        """Return the same with other values of some fields of `Decide`."""
        return replace(self, decide=replace(self.decide, **decisions))

    def unseen_ends(self, contacts: Contacts) -> tuple[End, ...]:
        """Return the ends of an object in a region that no contact shows."""
        space = self.space
        return unseen_ends(space.fitted_to(contacts), contacts) if isinstance(space, Region) else ()

    def in_frame(self, X_EF: FloatArray) -> Agent:
        """Return the same in a frame F that has the pose `X_EF` (4, 4) in the frame E so far."""
        if self.station is None:
            return self
        return replace(self, station=self.station.moved(inverse_pose(X_EF) @ self.station.X_WA))

    def load_of(self, mesh: trimesh.Trimesh) -> LoadPrior:
        """Return the distribution of mass and friction of an estimated object."""
        load = self.load_prior
        return replace(load, mass=default_mass(mesh)) if self.mass_by_volume else load


def _make_station(
    robot: Robot, hand: Hand, table: Table, X_EA: FloatArray | None
) -> Station | None:
    """Return the configured station at a table; None without an arm."""
    if robot.arm is None:
        return None
    arm = Arm.load(robot.arm)
    if X_EA is not None:
        return Station.make(arm, hand, require_pose("X_EA", X_EA), table=table)
    if robot.base is None:
        return choose_base(arm, hand, table=table)
    return Station.make(arm, hand, base_at(robot.base, table.height), table=table)


def find_obstacles(task: Task) -> trimesh.Trimesh | None:
    """Return the configured obstacles, None without any; errors are those of `load_obstacles`."""
    path = task.known.obstacles
    return None if path is None else load_obstacles(path)


def base_at(place: Sequence[float], height: float) -> FloatArray:
    """Return the pose (4, 4) of an arm's base at x, y and z above a table of a height [m]."""
    return make_pose(np.eye(3), place + np.array([0.0, 0.0, height]))


def station_facts(station: Station | None) -> dict[str, Any]:
    """Return the base in the frame of the contacts and the mount, as plain values."""
    if station is None:
        return {}
    return {"X_EA": station.X_WA.tolist(), "X_FB": station.mount.X_FB.tolist()}
