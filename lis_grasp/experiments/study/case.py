"""Trials worth a look: which they are, and what was felt, estimated, planned and lifted in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

import trimesh
from threadpoolctl import threadpool_limits

from lis_grasp.contacts import Contacts
from lis_grasp.experiments.study.attempt import lift, plan
from lis_grasp.experiments.study.comparison import names, pair_of
from lis_grasp.experiments.study.exploring import contacts_of
from lis_grasp.experiments.study.study import TRUTH, find_object
from lis_grasp.experiments.study.study_trial import Job, estimate, explorer_of
from lis_grasp.experiments.study.success_rates import share_of
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.hands.hand import Hand
from lis_grasp.io.json_lines import Row
from lis_grasp.motion import Motion
from lis_grasp.shapes import Shape


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One trial of one estimator, with all its geometry.

    Parameters
    ----------
    shape, hand
        The true object, and who grasps it.
    contacts, mesh
        What was felt, and the surface that was made of it, in O.
    grasps
        What was planned on it, best first; the first is executed.
    motion
        Of the lift; None where there is no grasp.
    """

    shape: Shape
    hand: Hand
    contacts: Contacts
    mesh: trimesh.Trimesh
    grasps: tuple[Grasp, ...]
    motion: Motion | None


def extremes(rows: Sequence[Row], reference: str) -> list[tuple[Row, Row]]:
    """Return the clearest pair won and the clearest lost, each the winner's row and the loser's.

    Of the estimator that holds most, against the reference; clearest is where epsilon on the truth
    differs most. None of a kind that there is not.
    """
    others = [name for name in names(rows, "estimator") if name not in (reference, TRUTH)]
    shares = {
        name: share.value
        for name in others
        if (share := share_of([row for row in rows if row["estimator"] == name])) is not None
    }
    if not shares:
        return []
    leader = max(shares, key=lambda name: shares[name])
    its = {pair_of(row): row for row in rows if row["estimator"] == reference}
    pairs = [
        (row, its[pair_of(row)])
        for row in rows
        if row["estimator"] == leader and pair_of(row) in its
    ]
    won = [(mine, other) for mine, other in pairs if mine["held"] and not other["held"]]
    lost = [(other, mine) for mine, other in pairs if other["held"] and not mine["held"]]
    return [max(found, key=_margin) for found in (won, lost) if found]


def make_case(job: Job) -> Case:
    """Make the first row of a job again, and keep what is not in a row.

    Raises
    ------
    LisGraspError
        If that trial came to no surface.
    """
    trial, setup, estimator = job.trial, job.setup, job.estimators[0]
    import_module("lis_grasp.simulation.simulate_lift")  # so that Drake's threads are limited, too
    with threadpool_limits(1):
        shape, hand = find_object(trial.object, setup), Hand.load(trial.hand)
        contacts, _ = contacts_of(trial, setup, explorer_of(setup, estimator))
        mesh = estimate(trial, estimator, contacts)
        grasps = plan(mesh, shape, hand, setup, trial.seed).grasps
        motion = lift(grasps[0], shape, hand, setup).motion if grasps else None
    return Case(shape, hand, contacts, mesh, grasps, motion)


def _margin(pair: tuple[Row, Row]) -> tuple[float, str]:
    winner, loser = pair
    return (winner["epsilon_truth"] or 0.0) - (loser["epsilon_truth"] or 0.0), winner["key"]
