"""Stages before the lift: touch, the estimate of the surface, and the plan of grasps."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, TooManyBadContactsError
from lis_grasp.exploration import (
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
    TactileSensor,
    TargetPolicy,
    Workspace,
    explore_steps,
    stop_after,
    stop_when_certain,
    stop_when_covered,
    stop_when_graspable,
)
from lis_grasp.exploration.policy import POLICY_NAMES, PolicyKind, find_policy
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.grasping.sampler import CANDIDATES, ForceClosureSampler
from lis_grasp.lifting.outcome import ArmUse
from lis_grasp.meshing import extract_mesh
from lis_grasp.stages.agent import Known, Perception, require_record
from lis_grasp.stages.contact_sources import prior_contacts
from lis_grasp.stages.scenario import Scenario
from lis_grasp.surfaces import ContactVerdicts, Estimator, ImplicitSurface
from lis_grasp.surfaces import estimate as estimate_surface
from lis_grasp.surfaces.carved_implicit_surface import above_table
from lis_grasp.surfaces.estimators import find_estimator

# Streams of random numbers: a stage that runs alone repeats its part of a whole run.
_TOUCH_STREAM = 1
_GRASP_STREAM = 2
_FEW_SETS = 400  # contact sets sampled to predict a success during an exploration


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


def make_estimator(estimator: str | Estimator, sensor: TactileSensor) -> Estimator:
    """Return the estimator of a name, the package's or a plug-in, given the sensor's noise.

    It estimates a noise that is 0 from the contacts, or keeps its own default. An estimator that is
    no name is returned as it is.
    """
    if not isinstance(estimator, str):
        return estimator
    noise = {"position_noise": sensor.position_noise, "normal_noise": sensor.normal_noise}
    given = {kind: value for kind, value in noise.items() if value}
    return partial(find_estimator(estimator), **given)


def estimate(known: Perception, contacts: Contacts) -> tuple[ImplicitSurface, trimesh.Trimesh]:
    """Estimate the surface from contacts, and mesh it.

    `known` says by which estimator and sensor, whether the contacts' free space is removed, and
    which table closes the estimate from below.

    Examples
    --------
    >>> surface, mesh = pipeline.estimate(pipeline.Perception(estimator="gpis"), contacts)
    >>> mesh.is_watertight
    True
    """
    require_record("estimate", known, Perception)
    surface = estimate_surface(
        known.judge(contacts).credible,
        make_estimator(known.estimator, known.sensor),
        free_space=known.free_space,
        margin=known.sensor.free_margin,
        table=known.table,
    )
    return surface, extract_mesh(surface, touched=contacts.points)


def plan(known: Known, mesh: trimesh.Trimesh, *, candidates: int = CANDIDATES) -> GraspSearch:
    """Plan the ranked grasps of the known hand, and its arm if it has one, on a mesh.

    At most `candidates` contact sets are sampled.

    Examples
    --------
    >>> scenario = pipeline.Scenario.from_config(RunConfig("box", hand="wsg50", grasps=1))
    >>> len(pipeline.plan(scenario.known, scenario.truth.shape.mesh))
    1
    """
    require_record("plan", known, Known)
    load, station = known.load_prior(mesh), known.station
    sampler = ForceClosureSampler(
        known.hand, load, candidates=candidates, station=station, obstacles=known.obstacles
    )
    rng = np.random.default_rng([known.seed, _GRASP_STREAM])
    return sampler.sample(mesh, rng=rng, support_height=known.support, count=known.grasps)


def touch(
    scenario: Scenario, *, prober: Prober | None = None, recorded: Sequence[ProbeOutcome] = ()
) -> Exploration:
    """Explore the object of a scenario by touch.

    The configured cloud is known before the first touch; it is no part of the result. The object is
    fixed, or free on a table: then it stays where a touch leaves it.

    Parameters
    ----------
    scenario
        The prober touches its true object; everything else depends on what is known.
    prober
        Carries out the probes; None for the configured one.
    recorded
        Outcomes to resume: those of the same exploration, interrupted or for fewer touches.

    Examples
    --------
    >>> config = RunConfig("box", hand="wsg50", prober="kinematic", touches=3)
    >>> pipeline.touch(pipeline.Scenario.from_config(config)).made
    3
    """
    scenario.config.require_slides()
    prober = make_prober(scenario, recorded) if prober is None else prober
    return deque(touch_steps(scenario, prober, recorded), maxlen=1).pop().result


def touch_steps(
    scenario: Scenario, prober: Prober, recorded: Sequence[ProbeOutcome] = ()
) -> Iterator[ExplorationState]:
    """Explore as `touch` does, step by step, as of `explore_steps`."""
    known = scenario.known
    setup = replace(
        exploration_setup(known), stop=stop_rules(known), tracker=make_tracker(scenario, prober)
    )
    return explore_steps(prober, setup, rng=exploration_rng(known), recorded=recorded)


def exploration_setup(known: Known) -> ExplorationSetup:
    """Return the known setup of an exploration, without stop rules and tracker."""
    judge = lru_cache(maxsize=1)(known.judge)  # for strays, then for the estimate
    return ExplorationSetup(
        make_policy(known.policy, known.space, known.sensor),
        _on_credible(make_estimator(known.estimator, known.sensor), judge),
        known.touches,
        space=known.space,
        prior=prior_contacts(known.cloud_contacts),
        sensor=known.sensor,
        find_strays=None if known.keep_all else lambda c: judge(c).rows("stray"),
        slide=known.slide,
    )


def _on_credible(make: Estimator, judge: Callable[[Contacts], ContactVerdicts]) -> Estimator:
    """Return an estimator of what is credible, or of all if too much is not: touches go on."""

    def estimate(contacts: Contacts) -> ImplicitSurface:
        try:
            return make(judge(contacts).credible)
        except TooManyBadContactsError:
            return make(replace(contacts, judged=True))

    return estimate


def exploration_rng(known: Known) -> np.random.Generator:
    """Return the generator of an exploration; each probe draws from one that it spawns."""
    return np.random.default_rng([known.seed, _TOUCH_STREAM])


def stop_rules(known: Known) -> list[StopRule]:
    """Return new rules that end the exploration of a known space early."""
    rules = []
    if known.until_coverage is not None:
        rules.append(stop_when_covered(known.until_coverage, known.space))
    if known.until_uncertainty is not None:
        rules.append(stop_when_certain(known.until_uncertainty, known.space))
    if known.max_seconds is not None:
        rules.append(stop_after(known.max_seconds))
    if known.until_success is not None:
        rules.append(stop_when_graspable(known.until_success, partial(_best_success, known)))
    return rules


def _best_success(known: Known, surface: ImplicitSurface) -> float:
    """Return the probability that the best of a few grasps closes, which the surface decides.

    Touching does not show how much weight a grasp must carry.
    """
    try:
        mesh = extract_mesh(above_table(surface, known.table))
    except EstimationError:  # too few contacts for a closed surface
        return 0.0
    load = replace(known.load_prior(mesh), friction_spread=0.0, mass_spread=0.0)
    best = replace(known, load=load, mass_by_volume=False, grasps=1, station=None)
    search = plan(best, mesh, candidates=_FEW_SETS)
    return search.grasps[0].quality["closure_probability"] if search.grasps else 0.0


def make_policy(
    policy: str | Callable[[Workspace], Policy], space: Workspace | Region, sensor: TactileSensor
) -> Policy:
    """Return the policy of a name, the package's or a plug-in, for one workspace or a region."""
    if isinstance(space, Region):
        return RegionPolicy(space, partial(make_policy, policy, sensor=sensor))
    if not isinstance(policy, str):
        return policy(space)
    kind = POLICY_NAMES.find(policy)
    if not isinstance(kind, PolicyKind):
        return find_policy(policy, space)
    guess = None
    if kind.uses_gaussian_process:
        guess = _on_credible(make_estimator("gpis", sensor), Perception(sensor=sensor).judge)
    return TargetPolicy(space, kind.select, guess)


