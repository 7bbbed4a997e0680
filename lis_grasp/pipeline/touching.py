"""Touch stage: prior knowledge, policy, prober, tracker and stop rules of a configuration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lis_grasp.arms.station import Station
from lis_grasp.exceptions import EstimationError
from lis_grasp.exploration import (
    STEP_FRACTION,
    Exploration,
    ExplorationSetup,
    ExplorationState,
    MovingProber,
    Policy,
    PoseTracker,
    ProbeOutcome,
    Prober,
    Region,
    RegionPolicy,
    StopRule,
    TargetPolicy,
    TouchLog,
    Workspace,
    explore,
    stop_when_graspable,
)
from lis_grasp.exploration.policy import PolicyKind
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.meshing import extract_mesh
from lis_grasp.pipeline.contact_sources import load_source, prior_contacts
from lis_grasp.pipeline.object_setup import support_height, table_of
from lis_grasp.pipeline.plugged_in import POLICY_NAMES, find_policy
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.stages import make_estimator, plan
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.surfaces import Estimator, ImplicitSurface
from lis_grasp.surfaces.carved_implicit_surface import above_table

_TOUCH_STREAM = 1  # of random numbers: a stage run alone repeats its part of a whole run
_FEW_SETS = 400  # contact sets sampled to predict a success during an exploration


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
    on_table = config.free or config.pose is not None or config.arm is not None
    return workspace(shape, free=on_table)


def for_fingertips(space: Workspace | Region, hand: Hand) -> Workspace | Region:
    """Return prior knowledge with the radius of the hand's thickest probing fingertip."""
    radii = [posture.radius for posture in hand.probe_postures.values()]
    return replace(space, tip_radius=max(radii)) if radii else space


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
    observe: Callable[[ExplorationState], None] | None = None,
    station: Station | None = None,
    arm_use: ArmUse | None = None,
) -> Exploration:
    """Explore the object by touch as configured; resume an interrupted log, reuse an ended one.

    Your own `estimator`, `policy` or `prober` replaces the configured one. Without a log,
    `recorded` are the outcomes to resume: those of the same exploration for fewer touches. The
    configured cloud is known before the first touch; it is no part of the result. The object is
    fixed, or free on a table: then it stays where a touch leaves it. `observe` is that of
    `explore`.

    The true `shape` is used for two things only: the prober touches it, and without a region its
    bounding box is known. It is at the configured pose (see `pose_of`). With a `station`, its arm
    carries the hand; simulated touches add what they demand of it to `arm_use`.
    """
    space = for_fingertips(prior_knowledge(shape, config), hand)
    policy = policy or make_policy(config, space)
    if log is not None:
        recorded, ending = log.resume(), log.ending()
        if ending is not None:
            return replace(Exploration.replay(recorded, touches=config.touches), ended=ending)
    cloud = None if config.cloud is None else prior_contacts(load_source(config.cloud))
    prober = prober or make_prober(config, hand, shape, recorded, station, arm_use)
    setup = ExplorationSetup(
        policy,
        estimator or make_estimator(config.estimator, config.sensor()),
        config.touches,
        space=space,
        prior=cloud,
        sensor=config.sensor(),
        stop=[*config.stop_rules(space), *_grasp_rule(shape, hand, config)],
        tracker=make_tracker(config, prober),
    )
    exploration = explore(
        prober,
        setup,
        rng=np.random.default_rng([config.seed, _TOUCH_STREAM]),
        recorded=recorded,
        record=log.append if log is not None else None,
        observe=observe,
    )
    if log is not None:
        log.end(exploration.ended)
    return exploration


def _grasp_rule(shape: Shape, hand: Hand, config: RunConfig) -> list[StopRule]:
    """Return the rule that stops once a good grasp is found on the estimate, if configured.

    Good is what succeeds as far as the surface decides it: touching does not show how much weight
    a grasp must carry. Of the shape the rule uses the support only.
    """
    if config.until_success is None:
        return []
    support = support_height(shape, config)
    table = table_of(config, support)

    def predict(surface: ImplicitSurface) -> float:
        try:
            mesh = extract_mesh(above_table(surface, table))
        except EstimationError:  # too few contacts for a closed surface
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
        return search.grasps[0].quality["shape_probability"] if search.grasps else 0.0

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
        from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
        from lis_grasp.simulation.drake.object_plant import FreeObject

        free = None
        if config.free:
            height = support_height(shape, config)
            free = FreeObject(height, config.mass_of(shape.mesh), config.friction)
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
    if not config.free or not isinstance(prober, MovingProber):
        return None
    return PoseTracker(config.sensor().position_noise)
