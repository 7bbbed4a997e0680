"""Touch stage: the exploration of an object, by the prober and policy of the task."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from lis_grasp.arms.use import ArmUse
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import (
    Exploration,
    ExplorationState,
    ExplorationStrategy,
    MovingProber,
    Observation,
    Policy,
    PoseTracker,
    Prober,
    Region,
    RegionPolicy,
    SimulatedProber,
    TactilePerception,
    TactileSensor,
    TargetPolicy,
    Workspace,
    begin,
    explore_steps,
)
from lis_grasp.exploration.disturbance import Disturbance, DisturbingProber
from lis_grasp.exploration.policy import POLICY_NAMES, PolicyKind, find_policy, made_policy
from lis_grasp.exploration.prior import NOTHING, PriorKnowledge, with_touched
from lis_grasp.exploration.stopping import (
    StopRule,
    stop_after,
    stop_when_certain,
    stop_when_covered,
    stop_when_graspable,
)
from lis_grasp.plugins import qualified_name
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.contact_sources import prior_contacts
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.stages.plan import closure_probability
from lis_grasp.stages.random_streams import Stream
from lis_grasp.stages.scenario import Scenario
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.surfaces.estimators import FEW_CONTACTS
from lis_grasp.typing import FloatArray, IndexArray

# After a view there are many contacts from the start: others take eight times as long, and touches
# that they guide are no better.
_GUIDE_AFTER_A_VIEW = "gpis"


def touch(
    scenario: Scenario, *, prober: Prober | None = None, recorded: Sequence[Observation] = ()
) -> Exploration:
    """Explore the object of a scenario by touch.

    The task's cloud is known before the first touch, but is not part of the result. The object is
    fixed, or free on a table: then it stays where a touch leaves it.

    Parameters
    ----------
    scenario
        The prober touches its true object; everything else depends on what is known.
    prober
        Carries out the probes; None for the task's.
    recorded
        Observations to resume: those of the same exploration, interrupted or with fewer touches.
        A free object is where `Scenario.moved` puts it.

    Examples
    --------
    >>> task = Task.of("box", hand="wsg50", prober="kinematic", touches=3)
    >>> pipeline.touch(pipeline.Scenario.from_config(task)).made
    3
    """
    scenario.task.require_slides()
    prober = make_prober(scenario, recorded) if prober is None else prober
    return deque(touch_steps(scenario, prober, recorded), maxlen=1).pop().result


def touch_steps(
    scenario: Scenario, prober: Prober, recorded: Sequence[Observation] = ()
) -> Iterator[ExplorationState]:
    """Explore as `touch` does, step by step, as in `explore_steps`."""
    agent = scenario.agent
    perception = make_perception(agent.perception, prior_contacts(agent.cloud_contacts))
    perception = replace(
        perception, tracker=make_tracker(scenario, prober), beside=agent.known_bodies
    )
    strategy = replace(make_strategy(agent), stop=stop_rules(agent))
    start = begin(perception, strategy, recorded)
    return explore_steps(prober, perception, strategy, rng=exploration_rng(agent), start=start)


def make_perception(settings: Perception, touched: Contacts | None = None) -> TactilePerception:
    """Return how contacts become knowledge, without a tracker.

    `touched` contacts are known before the first touch, beside the prior of the settings.
    """
    prior = settings.prior if touched is None else with_touched(settings.prior, touched)
    settings = replace(settings, support_height=None)  # the hand avoids the table by itself

    @lru_cache(maxsize=1)  # contacts are judged once: for strays, then for the estimate
    def estimate(contacts: Contacts, prior: PriorKnowledge) -> SurfaceEstimate:
        guiding = _GUIDE_AFTER_A_VIEW if len(prior.seen) else settings.estimator
        return SurfaceEstimate(contacts, replace(settings, prior=prior, estimator=guiding))

    def guide(contacts: Contacts, prior: PriorKnowledge = NOTHING) -> ImplicitSurface:
        return estimate(contacts, prior).guide

    def find_strays(contacts: Contacts) -> IndexArray:
        return estimate(contacts, NOTHING).verdicts.rows("stray")

    return TactilePerception(
        guide,
        prior=prior,
        sensor=settings.sensor,
        find_strays=None if settings.keep_all else find_strays,
    )


def make_strategy(agent: Agent) -> ExplorationStrategy:
    """Return how probes are chosen, without stop rules."""
    decide = agent.decide
    return ExplorationStrategy(
        make_policy(decide.policy, agent.known_space, agent.robot.sensor),
        decide.touches,
        space=agent.space,
        slide=decide.slide if agent.may_slide else 0.0,
    )


def exploration_rng(agent: Agent) -> np.random.Generator:
    """Return the generator of an exploration; each probe draws from one that it spawns."""
    return Stream.TOUCH.rng(agent.seed)


def stop_rules(agent: Agent) -> list[StopRule]:
    """Return new rules that end an exploration early."""
    decide, rules = agent.decide, []
    if decide.until_coverage is not None:
        rules.append(stop_when_covered(decide.until_coverage, agent.known_space))
    if decide.until_uncertainty is not None:
        rules.append(stop_when_certain(decide.until_uncertainty, agent.known_space))
    if decide.max_seconds is not None:
        rules.append(stop_after(decide.max_seconds))
    if decide.until_success is not None:
        predict, least = partial(closure_probability, agent), FEW_CONTACTS if not agent.views else 0
        rules.append(stop_when_graspable(decide.until_success, predict, least=least))
    return rules


def make_policy(
    policy: str | Callable[[Workspace], Policy], space: Workspace | Region, sensor: TactileSensor
) -> Policy:
    """Return the policy of a name, built in or plugged in, for a workspace or a region."""
    if isinstance(space, Region):
        return RegionPolicy(space, partial(make_policy, policy, sensor=sensor))
    if not isinstance(policy, str):
        return made_policy(policy, qualified_name(policy), lambda: policy(space))
    kind = POLICY_NAMES.find(policy)
    if not isinstance(kind, PolicyKind):
        return find_policy(policy, space)
    guess = None
    if kind.uses_gaussian_process:
        perception = Perception(estimator="gpis", sensor=sensor, normals="outward")
        guess = lambda contacts: SurfaceEstimate(contacts, perception).guide  # noqa: E731
    return TargetPolicy(space, kind.select, guess)


def make_prober(
    scenario: Scenario,
    recorded: Sequence[Observation] = (),
    arm_use: ArmUse | None = None,
    disturbance: Disturbance | None = None,
) -> Prober:
    """Return the task's prober of the true object, in the frame after recorded observations.

    Simulated touches add their demands on an arm to `arm_use`. `disturbance` is what the recorded
    ones did to the bodies beside the object; None for nothing.
    """
    world, truth, agent = scenario.task.world, scenario.truth, scenario.agent
    mesh, sensor = truth.shape.mesh, agent.robot.sensor
    outcomes = [observation.outcome for observation in recorded]
    if world.prober == "dynamic":
        from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
        from lis_grasp.simulation.drake.object_plant import FreeObject

        on_plane = FreeObject(agent.support_height, truth.mass, truth.friction)
        prober = DynamicProber(
            agent.hand,
            mesh,
            free=on_plane if world.is_free else None,
            force_threshold=sensor.force_threshold or None,  # only a detected touch ends a motion
            station=agent.station,
            arm_use=arm_use,
            surroundings=truth.surroundings,
            known=agent.surroundings,
        )
        if world.is_free:
            prober.place_object(truth.X_EO)
        if disturbance is not None:
            prober.place_disturbed(disturbance)
        if recorded and recorded[-1].belief is not None:
            prober.place_frame(recorded[-1].belief.X_WE)
        prober.resume(outcomes)
        return prober
    from lis_grasp.probing.kinematic_prober import Fingers, KinematicProber

    fingers: Fingers = "all" if agent.decide.fingers == "all" else "one"
    by_geometry = KinematicProber(
        agent.hand,
        mesh,
        fingers=fingers,
        station=agent.station,
        surroundings=truth.surroundings,
        known=agent.surroundings,
    )
    by_geometry.resume(outcomes)
    return by_geometry


def true_pose(prober: Prober) -> FloatArray | None:
    """Return the true pose X_EO (4, 4) of a simulated free object; None if fixed or unknown."""
    return prober.X_EO if isinstance(prober, SimulatedProber) else None


def disturbance_by(prober: Prober) -> Disturbance | None:
    """Return what simulated touches did to the bodies beside the object; None if unknown."""
    return prober.disturbance if isinstance(prober, DisturbingProber) else None


def make_tracker(scenario: Scenario, prober: Prober) -> PoseTracker | None:
    """Return the tracker of an object that is free; None for one that is fixed."""
    if not scenario.task.world.is_free or not isinstance(prober, MovingProber):
        return None
    return PoseTracker(scenario.agent.robot.sensor.position_noise)
