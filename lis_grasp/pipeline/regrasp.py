"""Grasp, feel, and grasp again: what closing fingers feel is new contact, and may warn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.grasping.assessment import robust_epsilon_on
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.hands.hand import Hand
from lis_grasp.pipeline import stages
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray

if TYPE_CHECKING:
    from lis_grasp.simulation.simulate_lift import LiftOutcome


# Where a finger found nothing, no other grasp puts a finger within this distance [m].
_MISSED_RADIUS = 0.01


# What is known -> the surface estimated from it, and grasps planned on that.
Planner = Callable[[Contacts], tuple[trimesh.Trimesh, GraspSearch]]


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One grasp, planned on what was known of the object by then.

    Parameters
    ----------
    contacts
        All contacts that were known.
    mesh
        The surface estimated from them, in O [m].
    search
        What was planned on it.
    rank
        Place in the search of the grasp that was tried, from 0.
    outcome
        What came of it; None where no grasp was found.
    """

    contacts: Contacts
    mesh: trimesh.Trimesh
    search: GraspSearch
    rank: int
    outcome: LiftOutcome | None


def grasp_by_touch(
    shape: Shape,
    hand: Hand,
    contacts: Contacts,
    config: RunConfig,
    *,
    planner: Planner | None = None,
    lift: Callable[..., LiftOutcome] = stages.lift,
) -> Iterator[Attempt]:
    """Plan and try grasps until one is carried through, `RunConfig.attempts` at the most.

    Once its fingers have closed, before it squeezes, the hand asks whether what they feel is in
    force closure at half the friction; if not, or if it meets the object on its way, it lets go,
    goes back, estimates the surface again with these contacts too, and plans again, elsewhere than
    where a finger found nothing. The last attempt is carried through whatever it feels. The object
    may have been moved by a touch: the next attempt meets it where it stands, and is planned as if
    it had not moved.

    Parameters
    ----------
    shape
        The true object, which only touches tell of.
    hand
        The hand.
    contacts
        Of the exploration.
    config
        Estimator, sensor noise, friction, mass, grasps, attempts and seed.
    planner
        Estimates and plans; None does so as the configuration says.
    lift
        Tries a grasp; called as `pipeline.lift`.
    """
    planner = planner or _planner(shape, hand, config)
    missed = np.empty((0, 3))
    X_WO: FloatArray | None = None
    for left in reversed(range(config.attempts)):
        mesh, search = planner(contacts)
        if not search.grasps:
            yield Attempt(contacts, mesh, search, 0, None)
            return
        rank = _first_away_from(missed, search)
        grasp = search.grasps[rank]
        outcome = lift(
            shape,
            hand,
            grasp,
            mass=config.mass,
            friction=config.friction,
            accept_grasp=_promising(mesh, hand, config.friction) if left else None,
            X_WO=X_WO,
        )
        yield Attempt(contacts, mesh, search, rank, outcome)
        if outcome.reason != "aborted":
            return
        contacts = contacts.append(outcome.felt)
        missed = np.vstack([missed, _missed(grasp, outcome)])
        X_WO = outcome.X_WO


def _planner(shape: Shape, hand: Hand, config: RunConfig) -> Planner:
    def estimate_and_plan(contacts: Contacts) -> tuple[trimesh.Trimesh, GraspSearch]:
        _, mesh = stages.estimate(
            contacts, config.estimator, config.sensor(), free_space=config.free_space
        )
        return mesh, stages.plan(
            mesh,
            hand,
            support=stages.support_height(shape),
            friction=config.friction,
            count=config.grasps,
            seed=config.seed,
        )

    return estimate_and_plan


def _promising(mesh: trimesh.Trimesh, hand: Hand, friction: float) -> Callable[[Contacts], bool]:
    def promising(felt: Contacts) -> bool:
        if len(felt) < 2:
            return False
        return robust_epsilon_on(mesh, hand, felt.points, felt.normals, friction=friction) > 0.0

    return promising


def _missed(grasp: Grasp, outcome: LiftOutcome) -> FloatArray:
    """Return the planned contacts of fingers that closed and felt nothing, shape (K, 3)."""
    if not outcome.closed:
        return np.empty((0, 3))
    return grasp.contact_points[[f not in outcome.felt.fingers for f in grasp.contact_fingers]]


def _first_away_from(missed: FloatArray, search: GraspSearch) -> int:
    """Return the best grasp that touches nowhere where a finger found nothing, else the best."""
    for rank, grasp in enumerate(search.grasps):
        between = np.linalg.norm(grasp.contact_points[:, None] - missed, axis=-1)
        if not (between < _MISSED_RADIUS).any():
            return rank
    return 0
