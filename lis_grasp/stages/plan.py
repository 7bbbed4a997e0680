"""Plan stage: ranked grasps of the robot's hand, and of its arm, on a mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.grasping.grasps import LIFT, GraspSearch
from lis_grasp.grasping.sampler import CANDIDATES
from lis_grasp.grasping.samplers import sampler_of
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.planned_lifts import permitted_lifts
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.estimate import SurfaceEstimate
from lis_grasp.stages.load import KnownLoad
from lis_grasp.stages.random_streams import Stream

_FEW_SETS = 400  # contact sets sampled to predict a success during an exploration


def plan_grasps(
    agent: Agent, mesh: trimesh.Trimesh, *, candidates: int = CANDIDATES
) -> GraspSearch:
    """Plan the ranked grasps of the agent's hand, and its arm if it has one, on a mesh.

    At most `candidates` contact sets are sampled.

    Examples
    --------
    >>> scenario = pipeline.Scenario.from_config(Task.of("box", hand="wsg50", grasps=1))
    >>> len(pipeline.plan(scenario.agent, scenario.truth.shape.mesh))
    1
    """
    load = agent.load.of_mesh(mesh)
    sampler = sampler_of(
        agent.hand,
        load,
        candidates=candidates,
        station=agent.station,
        surroundings=agent.surroundings,
        lifts=permitted_lifts(LiftOptions(), highest=highest_lift(agent)),
        margin=agent.robot.body_error,
    )
    rng = Stream.GRASP.rng(agent.seed)
    height, count = agent.support_height, agent.decide.grasps
    return sampler.sample(mesh, rng=rng, support_height=height, count=count)


def highest_lift(agent: Agent) -> float:
    """Return the largest rise of the wrist [m]; an arm is only checked for the usual one."""
    return np.inf if agent.station is None else LIFT


def closure_probability(agent: Agent, contacts: Contacts) -> float:
    """Return the probability that the best of a few grasps has force closure, or that a cup seals.

    It depends on the surface alone: touching does not show the weight to carry.
    """
    try:
        mesh = SurfaceEstimate(contacts, agent.perception).mesh
    except EstimationError:  # too few contacts for a closed surface
        return 0.0
    load = replace(agent.load.of_mesh(mesh), friction_spread=0.0, mass_spread=0.0)
    best = replace(agent, load=KnownLoad(load), station=None).deciding(grasps=1)
    search = plan_grasps(best, mesh, candidates=_FEW_SETS)
    return search.grasps[0].quality["closure_probability"] if search.grasps else 0.0