def make_prober(
    scenario: Scenario, recorded: Sequence[ProbeOutcome] = (), arm_use: ArmUse | None = None
) -> Prober:
    """Return the configured prober of the true object, in the state after recorded outcomes.

    Simulated touches add what they demand of an arm to `arm_use`.
    """
    config, truth, known = scenario.config, scenario.truth, scenario.known
    mesh = truth.shape.mesh
    if config.prober == "dynamic":
        from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
        from lis_grasp.simulation.drake.object_plant import FreeObject

        free = FreeObject(known.support, truth.mass, truth.friction) if config.free else None
        prober = DynamicProber(
            known.hand,
            mesh,
            free=free,
            force_threshold=known.sensor.force_threshold or None,  # a touch must be detected to end
            station=known.station,
            arm_use=arm_use,
        )
        if recorded and recorded[-1].simulated_pose is not None:
            prober.place_object(recorded[-1].simulated_pose)
        if recorded and recorded[-1].tracked is not None:
            prober.place_frame(recorded[-1].tracked.X_WE)
        return prober
    from lis_grasp.probing.kinematic_prober import Fingers, KinematicProber

    fingers: Fingers = "all" if config.fingers == "all" else "one"
    return KinematicProber(known.hand, mesh, fingers=fingers, station=known.station)


def make_tracker(scenario: Scenario, prober: Prober) -> PoseTracker | None:
    """Return the tracker of an object that is free; None for one that is fixed."""
    if not scenario.config.free or not isinstance(prober, MovingProber):
        return None
    return PoseTracker(scenario.known.sensor.position_noise)
