"""The whole way from touch to a proven grasp: each stage as one call, and all of them in a row."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import (
    POLICIES,
    STEP_FRACTION,
    Exploration,
    ProbeOutcome,
    Prober,
    TactileSensor,
    TargetPolicy,
    TouchLog,
    Workspace,
    explore,
)
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.hands.hand import Hand
from lis_grasp.meshing import extract_mesh
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.worker_pool import worker_pool
from lis_grasp.shapes import Shape
from lis_grasp.surfaces import ESTIMATORS, Estimator, ImplicitSurface, carved
from lis_grasp.typing import FloatArray

if TYPE_CHECKING:
    from lis_grasp.simulation.simulate_lift import AcceptGrasp, LiftOptions, LiftOutcome


# One independent random stream a stage, so that a stage run alone repeats what it did in a row.
_TOUCH_STREAM, _GRASP_STREAM = 1, 2


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
    config: RunConfig,
    *,
    log: TouchLog | None = None,
    recorded: Sequence[ProbeOutcome] = (),
    progress: Callable[[int, int], None] | None = None,
    observe: Callable[[int, ImplicitSurface], None] | None = None,
) -> Exploration:
    """Explore the object by touch, as the configuration says; go on from an interrupted log.

    Without a log, `recorded` are the outcomes to go on from: those of the same exploration for
    fewer touches.

    The object is held, or stands free on a table. What the robot is told of it beforehand is where
    it is and how large: the centre of its bounding box and its largest extent; every contact is
    felt. `progress` and `observe` are called as by `explore`.
    """
    space = Workspace(
        STEP_FRACTION * shape.size,
        shape.mesh.bounds.mean(axis=0),
        shape.size,
        support_height(shape) if config.free else None,
    )
    recorded = log.resume() if log is not None else recorded
    exploration = explore(
        _make_prober(config, hand, shape),
        make_policy(config, space),
        _told(config.estimator, config.sensor()),
        touches=config.touches,
        rng=np.random.default_rng([config.seed, _TOUCH_STREAM]),
        space=space,
        sensor=config.sensor(),
        stop=config.stop_rules(space),
        recorded=recorded,
        record=log.append if log is not None else None,
        progress=progress,
        observe=observe,
    )
    if log is not None:
        log.end(exploration.ended)
    return exploration


def make_policy(config: RunConfig, space: Workspace) -> TargetPolicy:
    """Return the policy that a configuration names, for one workspace."""
    kind = POLICIES[config.policy]
    guess = _told("gpis", config.sensor()) if kind.guesses else None
    return TargetPolicy(space, kind.choose, guess)


def _make_prober(config: RunConfig, hand: Hand, shape: Shape) -> Prober:
    if config.prober == "kinematic":
        from lis_grasp.probing.kinematic_prober import KinematicProber

        return KinematicProber(
            hand, shape.mesh, fingers="all" if config.fingers == "all" else "one"
        )
    from lis_grasp.simulation.dynamic_prober import DynamicProber
    from lis_grasp.simulation.probing_scene import FreeObject

    free = FreeObject(support_height(shape), config.mass, config.friction) if config.free else None
    return DynamicProber(hand, shape.mesh, free=free)


def _told(estimator: str, sensor: TactileSensor | None) -> Estimator:
    """Return an estimator that is told the sensor's noise, where there is any."""
    noise = (sensor.position_noise, sensor.normal_noise) if sensor is not None else (0.0, 0.0)
    if not any(noise):
        return ESTIMATORS[estimator]
    return partial(ESTIMATORS[estimator], position_noise=noise[0], normal_noise=noise[1])


def estimate(
    contacts: Contacts,
    estimator: str,
    sensor: TactileSensor | None = None,
    *,
    free_space: bool = True,
) -> tuple[ImplicitSurface, trimesh.Trimesh]:
    """Estimate the surface from contacts of a sensor, and mesh it.

    With `free_space`, what the contacts know to be free is carved off.
    """
    surface = _told(estimator, sensor)(contacts)
    if free_space:
        margin = 0.0 if sensor is None else sensor.free_margin
        surface = carved(surface, contacts, margin=margin)
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


def lift(
    shape: Shape,
    hand: Hand,
    grasp: Grasp,
    *,
    mass: float,
    friction: float,
    accept_grasp: AcceptGrasp | None = None,
    X_WO: FloatArray | None = None,
    options: LiftOptions | None = None,
) -> LiftOutcome:
    """Simulate the lift of the true object in Drake; arguments as of `simulate_lift`."""
    from lis_grasp.simulation.simulate_lift import simulate_lift

    return simulate_lift(
        shape.mesh,
        hand,
        grasp,
        support_height=support_height(shape),
        mass=mass,
        friction=friction,
        accept_grasp=accept_grasp,
        X_WO=X_WO,
        options=options,
    )


def lift_each(
    shape: Shape,
    hand: Hand,
    grasps: Sequence[Grasp],
    *,
    mass: float,
    friction: float,
    jobs: int,
    options: LiftOptions | None = None,
) -> Iterator[LiftOutcome]:
    """Simulate the lift of each grasp on an untouched object, in `jobs` processes.

    Outcomes come in the order of the grasps, and are the same for any number of processes.
    """
    run = partial(lift, shape, hand, mass=mass, friction=friction, options=options)
    if jobs == 1 or len(grasps) < 2:
        yield from map(run, grasps)
        return
    with worker_pool(min(jobs, len(grasps))) as pool:
        yield from pool.map(run, grasps)
