"""Agents of the environment: the package's policies, with an estimator's answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.geometry import unit
from lis_grasp.stages.touch import make_policy
from lis_grasp.surfaces.estimators import ESTIMATORS
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.typing import FloatArray
from lis_grasp_studies.environment.touch_env import TouchEnv

_UNKNOWN = 0.25  # probability of a place before the first touch: about what is solid of the box
_LEAST_DEVIATION = 1e-3  # of an estimate, in half sizes


@dataclass(frozen=True, slots=True)
class RandomAgent:
    """Touches anywhere from anywhere, and answers as an estimator does."""

    estimator: str = "gpis"

    def act(self, env: TouchEnv, *, rng: np.random.Generator) -> dict[str, Any]:
        """Return an action for the present state of an environment."""
        touch = np.hstack([rng.uniform(-0.5, 0.5, 3), unit(rng.normal(size=3))])
        return {"touch": touch, "answer": answer(env, self.estimator)}


@dataclass(frozen=True, slots=True)
class PolicyAgent:
    """Touches as a policy of the package chooses, and answers as an estimator does."""

    policy: str
    estimator: str = "gpis"

    def act(self, env: TouchEnv, *, rng: np.random.Generator) -> dict[str, Any]:
        """Return an action for the present state of an environment."""
        policy = make_policy(self.policy, env.space, TactileSensor())
        contacts, surface = env.contacts, estimate(env.contacts, self.estimator)
        probe = policy.next_probe(contacts, surface, outcomes=tuple(env.outcomes), rng=rng)
        return env.action_of(probe, answer(env, self.estimator))


def estimate(contacts: Contacts, estimator: str) -> ImplicitSurface | None:
    """Return the surface of contacts; None if there is none."""
    try:
        return ESTIMATORS[estimator](contacts) if len(contacts) else None
    except EstimationError:
        return None


def answer(env: TouchEnv, estimator: str) -> FloatArray:
    """Return an estimator's answer to what an environment asks.

    For occupancy, the probability that f is below 0 by its slope and uncertainty. For a grasp, the
    two contacts whose normals are most opposite along the line between them.
    """
    surface = estimate(env.contacts, estimator)
    if env.answer == "grasp":
        return _opposite(env.contacts) / env.half
    if surface is None:
        return np.full(len(env.places), _UNKNOWN)
    places = env.half * env.places
    slopes = np.linalg.norm(surface.gradient(places), axis=1)
    spread = slopes * surface.uncertainty(places) + _LEAST_DEVIATION * env.half
    return np.asarray(ndtr(-surface.evaluate(places) / spread))


def _opposite(contacts: Contacts) -> FloatArray:
    """Return the two points (2, 3) [m] of contacts that face each other best along their line."""
    if len(contacts) < 2:
        return np.zeros((2, 3))
    points, normals = contacts.points, contacts.normals
    ways = points - points[:, None]  # (N, N, 3), from the first to the second
    lengths = np.linalg.norm(ways, axis=2)
    ways = ways / np.where(lengths > 0.0, lengths, 1.0)[..., None]
    leaving = -np.einsum("ik,ijk->ij", normals, ways)
    arriving = np.einsum("jk,ijk->ij", normals, ways)
    worst = np.where(lengths > 0.0, np.minimum(leaving, arriving), -1.0)
    first, second = np.unravel_index(int(np.argmax(worst)), worst.shape)
    return points[[first, second]]


def play(env: TouchEnv, agent: RandomAgent | PolicyAgent, *, seed: int, number: int) -> float:
    """Play one episode on an object; return the last reward, after all touches but one."""
    rng = np.random.default_rng([seed, number])
    env.reset(seed=seed, options={"number": number})
    while True:
        _, reward, ended, _, _ = env.step(agent.act(env, rng=rng))
        if ended:
            return reward
