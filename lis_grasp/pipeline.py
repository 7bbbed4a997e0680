"""The whole way from touch to a proven grasp: each stage as one call, and all of them in a row."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import STEP_FRACTION, SensingProber, TactileSensor
from lis_grasp.grasping.grasp import Grasp, GraspSearch
from lis_grasp.grasping.hand import Hand
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.meshing import extract_mesh
from lis_grasp.shapes import Shape
from lis_grasp.surfaces import ESTIMATORS, Estimator, ImplicitSurface

if TYPE_CHECKING:
    from lis_grasp.exploration import Exploration, Prober
    from lis_grasp.simulation.lift import LiftOutcome

PROBERS = ("dynamic", "kinematic")
"""What can carry out touches."""

# One independent random stream a stage, so that a stage run alone repeats what it did in a row.
_TOUCH_STREAM, _GRASP_STREAM, _SENSOR_STREAM = 1, 2, 3


@dataclass(frozen=True, slots=True)
class RunConfig:
    """What a run does; the defaults of the command line are these.

    Parameters
    ----------
    object
        Name of a built-in shape, or path of a mesh file.
    size
        Largest extent of a built-in shape [m]; None for a size that the hand can grasp.
    units
        Length unit of a mesh file.
    hand
        Name of a shipped hand, or path of a hand's YAML file.
    estimator
        Name of the surface estimator, a key of `lis_grasp.surfaces.ESTIMATORS`.
    prober
        "dynamic": the hand touches in Drake; "kinematic": by geometry alone, some times faster.
    position_noise, normal_noise
        Of the tactile sensor: one standard deviation of positions along each axis [m], of each
        component of normals [rad]. The estimator is told.
    touches
        Contacts to make before grasping.
    seed
        Seed of every random draw.
    mass
        Mass of the true object in the lift [kg].
    friction
        Coulomb friction between hand and object, in planning and in the lift.
    grasps
        Ranked grasps to plan; the first is executed.
    """

    object: str = "box"
    size: float | None = None
    units: str = "m"
    hand: str = "allegro"
    estimator: str = "blend"
    prober: str = "dynamic"
    position_noise: float = 0.0
    normal_noise: float = 0.0
    touches: int = 40
    seed: int = 0
    mass: float = 0.2
    friction: float = 0.8
    grasps: int = 10

    def __post_init__(self) -> None:
        for name, choices in (("estimator", tuple(ESTIMATORS)), ("prober", PROBERS)):
            if getattr(self, name) not in choices:
                raise InvalidOptionError(
                    f"{name} must be one of {', '.join(choices)}; it is '{getattr(self, name)}'"
                )
        for name in ("touches", "grasps"):
            if getattr(self, name) < 1:
                raise InvalidOptionError(f"{name} must be at least 1; it is {getattr(self, name)}")
        if self.seed < 0:
            raise InvalidOptionError(f"seed must not be negative; it is {self.seed}")
        self.sensor()
        for name in ("mass", "friction"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidOptionError(f"{name} must be a positive number; it is {value}")

    def sensor(self) -> TactileSensor:
        """Return the tactile sensor that the hand touches with."""
        return TactileSensor(position_noise=self.position_noise, normal_noise=self.normal_noise)

    def facts(self) -> dict[str, Any]:
        """Return the configuration as plain values, for file headers and reports."""
        return asdict(self)


@dataclass(slots=True)
class Stopwatch:
    """Wall time of each named stage [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time that the block takes to `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start


def support_height(shape: Shape) -> float:
    """Return the height of the plane that the object stands on, in O [m]: its lowest point."""
    return float(shape.mesh.bounds[0, 2])


def touch(
    shape: Shape,
    hand: Hand,
    *,
    estimator: str,
    touches: int,
    seed: int,
    prober: str = "dynamic",
    sensor: TactileSensor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Exploration:
    """Explore the object by touch: the hand's fingertips, the paper's choice of targets.

    The object is held fixed. What the robot is told of it beforehand is where it is and how large:
    the centre of its bounding box and its largest extent; every contact is felt, through `sensor`
    if there is one.
    """
    from lis_grasp.exploration import FrontierPolicy, explore

    policy = FrontierPolicy(
        step=STEP_FRACTION * shape.size, center=shape.mesh.bounds.mean(axis=0), size=shape.size
    )
    hands_on = _make_prober(prober, hand, shape)
    if sensor is not None:
        rng = np.random.default_rng([seed, _SENSOR_STREAM])
        hands_on = SensingProber(hands_on, sensor, rng)
    return explore(
        hands_on,
        policy,
        _told(estimator, sensor),
        touches=touches,
        rng=np.random.default_rng([seed, _TOUCH_STREAM]),
        progress=progress,
    )


def _make_prober(name: str, hand: Hand, shape: Shape) -> Prober:
    if name == "kinematic":
        from lis_grasp.simulation.kinematic_probing import KinematicProber

        return KinematicProber(hand, shape.mesh)
    from lis_grasp.simulation.probing import DynamicProber

    return DynamicProber(hand, shape.mesh)


def _told(estimator: str, sensor: TactileSensor | None) -> Estimator:
    """Return an estimator that is told the sensor's noise, where there is any."""
    noise = (sensor.position_noise, sensor.normal_noise) if sensor is not None else (0.0, 0.0)
    if not any(noise):
        return ESTIMATORS[estimator]
    return partial(ESTIMATORS[estimator], position_noise=noise[0], normal_noise=noise[1])


def estimate(
    contacts: Contacts, estimator: str, sensor: TactileSensor | None = None
) -> tuple[ImplicitSurface, trimesh.Trimesh]:
    """Estimate the surface from contacts of a sensor, and mesh it."""
    surface = _told(estimator, sensor)(contacts)
    return surface, extract_mesh(surface)


def plan(
    mesh: trimesh.Trimesh,
    hand: Hand,
    *,
    support: float | None,
    friction: float,
    count: int,
    seed: int,
) -> GraspSearch:
    """Plan `count` ranked grasps on a mesh that stands at height `support` of O [m]."""
    sampler = ForceClosureSampler(hand, friction=friction)
    rng = np.random.default_rng([seed, _GRASP_STREAM])
    return sampler.sample(mesh, rng=rng, support_height=support, count=count)


def prove(shape: Shape, hand: Hand, grasp: Grasp, *, mass: float, friction: float) -> LiftOutcome:
    """Execute the grasp on the true, free object in Drake: approach, close, lift, shake, hold."""
    from lis_grasp.simulation.lift import prove_grasp

    return prove_grasp(
        shape.mesh,
        hand,
        grasp,
        support_height=support_height(shape),
        mass=mass,
        friction=friction,
    )
