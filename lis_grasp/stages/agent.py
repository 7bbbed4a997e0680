"""The robot as it decides: hand, arm, what it knows, and how; nothing of the true object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from lis_grasp.arms.station import Station
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Region, Workspace
from lis_grasp.exploration.extent import End, unseen_ends
from lis_grasp.geometry import require_pose
from lis_grasp.robots.hand import Hand
from lis_grasp.stages.configured_arm import make_station
from lis_grasp.stages.contact_sources import load_cloud
from lis_grasp.stages.estimate import Perception
from lis_grasp.stages.load import KnownLoad
from lis_grasp.stages.surroundings import believed, find_surroundings
from lis_grasp.stages.views_prior import ViewsPrior
from lis_grasp.task.decide import Decide
from lis_grasp.task.known import Known
from lis_grasp.task.robot import Robot
from lis_grasp.task.task import Task
from lis_grasp.typing import FloatArray
from lis_grasp.views import DepthView, Views
from lis_grasp.world import KnownBodies, Surroundings, Table


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
    table: Table  #: the plane under the object, and the known bodies beside it
    on_table: bool  #: whether that plane is a table; else the object is held in the air
    may_slide: bool = False  #: whether fingertips may slide along the object
    load: KnownLoad  #: mass and friction of the object
    views: Views | None = None  #: of the object, before its first touch; None without a camera
    X_WE: FloatArray = field(default_factory=lambda: np.eye(4))  #: (4, 4), in the table's frame W

    @classmethod
    def of(
        cls,
        task: Task,
        support_height: float,
        *,
        hand: Hand | None = None,
        poses: Mapping[str, Any] = MappingProxyType({}),
        surroundings: Surroundings | None = None,
    ) -> Agent:
        """Return the agent of a task whose object is on a plane at a height [m].

        `surroundings` are those in the frame W, if they were read before.
        `hand` is None for the task's. Recorded `poses` (4, 4) are ``X_EA`` of the arm's base, else
        the task's, and ``X_WE`` of the frame of the contacts, else the identity.

        Raises `InvalidHandError`, `InvalidArmError` and `InvalidFileError` if a file cannot be
        used.
        """
        robot, known = task.robot, task.known
        hand = Hand.load(robot.hand) if hand is None else hand
        X_WE = poses.get("X_WE")
        X_WE = np.eye(4) if X_WE is None else require_pose("X_WE", X_WE)
        if surroundings is None:
            surroundings = find_surroundings(task, support_height)
        bodies = believed(surroundings.in_frame(X_WE), robot.body_error, task.seed)
        table = Table(support_height, surroundings=bodies)
        return Agent(
            robot=robot,
            known=known,
            decide=task.decide,
            seed=task.seed,
            hand=hand,
            station=make_station(robot, hand, table, poses.get("X_EA")),
            table=table,
            on_table=task.on_table,
            may_slide=task.may_slide,
            load=KnownLoad.of(task),
            X_WE=X_WE,
        )

    @property
    def support_height(self) -> float:
        """Height of the plane under the object [m]."""
        return self.table.height

    @property
    def surroundings(self) -> Surroundings:
        """The known bodies beside the object."""
        return self.table.surroundings

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

    @property
    def known_bodies(self) -> KnownBodies | None:
        """The known bodies beside the object, as an exploration asks about them; None alone."""
        if not len(self.surroundings):
            return None
        return KnownBodies(
            self.surroundings, error=self.robot.body_error, noise=self.robot.position_noise
        )

    @cached_property
    def perception(self) -> Perception:
        """The settings of its estimates."""
        height = self.support_height if self.on_table else None
        settings = Perception.of(self.robot, self.decide, height, self.known_bodies)
        return settings if self.views is None else replace(settings, prior=ViewsPrior(self.views))

    @property
    def seen_by(self) -> tuple[DepthView, ...]:
        """The views of the object, with the poses as given; none after it was lost."""
        return () if self.views is None else self.views.views

    def measured(self, contacts: Contacts) -> Contacts:
        """Return what was seen of the object, and its contacts."""
        return self.perception.prior.given(contacts).seen.append(contacts)

    @cached_property
    def cloud_contacts(self) -> Contacts:
        """Contacts that are known before the first touch; for errors see `load_cloud`."""
        return load_cloud(self.known.cloud)

    def deciding(self, **decisions: Any) -> Agent:
        """Return the same with other values of some fields of `Decide`."""
        return replace(self, decide=replace(self.decide, **decisions))

    def unseen_ends(self, contacts: Contacts) -> tuple[End, ...]:
        """Return the ends, of an object in a region, that neither contact nor view shows."""
        given, space = self.perception.prior.given(contacts), self.space
        known = given.seen.append(given.guesses).append(contacts)
        return unseen_ends(space.fitted_to(known), known) if isinstance(space, Region) else ()

    def knowing(self, surroundings: Surroundings) -> Agent:
        """Return the same with bodies beside the object at other believed places."""
        return self._at(self.table.with_bodies(surroundings), self.station)

    def in_frame(self, X_EF: FloatArray) -> Agent:
        """Return the same in a frame F, whose pose in the present frame E is `X_EF` (4, 4)."""
        station = None if self.station is None else self.station.in_frame(X_EF)
        moved = self._at(self.table.in_frame(X_EF), station)
        return replace(moved, X_WE=self.X_WE @ X_EF)

    def _at(self, table: Table, station: Station | None) -> Agent:
        station = None if station is None else replace(station, table=table)
        return replace(self, table=table, station=station)
