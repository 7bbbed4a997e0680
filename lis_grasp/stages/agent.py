"""The robot as it decides: hand, arm, what it knows, and how; nothing of the true object."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from lis_grasp.arms.station import Station, Table
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Region, Workspace
from lis_grasp.exploration.extent import End, unseen_ends
from lis_grasp.robots.hand import Hand
from lis_grasp.stages.configured_arm import make_station
from lis_grasp.stages.contact_sources import load_cloud
from lis_grasp.stages.estimate import Perception
from lis_grasp.stages.load import KnownLoad
from lis_grasp.stages.surroundings import find_surroundings
from lis_grasp.task.decide import Decide
from lis_grasp.task.known import Known
from lis_grasp.task.robot import Robot
from lis_grasp.task.task import Task
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings


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

    robot: Robot  #: of the task: names, and the sensor
    known: Known  #: of the task
    decide: Decide  #: how it decides
    seed: int  #: of every random draw
    hand: Hand
    station: Station | None = None  #: the arm that carries the hand; None for a free hand
    #: the region that contains the object, or its position and size; None if neither is known
    space: Workspace | Region | None = None
    support_height: float  #: of the plane under the object [m]
    on_table: bool  #: whether that plane is a table; else the object is held in the air
    may_slide: bool = False  #: whether fingertips may slide along the object
    load: KnownLoad  #: mass and friction of the object
    surroundings: Surroundings = ALONE  #: known bodies beside the object

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

        `hand` is None for the task's. `X_EA` (4, 4) is the recorded pose of the arm's base in the
        frame of the contacts; None for the task's.

        Raises `InvalidHandError`, `InvalidArmError` and `InvalidFileError` if a file cannot be
        used.
        """
        robot, known = task.robot, task.known
        hand = Hand.load(robot.hand) if hand is None else hand
        surroundings = find_surroundings(task)
        return Agent(
            robot=robot,
            known=known,
            decide=task.decide,
            seed=task.seed,
            hand=hand,
            station=make_station(
                robot, hand, Table(support_height, surroundings=surroundings), X_EA
            ),
            support_height=support_height,
            on_table=task.on_table,
            may_slide=task.may_slide,
            load=KnownLoad.of(task),
            surroundings=surroundings,
        ).placed(space)

    def placed(self, space: Workspace | Region | None) -> Agent:
        """Return the same, knowing that the object is in a space."""
        radii = [posture.radius for posture in self.hand.probe_postures.values()]
        if space is not None and radii:  # use the thickest fingertip's
            space = replace(space, tip_radius=max(radii))
        return replace(self, space=space)

    @property
    def known_space(self) -> Workspace | Region:
        """The space, which an agent that touches knows."""
        assert self.space is not None
        return self.space

    @cached_property
    def perception(self) -> Perception:
        """The settings of its estimates."""
        height = self.support_height if self.on_table else None
        return Perception.of(self.robot, self.decide, height)

    @cached_property
    def cloud_contacts(self) -> Contacts:
        """Contacts that are known before the first touch; for errors see `load_cloud`."""
        return load_cloud(self.known.cloud)

    def deciding(self, **decisions: Any) -> Agent:
        """Return the same with other values of some fields of `Decide`."""
        return replace(self, decide=replace(self.decide, **decisions))

    def unseen_ends(self, contacts: Contacts) -> tuple[End, ...]:
        """Return the ends, of an object in a region, that no contact shows."""
        space = self.space
        return unseen_ends(space.fitted_to(contacts), contacts) if isinstance(space, Region) else ()

    def in_frame(self, X_EF: FloatArray) -> Agent:
        """Return the same in a frame F, whose pose in the present frame E is `X_EF` (4, 4)."""
        station = None if self.station is None else self.station.in_frame(X_EF)
        return replace(self, station=station, surroundings=self.surroundings.in_frame(X_EF))
