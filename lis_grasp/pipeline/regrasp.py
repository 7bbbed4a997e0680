"""Regrasping with a tactile check before the squeeze (`accept_grasp`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.planar_motion import planar_pose, register_motions
from lis_grasp.geometry import inverse_pose, unit
from lis_grasp.grasping.epsilon import robust_epsilon_on
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.lifting.trial import AcceptGrasp
from lis_grasp.pipeline.lifting_stage import lift
from lis_grasp.pipeline.scenario import Scenario
from lis_grasp.pipeline.stages import estimate, plan
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray

# Minimum distance [m] of new contacts to planned contacts at which a finger closed on nothing.
_MISSED_RADIUS = 0.01

# Outcomes after which another grasp is planned.
_TRIED_AGAIN = ("aborted", "set_down")

# Outcomes, before the hand closed, after which the next grasp of the same plan is executed.
_NEXT_GRASP = ("no_arm_motion", "out_of_arm_reach", "torque_limit", "arm_collision")


class Stages:
    """The stages that an attempt repeats, in memory."""

    def estimate(self, scenario: Scenario, contacts: Contacts) -> trimesh.Trimesh:
        """Return the mesh of the surface estimated from contacts."""
        return estimate(scenario.known, contacts)[1]

    def plan(self, scenario: Scenario, mesh: trimesh.Trimesh) -> GraspSearch:
        """Plan grasps on an estimate."""
        return plan(scenario.known, mesh)

    def lift(
        self,
        scenario: Scenario,
        grasp: Grasp,
        mesh: trimesh.Trimesh,
        accept_grasp: AcceptGrasp | None,
    ) -> LiftOutcome:
        """Simulate the lift with a grasp that was planned on an estimate."""
        return lift(scenario, grasp, accept_grasp=accept_grasp, estimate=mesh)


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One executed grasp, with the contacts and the estimate that it was planned on."""

    scenario: Scenario  #: before it, in the frame of the contacts
    contacts: Contacts  #: all known before the attempt
    mesh: trimesh.Trimesh  #: the surface estimated from them, in O [m]
    search: GraspSearch  #: the grasps planned on it
    rank: int  #: of the executed grasp in the search
    outcome: LiftOutcome | None  #: of the lift; None if no grasp was found


def grasp_with_tactile_check(
    scenario: Scenario, contacts: Contacts, stages: Stages | None = None
) -> Iterator[Attempt]:
    """Grasp and lift; after a failed tactile check, estimate and plan again with the new contacts.

    After the fingers close and before they squeeze, the measured contacts must be in force closure
    at half the friction; points at opposite ends of parallel faces count as opposite each other
    under flat pads. If they are not, or if the hand hits the object during the approach, the
    attempt is aborted: the hand opens and retreats, and its contacts are added to the known ones.
    An object that slips at the start of the lift is set down. The next grasp avoids places where a
    finger closed on nothing or slipped. The last of `Known.attempts` is executed without the
    check. Where the arm has no way to a grasp, or has to stop on it, the next grasp of the plan is
    executed instead, as part of the same attempt. An attempt may push the object. Its motions are
    estimated from the contacts of all attempts (`register_motions`), and the frame of contacts and
    grasps moves with it.

    The scenario is the one after the exploration (`Scenario.after`), with its contacts. `stages`
    are repeated; None for `Stages`, which keep their results in memory.
    """
    stages, known = stages or Stages(), scenario.known
    explored, missed = contacts, np.empty((0, 3))
    measured: list[Contacts] = []  # of each attempt, in the frame E of the explored ones
    first_estimate, X_EF = None, np.eye(4)  # F moves with the object, as believed
    for left in reversed(range(known.attempts)):
        mesh = stages.estimate(scenario, contacts)
        search = stages.plan(scenario, mesh)
        first_estimate = mesh if first_estimate is None else first_estimate
        if not search.grasps:
            yield Attempt(scenario, contacts, mesh, search, 0, None)
            return
        check = _tactile_check(mesh, known.hand, known.load.friction) if left else None
        for rank in _away_first(missed, search):
            grasp = search.grasps[rank]
            outcome = stages.lift(scenario, grasp, mesh, check)
            yield Attempt(scenario, contacts, mesh, search, rank, outcome)
            if outcome.reason not in _NEXT_GRASP or outcome.closed:
                break
            if outcome.duration > 0.0:
                scenario = scenario.moved(np.eye(4), outcome.X_WO)
        if outcome.reason not in _TRIED_AGAIN:
            return
        measured.append(outcome.measured_contacts.in_frame(inverse_pose(X_EF)))
        contacts, X_EG = _on_the_object(explored, measured, first_estimate)
        X_FG, X_EF = inverse_pose(X_EF) @ X_EG, X_EG
        scenario = scenario.moved(X_FG, outcome.X_WO)
        missed = np.vstack([missed, _missed(grasp, outcome)])


def _on_the_object(
    explored: Contacts, measured: Sequence[Contacts], mesh: trimesh.Trimesh
) -> tuple[Contacts, FloatArray]:
    """Return all contacts in the frame F that moved with the object, and its pose X_EF (4, 4).

    `measured` are those of each attempt, in the frame E of the explored ones and of their estimate.
    """
    contacts, X_EF = explored, np.eye(4)
    for new, displacement in zip(measured, register_motions(measured, mesh), strict=True):
        X_EF = planar_pose(displacement)
        contacts = contacts.append(new.in_frame(X_EF))
    return contacts, X_EF


def _tactile_check(
    mesh: trimesh.Trimesh, hand: Hand, friction: float
) -> Callable[[Contacts], bool]:
    def accept_grasp(measured: Contacts) -> bool:
        if len(measured) < 2:
            return False
        points, normals = measured.points, measured.normals
        if hand.kind == "parallel_jaw":
            points = _pushed_along_one_line(points, normals)
        return robust_epsilon_on(mesh, hand, points, normals, friction=friction) > 0.0

    return accept_grasp


def _pushed_along_one_line(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return where two flat pads will push an object (2, 3) whose faces they touched at the ends.

    Closing pads turn the object until its faces lie on them (Brost 1988).
    """
    axis = unit(normals[1] - normals[0], least=1e-9)
    half_width = 0.5 * float((points[1] - points[0]) @ axis) * axis
    return np.asarray(points.mean(axis=0) + np.stack([-half_width, half_width]))


def _missed(grasp: Grasp, outcome: LiftOutcome) -> FloatArray:
    """Return the planned contacts of fingers that slipped or closed on nothing, (K, 3) [m]."""
    if outcome.reason == "set_down":
        return grasp.contact_points
    if not outcome.closed:
        return np.empty((0, 3))
    return grasp.contact_points[
        [f not in outcome.measured_contacts.fingers for f in grasp.contact_fingers]
    ]


def _away_first(missed: FloatArray, search: GraspSearch) -> list[int]:
    """Return the indices of all grasps, those with no contact near a missed one first."""

    def is_near(rank: int) -> bool:
        points = search.grasps[rank].contact_points
        between = np.linalg.norm(points[:, None] - missed, axis=-1)
        return bool((between < _MISSED_RADIUS).any())

    return sorted(range(len(search.grasps)), key=is_near)
