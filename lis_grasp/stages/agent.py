"""What the robot knows of a run, and how it decides: nothing of the true object."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import trimesh

from lis_grasp.arms.placement import choose_base
from lis_grasp.arms.station import Station, Table
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.exploration import Policy, Region, TactileSensor, Workspace
from lis_grasp.exploration.extent import End, unseen_ends
from lis_grasp.geometry import inverse_pose, make_pose, require_pose
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import default_mass
from lis_grasp.shapes.loading import load_obstacles
from lis_grasp.shapes.object_mass import USUAL_FRICTION, USUAL_MASS, published_mass
from lis_grasp.stages.contact_sources import ContactSource, load_source
from lis_grasp.surfaces import ContactVerdicts, Estimator, judge_contacts
from lis_grasp.task.run_config import RunConfig
from lis_grasp.typing import FloatArray

UNKNOWN_LOAD = LoadPrior(USUAL_FRICTION, USUAL_MASS, friction_spread=0.25, mass_spread=np.log(2))
"""Household objects and fingertips of rubber: 0.06 to 0.7 kg, friction 0.5 to 1.2."""

# Options that say how the robot decides, without a change.
_DECISIONS = (
    *("policy", "cloud", "touches", "grasps", "attempts", "closings", "seed"),
    *("until_success", "until_coverage", "until_uncertainty", "max_seconds"),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Perception:
    """The settings of an estimate from contacts.

    Examples
    --------
    >>> pipeline.Perception(estimator="gpis").free_space
    True
    """

    estimator: str | Estimator = "blend"  #: a name, or called with the contacts alone
    sensor: TactileSensor = field(default_factory=TactileSensor)  #: the estimator knows its noise
    free_space: bool = True  #: whether the contacts' free space is removed from the estimate
    keep_all: bool = False  #: whether contacts that the others contradict are believed
    table: float | None = None  #: height of a table that closes it from below [m]

    @classmethod
    def from_config(cls, config: RunConfig, support: float | None) -> Perception:
        """Return what a configuration says, for an object on a plane at a height `support` [m]."""
        return Perception(
            estimator=config.estimator,
            sensor=config.sensor(),
            free_space=config.free_space,
            keep_all=config.keep_all,
            table=_table(config, support),
        )

    def judge(self, contacts: Contacts) -> ContactVerdicts:
        """Return the verdicts on contacts, given the sensor's noise; with `keep_all`, all sound."""
        return judge_contacts(
            replace(contacts, judged=True) if self.keep_all else contacts,
            position_noise=self.sensor.position_noise or None,
            normal_noise=self.sensor.normal_noise or None,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Known(Perception):
    """The robot's knowledge, and how it decides; nothing of the true object is part of it.

    Poses and heights are in the frame E of the contacts.

    Examples
    --------
    >>> known = pipeline.Scenario.from_config(RunConfig("box", hand="wsg50")).known
    >>> known.hand.name, known.estimator
    ('wsg50', 'blend')
    """

    hand: Hand
    space: Workspace | Region  #: the region that contains the object, or its position and size
    support: float  #: height of the plane under the object [m]
    load: LoadPrior  #: distribution of mass and friction
    mass_by_volume: bool = False  #: whether its mass is replaced by `default_mass` of an estimate
    station: Station | None = None  #: the arm that carries the hand; None for a free hand
    policy: str | Callable[[Workspace], Policy]  #: a name, or makes a policy
    cloud: str | None  #: path of contacts that are known before the first touch
    touches: int  #: to make
    slide: float = 0.0  #: length of slides after touches [m]
    until_success: float | None  #: what ends an exploration earlier, as in `RunConfig`
    until_coverage: float | None
    until_uncertainty: float | None
    max_seconds: float | None
    grasps: int  #: to plan
    obstacles: trimesh.Trimesh | None = None  #: what hand and arm must not hit [m]
    attempts: int  #: grasps to lift at most
    closings: int  #: grasps to test by closing gently before a lift, at most
    seed: int  #: of every random draw

    @classmethod
    def for_hand(
        cls,
        config: RunConfig,
        hand: Hand,
        space: Workspace | Region,
        support: float,
        X_EA: FloatArray | None = None,
    ) -> Known:
        """Return what a configuration and the given facts say.

        `X_EA` (4, 4) is the pose of the arm's base in the frame of the contacts, as recorded; None
        for the configured one.
        """
        is_known = config.load != "unknown"
        mass = config.mass if config.mass is not None else published_mass(config.object)
        load = LoadPrior(config.friction, USUAL_MASS if mass is None else mass)
        obstacles = find_obstacles(config)
        return Known(
            **vars(Perception.from_config(config, support)),
            **{name: getattr(config, name) for name in _DECISIONS},
            slide=config.slide if config.may_slide else 0.0,
            hand=hand,
            space=_for_fingertips(space, hand),
            support=support,
            load=load if is_known else UNKNOWN_LOAD,
            mass_by_volume=is_known and mass is None,
            obstacles=obstacles,
            station=_make_station(config, hand, Table(support, obstacles=obstacles), X_EA),
        )

    @classmethod
    def for_mesh(
        cls,
        config: RunConfig,
        hand: Hand,
        mesh: trimesh.Trimesh,
        support: float,
        X_EA: FloatArray | None = None,
    ) -> Known:
        """Return the same for planning on a mesh [m], which shows the object's place."""
        space = Workspace(1.0, mesh.bounds.mean(axis=0), float(mesh.extents.max()))
        return Known.for_hand(config, hand, space, support, X_EA)

    def unseen_ends(self, contacts: Contacts) -> tuple[End, ...]:
        """Return the ends of an object in a region that no contact shows."""
        space = self.space
        return unseen_ends(space.fitted_to(contacts), contacts) if isinstance(space, Region) else ()

    def in_frame(self, X_EF: FloatArray) -> Known:
        """Return the same in a frame F that has the pose `X_EF` (4, 4) in the frame E so far."""
        if self.station is None:
            return self
        return replace(self, station=self.station.moved(inverse_pose(X_EF) @ self.station.X_WA))

    @cached_property
    def cloud_contacts(self) -> Contacts:
        """Contacts that are known before the first touch; errors are those of `load_source`."""
        if self.cloud is None:
            return Contacts.empty()
        try:
            return load_source(ContactSource(self.cloud))
        except InvalidContactsError as error:  # options of `estimate` would help
            advice = "in lis-grasp estimate: name the contacts.ply that it writes as `cloud`"
            raise InvalidContactsError(f"{error}, {advice}", field=error.field) from None

    def load_prior(self, mesh: trimesh.Trimesh) -> LoadPrior:
        """Return the distribution of mass and friction of an estimated object."""
        return replace(self.load, mass=default_mass(mesh)) if self.mass_by_volume else self.load


def require_record(stage: str, record: object, kind: type) -> None:
    """Raise `TypeError` if a stage is called without its record, as if it were of `lis_grasp`."""
    if not isinstance(record, kind):
        raise TypeError(
            f"pipeline.{stage} takes a {kind.__name__} first; it is of type"
            f" {type(record).__name__}: lis_grasp.{stage} takes objects, hands and contacts"
        )


def _make_station(
    config: RunConfig, hand: Hand, table: Table, X_EA: FloatArray | None
) -> Station | None:
    """Return the configured station at a table; None without an arm."""
    if config.arm is None:
        return None
    arm = Arm.load(config.arm)
    if X_EA is not None:
        return Station.make(arm, hand, require_pose("X_EA", X_EA), table=table)
    if config.base is None:
        return choose_base(arm, hand, table=table)
    return Station.make(arm, hand, base_at(config.base, table.height), table=table)


def find_obstacles(config: RunConfig) -> trimesh.Trimesh | None:
    """Return the configured obstacles, None without any; errors are those of `load_obstacles`."""
    return None if config.obstacles is None else load_obstacles(config.obstacles)


def base_at(place: Sequence[float], height: float) -> FloatArray:
    """Return the pose (4, 4) of an arm's base at x, y and z above a table of a height [m]."""
    return make_pose(np.eye(3), place + np.array([0.0, 0.0, height]))


def station_facts(station: Station | None) -> dict[str, Any]:
    """Return the base in the frame of the contacts and the mount, as plain values."""
    if station is None:
        return {}
    return {"X_EA": station.X_WA.tolist(), "X_FB": station.mount.X_FB.tolist()}


def _for_fingertips(space: Workspace | Region, hand: Hand) -> Workspace | Region:
    """Return prior knowledge with the radius of the hand's thickest probing fingertip."""
    radii = [posture.radius for posture in hand.probe_postures.values()]
    return replace(space, tip_radius=max(radii)) if radii else space


def _table(config: RunConfig, support: float | None) -> float | None:
    """Return the height of the table under the object [m]; None for one that is held in the air.

    Placed and free objects are on a table, and those of an arm: at the height of their `support`
    [m].
    """
    if config.pose is not None:
        return 0.0
    return support if config.free or config.arm is not None else None
