"""Stages of the pipeline, one function each: touch, estimate, plan and lift."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.exploration import (
    DEFAULT_REGION,
    STEP_FRACTION,
    Exploration,
    Policy,
    PoseTracker,
    ProbeOutcome,
    Prober,
    Region,
    RegionPolicy,
    StopRule,
    TactileSensor,
    TargetPolicy,
    TouchLog,
    Workspace,
    explore,
    stop_when_graspable,
)
from lis_grasp.exploration.policy import PolicyKind
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.grasping.load_prior import LoadPrior
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.hands.hand import Hand
from lis_grasp.lifting.arm_lift import plan_arm_lift
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.lifting.lift_outcome import LiftOptions, LiftOutcome
from lis_grasp.meshing import extract_mesh
from lis_grasp.pipeline.contact_sources import load_source, prior_contacts
from lis_grasp.pipeline.plugged_in import POLICY_NAMES, find_estimator, find_policy
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.worker_pool import worker_pool
from lis_grasp.shapes import Shape, draw_pose
from lis_grasp.surfaces import Estimator, ImplicitSurface, carved
from lis_grasp.surfaces.above_table_implicit_surface import above_table
from lis_grasp.typing import FloatArray

if TYPE_CHECKING:
    from lis_grasp.simulation.simulate_lift import AcceptGrasp


_FEW_SETS = 400  # contact sets sampled to predict a success during an exploration
# Each stage has its own random stream, so that a stage run alone repeats its part of a whole run.
_TOUCH_STREAM, _GRASP_STREAM, _PLACE_STREAM = 1, 2, 3


@dataclass(slots=True)
class Stopwatch:
    """Wall time of each named stage [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time of a block to `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start


def pose_of(shape: Shape, config: RunConfig) -> FloatArray | None:
    """Return the configured pose X_WO (4, 4) of the true object, in W; None if O stays its frame.

    `lis_grasp.shapes.placed` moves the object there. Its frame is then W, with the table at z = 0.
    """
    if config.pose is None:
        return None
    rng = np.random.default_rng([config.seed, _PLACE_STREAM])
    return draw_pose(shape, config.pose, config.region or DEFAULT_REGION, rng=rng)


def support_height(shape: Shape, config: RunConfig | None = None) -> float:
    """Return the height of the plane under the object [m]: the table, or its lowest point in O."""
    if config is not None and config.pose is not None:
        return 0.0
    return float(shape.mesh.bounds[0, 2])


def object_mass(shape: Shape, config: RunConfig) -> float:
    """Return the mass of the true object [kg]: configured, or `default_mass`."""
    return config.mass_of(shape.mesh)


def table_of(config: RunConfig) -> float | None:
    """Return the height of the table under a placed object [m]; None if its mesh stands in O."""
    return None if config.pose is None else 0.0


def workspace(shape: Shape, *, free: bool = False) -> Workspace:
    """Return the prior knowledge of an object: centre of its bounding box and largest extent.

    An object that is `free` rests on a table.
    """
    center = shape.mesh.bounds.mean(axis=0)
    table = support_height(shape) if free else None
    return Workspace(STEP_FRACTION * shape.size, center, shape.size, table)


def prior_knowledge(shape: Shape, config: RunConfig) -> Workspace | Region:
    """Return what is known before the first touch: the configured region, or else `workspace`.

    With a region, nothing of the true object is used.
    """
    if config.region is not None:
        return Region(config.region)
    return workspace(shape, free=config.free or config.pose is not None)


def touch(
    shape: Shape,
    hand: Hand,
    config: RunConfig,
    *,
    estimator: Estimator | None = None,
    policy: Policy | None = None,
    prober: Prober | None = None,
    log: TouchLog | None = None,
    recorded: Sequence[ProbeOutcome] = (),
    progress: Callable[[int, int], None] | None = None,
    observe: Callable[[int, ImplicitSurface], None] | None = None,
    station: Station | None = None,
    arm_use: ArmUse | None = None,
) -> Exploration:
    """Explore the object by touch as configured; resume an interrupted log.

    Your own `estimator`, `policy` or `prober` replaces the configured one. Without a log,
    `recorded` are the outcomes to resume: those of the same exploration for fewer touches. The
    configured cloud is known before the first touch; it is no part of the result. The object is
    fixed, or free on a table: then it stays where a touch leaves it. `progress` and `observe` are
    those of `explore`.

    The true `shape` is used for two things only: the prober touches it, and without a region its
    bounding box is known. It is at the configured pose (see `pose_of`). With a `station`, its arm
    carries the hand; simulated touches add what they demand of it to `arm_use`.
    """
    space = prior_knowledge(shape, config)
    policy = policy or make_policy(config, space)
    recorded = log.resume() if log is not None else recorded
    cloud = None if config.cloud is None else prior_contacts(load_source(config.cloud))
    prober = prober or make_prober(config, hand, shape, recorded, station, arm_use)
    exploration = explore(
        prober,
        policy,
        estimator or make_estimator(config.estimator, config.sensor()),
        touches=config.touches,
        rng=np.random.default_rng([config.seed, _TOUCH_STREAM]),
        space=space,
        prior=cloud,
        sensor=config.sensor(),
        stop=[*config.stop_rules(space), *_grasp_rule(shape, hand, config)],
        tracker=make_tracker(config, prober),
        recorded=recorded,
        record=log.append if log is not None else None,
        progress=progress,
        observe=observe,
    )
    if log is not None:
        log.end(exploration.ended)
    return exploration


def _grasp_rule(shape: Shape, hand: Hand, config: RunConfig) -> list[StopRule]:
    """Return the rule that stops once a good grasp is found on the estimate, if configured.

    Of the shape it uses the support only.
    """
    if config.until_success is None:
        return []
    support, table = support_height(shape, config), table_of(config)

    def predict(surface: ImplicitSurface) -> float:
        try:
            mesh = extract_mesh(above_table(surface, table))
        except InvalidMeshError:  # too few contacts for a closed surface
            return 0.0
        prior = replace(config.load_prior(mesh), friction_spread=0.0, mass_spread=0.0)
        search = plan(
            mesh,
            hand,
            support=support,
            prior=prior,
            count=1,
            seed=config.seed,
            candidates=_FEW_SETS,
        )
        return search.grasps[0].quality["success_probability"] if search.grasps else 0.0

    return [stop_when_graspable(config.until_success, predict)]


def make_policy(config: RunConfig, space: Workspace | Region) -> Policy:
    """Return the policy that a configuration names, for one workspace or a region."""
    if isinstance(space, Region):
        return RegionPolicy(space, partial(make_policy, config))
    kind = POLICY_NAMES.find(config.policy)
    if not isinstance(kind, PolicyKind):
        return find_policy(config.policy, space)
    guess = make_estimator("gpis", config.sensor()) if kind.uses_gaussian_process else None
    return TargetPolicy(space, kind.select, guess)


def make_estimator(name: str, sensor: TactileSensor | None = None) -> Estimator:
    """Return an estimator, the package's or a plug-in, that is given the sensor's noise.

    Without noise an estimator keeps its own small default, which conditions its equations.
    """
    if sensor is None or not (sensor.position_noise or sensor.normal_noise):
        return find_estimator(name)
    return partial(
        find_estimator(name),
        position_noise=sensor.position_noise,
        normal_noise=sensor.normal_noise,
    )


def make_prober(
    config: RunConfig,
    hand: Hand,
    shape: Shape,
    recorded: Sequence[ProbeOutcome] = (),
    station: Station | None = None,
    arm_use: ArmUse | None = None,
) -> Prober:
    """Return the configured prober of the true object, in the state after recorded outcomes."""
    if config.prober == "dynamic":
        from lis_grasp.simulation.dynamic_prober import DynamicProber
        from lis_grasp.simulation.probing_scene import FreeObject

        free = None
        if config.free:
            height = support_height(shape, config)
            free = FreeObject(height, object_mass(shape, config), config.friction)
        threshold = config.sensor().force_threshold or None  # a touch must be detected to end
        prober = DynamicProber(
            hand, shape.mesh, free=free, force_threshold=threshold, station=station, arm_use=arm_use
        )
        if recorded and recorded[-1].simulated_pose is not None:
            prober.place_object(recorded[-1].simulated_pose)
        if recorded and recorded[-1].tracked is not None:
            prober.place_frame(recorded[-1].tracked.X_WE)
        return prober
    from lis_grasp.probing.kinematic_prober import Fingers, KinematicProber

    fingers: Fingers = "all" if config.fingers == "all" else "one"
    return KinematicProber(hand, shape.mesh, fingers=fingers, station=station)


def make_tracker(config: RunConfig, prober: Prober) -> PoseTracker | None:
    """Return the tracker of an object that is free; None for one that is fixed."""
    move_frame = getattr(prober, "move_frame", None)
    if not config.free or move_frame is None:
        return None
    return PoseTracker(move_frame, config.sensor().position_noise)


def estimate(
    contacts: Contacts,
    estimator: str,
    sensor: TactileSensor | None = None,
    *,
    free_space: bool = True,
    table: float | None = None,
) -> tuple[ImplicitSurface, trimesh.Trimesh]:
    """Estimate the surface from contacts of a sensor, and mesh it.

    With `free_space`, the contacts' free space is carved off. A `table` at a height [m] closes the
    estimate from below.
    """
    surface = make_estimator(estimator, sensor)(contacts)
    if free_space:
        margin = 0.0 if sensor is None else sensor.free_margin
        surface = carved(surface, contacts, margin=margin)
    surface = above_table(surface, table)
    return surface, extract_mesh(surface)


def plan(
    mesh: trimesh.Trimesh,
    hand: Hand,
    *,
    support: float | None,
    friction: float = 0.8,
    prior: LoadPrior | None = None,
    count: int,
    seed: int,
    candidates: int | None = None,
    station: Station | None = None,
) -> GraspSearch:
    """Plan `count` ranked grasps on a mesh on a plane at height `support` in O [m].

    The prior of mass and friction replaces the coefficient of `friction`. At most `candidates`
    contact sets are sampled; None for the sampler's default. With a `station`, its arm carries the
    hand, and grasps are within its reach.
    """
    sampler = ForceClosureSampler(hand, **asdict(prior or LoadPrior(friction)), station=station)
    if candidates is not None:
        sampler = replace(sampler, candidates=candidates)
    rng = np.random.default_rng([seed, _GRASP_STREAM])
    return sampler.sample(mesh, rng=rng, support_height=support, count=count)


def lift(
    shape: Shape,
    hand: Hand,
    grasp: Grasp,
    *,
    mass: float,
    friction: float,
    simulator: str = "drake",
    accept_grasp: AcceptGrasp | None = None,
    X_WO: FloatArray | None = None,
    options: LiftOptions | None = None,
    station: Station | None = None,
    estimate: trimesh.Trimesh | None = None,
) -> LiftOutcome:
    """Simulate the lift of the true object in one of `SIMULATORS`.

    With a `station`, its arm carries the hand, and avoids the `estimate` of the object. The other
    arguments are those of `lis_grasp.simulation.simulate_lift.simulate_lift`.
    """
    return _simulation_in(simulator, shape, station, estimate)(
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
    simulator: str = "drake",
    X_WO: FloatArray | None = None,
    options: LiftOptions | None = None,
    station: Station | None = None,
    estimate: trimesh.Trimesh | None = None,
) -> Iterator[LiftOutcome]:
    """Simulate the lift of each grasp on an object at the same pose X_WO, in `jobs` processes.

    Outcomes are in the order of the grasps, and the same for any number of processes.
    """
    simulate = partial(
        _simulation_in(simulator, shape, station, estimate),
        shape.mesh,
        hand,
        support_height=support_height(shape),
        mass=mass,
        friction=friction,
        X_WO=X_WO,
        options=options,
    )
    if jobs == 1 or len(grasps) < 2:
        yield from map(simulate, grasps)
        return
    with worker_pool(min(jobs, len(grasps))) as pool:
        yield from pool.map(simulate, grasps)


def _simulation_in(
    simulator: str, shape: Shape, station: Station | None, estimate: trimesh.Trimesh | None
) -> Callable[..., LiftOutcome]:
    """Return the function that simulates lifts of an object, with its convex pieces if needed."""
    if station is not None:
        return partial(_lift_with_arm, station, estimate)
    if simulator == "mujoco":
        from lis_grasp.mujoco_simulation.convex_pieces import convex_pieces
        from lis_grasp.mujoco_simulation.simulate_in_mujoco import simulate_in_mujoco

        return partial(simulate_in_mujoco, pieces=convex_pieces(shape.mesh))
    from lis_grasp.simulation.simulate_lift import simulate_lift

    return simulate_lift


def _lift_with_arm(
    station: Station,
    estimate: trimesh.Trimesh | None,
    mesh: trimesh.Trimesh,
    hand: Hand,
    grasp: Grasp,
    *,
    X_WO: FloatArray | None = None,
    options: LiftOptions | None = None,
    **arguments: Any,
) -> LiftOutcome:
    """Plan the arm's motion to a grasp on the estimate, and simulate the lift in Drake."""
    from lis_grasp.simulation.simulate_lift import simulate_lift

    options = options or LiftOptions()
    arm = plan_arm_lift(station, grasp, estimate, time_step=options.time_step)
    if isinstance(arm, str):
        return LiftOutcome.not_begun(arm, np.eye(4) if X_WO is None else X_WO)
    return simulate_lift(mesh, hand, grasp, X_WO=X_WO, options=options, arm=arm, **arguments)
