"""Scenario of a run: what is true of the object, and what the robot knows of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import trimesh

from lis_grasp.arms.placement import choose_base
from lis_grasp.arms.station import Station, Table
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import (
    DEFAULT_REGION,
    STEP_FRACTION,
    Exploration,
    Policy,
    Region,
    TactileSensor,
    Workspace,
)
from lis_grasp.geometry import inverse_pose, make_pose, require_pose
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.pipeline.run_config import RunConfig, StopLimits
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import NAMES, Shape, default_mass, draw_pose, find, placed
from lis_grasp.shapes.loading import load_obstacles
from lis_grasp.shapes.object_mass import USUAL_MASS, published_mass
from lis_grasp.surfaces import Estimator
from lis_grasp.typing import FloatArray

_PLACE_STREAM = 3  # of random numbers, apart from those of the stages
_DEFAULTS = RunConfig()

UNKNOWN_LOAD = LoadPrior(friction=0.8, mass=0.2, friction_spread=0.25, mass_spread=float(np.log(2)))
"""Household objects and fingertips of rubber: 0.06 to 0.7 kg, friction 0.5 to 1.2."""


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Truth:
    """The true object: what simulation and evaluation use, and the robot never.

    Examples
    --------
    >>> pipeline.Scenario.from_config(RunConfig("box")).truth.mass
    0.2
    """

    shape: Shape  #: where it is before the first touch, in the frame W of the table
    mass: float  #: [kg]
    friction: float  #: Coulomb's coefficient on hand and table
    X_WO: FloatArray  #: (4, 4), the pose at which `shape` was put; the identity for its mesh's
    #: (4, 4), motion of `shape` by touches and grasps, in the frame E of the contacts
    X_EO: FloatArray

    @cached_property
    def shape_now(self) -> Shape:
        """The object where it is now, in the frame of the contacts."""
        has_moved = not np.array_equal(self.X_EO, np.eye(4))
        return placed(self.shape, self.X_EO) if has_moved else self.shape


@dataclass(frozen=True, eq=False, kw_only=True)
class Perception:
    """What an estimate from contacts depends on, beside them.

    Examples
    --------
    >>> pipeline.Perception(estimator="gpis").free_space
    True
    """

    estimator: str | Estimator = _DEFAULTS.estimator  #: a name, or called with the contacts alone
    sensor: TactileSensor = field(default_factory=TactileSensor)  #: the estimator knows its noise
    free_space: bool = True  #: whether the contacts' free space is removed from the estimate
    table: float | None = None  #: height of a table that closes it from below [m]

    @classmethod
    def from_config(cls, config: RunConfig, support: float | None) -> Perception:
        """Return what a configuration says, for an object on a plane at a height `support` [m]."""
        return Perception(
            estimator=config.estimator,
            sensor=config.sensor(),
            free_space=config.free_space,
            table=_table(config, support),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Known(Perception):
    """What the robot knows, and how it decides; nothing of the true object is part of it.

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
    load: LoadPrior = field(default_factory=LoadPrior)  #: distribution of mass and friction
    mass_by_volume: bool = False  #: whether its mass is replaced by `default_mass` of an estimate
    station: Station | None = None  #: the arm that carries the hand; None for a free hand
    policy: str | Callable[[Workspace], Policy] = _DEFAULTS.policy  #: a name, or makes a policy
    cloud: str | None = None  #: path of contacts that are known before the first touch
    touches: int = _DEFAULTS.touches  #: contacts to make
    stop: StopLimits = field(default_factory=StopLimits)  #: what ends an exploration earlier
    grasps: int = _DEFAULTS.grasps  #: to plan
    obstacles: trimesh.Trimesh | None = None  #: what hand and arm must not hit [m]
    attempts: int = _DEFAULTS.attempts  #: grasps to try at most
    seed: int = _DEFAULTS.seed  #: of every random draw

    @classmethod
    def for_hand(
        cls, config: RunConfig, hand: Hand, space: Workspace | Region, support: float
    ) -> Known:
        """Return what a configuration and the given facts say, for a hand without an arm."""
        perception = Perception.from_config(config, support)
        mass = config.mass if config.mass is not None else published_mass(config.object)
        return Known(
            **vars(perception),
            hand=hand,
            space=_for_fingertips(space, hand),
            support=support,
            load=UNKNOWN_LOAD
            if config.load == "unknown"
            else LoadPrior(config.friction, USUAL_MASS if mass is None else mass),
            mass_by_volume=config.load != "unknown" and mass is None,
            policy=config.policy,
            cloud=config.cloud,
            touches=config.touches,
            stop=config.stop_limits(),
            grasps=config.grasps,
            obstacles=find_obstacles(config),
            attempts=config.attempts,
            seed=config.seed,
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
        """Return what a configuration says for planning on a mesh [m], whose place it shows.

        `X_EA` is that of `make_station`.
        """
        space = Workspace(1.0, mesh.bounds.mean(axis=0), float(mesh.extents.max()))
        station = make_station(config, hand, support, X_EA)
        return replace(Known.for_hand(config, hand, space, support), station=station)

    def load_prior(self, mesh: trimesh.Trimesh) -> LoadPrior:
        """Return the distribution of mass and friction of an estimated object."""
        return replace(self.load, mass=default_mass(mesh)) if self.mass_by_volume else self.load


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """Everything that a run derives from its configuration: the true object and what is known.

    Examples
    --------
    >>> scenario = pipeline.Scenario.from_config(RunConfig("box", hand="wsg50"))
    >>> scenario.truth.shape.name
    'box'
    """

    config: RunConfig
    truth: Truth
    known: Known

    @classmethod
    def from_config(
        cls,
        config: RunConfig,
        shape: Shape | None = None,
        hand: Hand | None = None,
        *,
        recorded: Mapping[str, Any] | None = None,
    ) -> Scenario:
        """Return the scenario of a configuration.

        Parameters
        ----------
        config
            The configuration.
        shape
            The true object in its own frame O; None for the configured one.
        hand
            The hand; None for the configured one.
        recorded
            Facts of a results file: its poses ``X_WO``, ``X_EO`` and ``X_EA`` of object, moved
            object and arm replace those that the configuration and its seed give.

        Raises
        ------
        InvalidOptionError
            If the object does not fit into its region, or `units` are given for a built-in shape.
        InvalidMeshError, InvalidHandError, InvalidArmError, InvalidFileError
            If a file cannot be used.
        """
        shape = find_object(config) if shape is None else shape
        poses = {} if recorded is None else recorded
        if recorded is None:
            shape, X_WO = place_object(shape, config)
        else:
            X_WO = _pose("X_WO", poses.get("X_WO"))
            shape = shape if poses.get("X_WO") is None else placed(shape, X_WO)
        hand = Hand.load(config.hand) if hand is None else hand
        support = 0.0 if config.pose is not None else support_height(shape)
        known = Known.for_hand(config, hand, _prior_knowledge(shape, config), support)
        station = make_station(config, hand, support, poses.get("X_EA"))
        mass = default_mass(shape.mesh, config.object) if config.mass is None else config.mass
        truth = Truth(shape, mass, config.friction, X_WO, _pose("X_EO", poses.get("X_EO")))
        return cls(config, truth, replace(known, station=station))

    def after(self, exploration: Exploration) -> Scenario:
        """Return the scenario after an exploration, in the frame of its contacts.

        The frame moved with the believed object, and with it the station; touches moved the object.
        """
        known, truth = self.known, self.truth
        beliefs = [o.tracked for o in exploration.outcomes if o.tracked is not None]
        if beliefs and known.station is not None:
            known = replace(known, station=_in_frame(known.station, beliefs[-1].X_WE))
        X_EO = exploration.simulated_pose
        return replace(
            self, known=known, truth=truth if X_EO is None else replace(truth, X_EO=X_EO)
        )

    def moved(self, X_EF: FloatArray, X_EO: FloatArray) -> Scenario:
        """Return the scenario in a frame F, with the object at another pose.

        F has the pose `X_EF` (4, 4) in the present frame E, in which the object is at `X_EO`
        (4, 4).
        """
        station = self.known.station
        return replace(
            self,
            known=replace(
                self.known, station=None if station is None else _in_frame(station, X_EF)
            ),
            truth=replace(self.truth, X_EO=inverse_pose(X_EF) @ X_EO),
        )

    def facts(self) -> dict[str, Any]:
        """Return the support and the poses of object and arm, as plain values for file headers."""
        moved = not np.array_equal(self.truth.X_EO, np.eye(4))
        return {
            "support_height": self.known.support,
            "X_WO": None if self.config.pose is None else self.truth.X_WO.tolist(),
            **({"X_EO": self.truth.X_EO.tolist()} if moved else {}),
            **station_facts(self.known.station),
        }


def require_record(stage: str, record: object, kind: type) -> None:
    """Raise `TypeError` if a stage is called without its record, as if it were of `lis_grasp`."""
    if not isinstance(record, kind):
        raise TypeError(
            f"pipeline.{stage} takes a {kind.__name__} first; it is of type"
            f" {type(record).__name__}: lis_grasp.{stage} takes objects, hands and contacts"
        )


def find_object(config: RunConfig) -> Shape:
    """Return the configured object in its own frame O.

    Raises
    ------
    InvalidOptionError
        If there is none of that name, or `units` are given for a built-in shape.
    InvalidFileError, InvalidMeshError
        If its file cannot be used.
    """
    if config.units != "m" and config.object in NAMES:
        raise InvalidOptionError(
            f"--units is for mesh files; it is {config.units} for the built-in {config.object}:"
            " leave it out, or give the largest extent in metres by --size",
            option="units",
            value=config.units,
        )
    return find(config.object, size=config.size, units=config.units)


def find_obstacles(config: RunConfig) -> trimesh.Trimesh | None:
    """Return the configured obstacles, None without any; errors are those of `load_obstacles`."""
    return None if config.obstacles is None else load_obstacles(config.obstacles)


def place_object(shape: Shape, config: RunConfig) -> tuple[Shape, FloatArray]:
    """Return an object at its configured pose, and this pose X_WO (4, 4) on the table z = 0.

    Without a pose, it stays in its own frame. Raises `InvalidOptionError` if it does not fit into
    its region.

    Examples
    --------
    >>> box, X_WO = pipeline.place_object(shapes.find("box"), RunConfig(pose="upright"))
    >>> float(box.mesh.bounds[0, 2]) + 0.0
    0.0
    """
    if config.pose is None:
        return shape, np.eye(4)
    rng = np.random.default_rng([config.seed, _PLACE_STREAM])
    X_WO = draw_pose(shape, config.pose, config.region or DEFAULT_REGION, rng=rng)
    return placed(shape, X_WO), X_WO


def support_height(shape: Shape) -> float:
    """Return the height of the plane under an object in its frame [m]: its lowest point.

    Examples
    --------
    >>> pipeline.support_height(shapes.sphere(0.06)) < 0.0
    True
    """
    return float(shape.mesh.bounds[0, 2])


def workspace(shape: Shape, *, on_table: bool = False) -> Workspace:
    """Return the prior knowledge of an object: centre of its bounding box and largest extent.

    Examples
    --------
    >>> round(pipeline.workspace(shapes.find("box")).size, 3) > 0.0
    True
    """
    center = shape.mesh.bounds.mean(axis=0)
    table = support_height(shape) if on_table else None
    return Workspace(STEP_FRACTION * shape.size, center, shape.size, table)


def make_station(
    config: RunConfig, hand: Hand, height: float, X_EA: FloatArray | None = None
) -> Station | None:
    """Return the configured station on a table of a height [m]; None without an arm.

    `X_EA` (4, 4) is the pose of the arm's base in the frame of the contacts, as recorded; None for
    the configured one.

    Examples
    --------
    >>> hand = Hand.load("wsg50")
    >>> pipeline.make_station(RunConfig(), hand, 0.0) is None  # no arm
    True
    """
    if config.arm is None:
        return None
    arm, table = Arm.load(config.arm), Table(height, obstacles=find_obstacles(config))
    if X_EA is not None:
        return Station.make(arm, hand, require_pose("X_EA", X_EA), table=table)
    if config.base is None:
        return choose_base(arm, hand, table=table)
    return Station.make(arm, hand, base_at(config.base, height), table=table)


def base_at(place: Sequence[float], height: float) -> FloatArray:
    """Return the pose (4, 4) of an arm's base at x, y and z above a table of a height [m]."""
    return make_pose(np.eye(3), place + np.array([0.0, 0.0, height]))


def station_facts(station: Station | None) -> dict[str, Any]:
    """Return the base in the frame of the contacts and the mount, as plain values."""
    if station is None:
        return {}
    return {"X_EA": station.X_WA.tolist(), "X_FB": station.mount.X_FB.tolist()}


def _prior_knowledge(shape: Shape, config: RunConfig) -> Workspace | Region:
    """Return what is known before the first touch: the configured region, or else `workspace`.

    With a region, nothing of the true object is used.
    """
    if config.region is not None:
        return Region(config.region)
    on_table = config.free or config.pose is not None or config.arm is not None
    return workspace(shape, on_table=on_table)


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


def _pose(name: str, X: Any) -> FloatArray:
    """Return a pose (4, 4), checked if it is recorded; the identity for None."""
    return np.eye(4) if X is None else require_pose(name, X)


def _in_frame(station: Station, X_EF: FloatArray) -> Station:
    return station.moved(inverse_pose(X_EF) @ station.X_WA)
