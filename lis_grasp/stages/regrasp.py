"""Regrasping: test grasps by touch; after a failure, find the object again and plan anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.spatial.distance import cdist

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.registration import CONTACT_ERROR
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LOST_GRASPS, LiftOutcome
from lis_grasp.stages.estimate import SurfaceEstimate
from lis_grasp.stages.lift import lift_object
from lis_grasp.stages.load import KnownLoad
from lis_grasp.stages.place import with_place
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.tactile_check import tactile_check
from lis_grasp.stages.touching_again import Lesson, touch_more
from lis_grasp.typing import FloatArray

# Distance [m] within which grasps fail alike: the usual extent of an estimate's error.
_ALIKE = 0.015
# Number of grasps planned after a failure, from which the next is chosen.
_MORE_GRASPS = 20


# Outcomes of grasps that hardly move the object, so that no search follows.
_GENTLE = ("aborted", "set_down")
# Outcomes, before the hand closed, after which the next grasp of the same plan is executed.
_NEXT_GRASP = ("no_arm_motion", "out_of_arm_reach", "torque_limit", "arm_collision")


class Stages:
    """The stages that an attempt repeats, in memory."""

    def estimate(self, scenario: Scenario, contacts: Contacts) -> trimesh.Trimesh:
        """Return the mesh of the surface estimated from contacts."""
        return SurfaceEstimate(contacts, scenario.agent.perception).mesh

    def plan(self, scenario: Scenario, mesh: trimesh.Trimesh) -> GraspSearch:
        """Plan grasps on an estimate."""
        return plan_grasps(scenario.agent, mesh)

    def lift(
        self,
        scenario: Scenario,
        grasp: Grasp,
        mesh: trimesh.Trimesh,
        accept_grasp: AcceptGrasp | None,
    ) -> LiftOutcome:
        """Simulate the lift with a grasp that was planned on an estimate."""
        return lift_object(scenario, grasp, accept_grasp=accept_grasp, estimate=mesh)

    def touch_more(
        self, scenario: Scenario, contacts: Contacts, *, moved: bool
    ) -> tuple[Scenario, Contacts, Lesson]:
        """Find the object again, and touch it some more times; see `touch_more`."""
        return touch_more(scenario, contacts, moved=moved)


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One executed grasp, with the contacts and the estimate that it was planned on."""

    scenario: Scenario  #: before the attempt, in the frame of the contacts
    contacts: Contacts  #: all known before the attempt
    mesh: trimesh.Trimesh  #: the surface estimated from them, in O [m]
    search: GraspSearch  #: the grasps planned on it
    rank: int  #: of the executed grasp in the search
    outcome: LiftOutcome | None  #: of the lift; None if no grasp was found
    lesson: Lesson | None = None  #: of a failure, for the next attempt; None for the last


def grasp_with_tactile_check(
    scenario: Scenario, contacts: Contacts, stages: Stages | None = None
) -> Iterator[Attempt]:
    """Grasp and lift; after a failure, learn from it and try again.

    A grasp is tested before it is lifted: the fingers close and push gently. The measured contacts
    must be in firm force closure at half the friction; points at opposite ends of parallel faces
    count as opposite each other under flat pads. If they are not, if the hand hits the object
    during the approach, or if the object slips in the first centimetre of the lift, the hand opens
    and retreats. What it measured is added to the contacts, the object is hardly moved, and a grasp
    on the new estimate is tested. Each of `Decide.closings` tests asks for less; after them, force
    closure is enough.

    After every other failure (`LOST_GRASPS`), and without a grasp, the attempt has ended, and the
    object rests at an unknown pose. It is found again by touch, and touched some more times
    (`touch_more`); this also happens at the beginning if an end of it is unseen. A weighed mass
    replaces the prior. The next grasp is the likeliest to succeed if grasps like the failed ones
    fail, too. The last grasp of the last of `Decide.attempts` is lifted without a check.

    If the arm has no path to a grasp, or has to stop on it, the next grasp of the plan is
    executed instead, as part of the same attempt.

    The scenario is the one after the exploration (`Scenario.after`), with its contacts. The frame
    of contacts and grasps moves with the object, as believed. `stages` are repeated; None for
    `Stages`, which keep their results in memory.
    """
    scenario = with_place(scenario)
    stages, agent = stages or Stages(), scenario.agent
    failed: list[FloatArray] = []
    if _with_ends(scenario, contacts).agent.load.prior.toward:
        scenario, contacts, _ = stages.touch_more(scenario, contacts, moved=False)
    lifts, tests = agent.decide.attempts, agent.decide.closings
    while lifts:
        scenario = _with_ends(scenario, contacts)
        mesh = stages.estimate(scenario, contacts)
        search = stages.plan(scenario, mesh)
        attempt, check = Attempt(scenario, contacts, mesh, search, 0, None), None
        if tests or lifts > 1:
            check = tactile_check(mesh, agent, tests / max(agent.decide.closings, 1))
        for rank in _likeliest_first(search, failed):
            outcome = stages.lift(scenario, search.grasps[rank], mesh, check)
            attempt = Attempt(scenario, contacts, mesh, search, rank, outcome)
            if outcome.reason not in _NEXT_GRASP or outcome.closed:
                break
            if outcome.duration > 0.0:
                scenario = scenario.after_lift(outcome)
            yield attempt
        last = attempt.outcome
        is_test = bool(tests) and last is not None and last.reason in _GENTLE
        lifts, tests = lifts - (not is_test), tests - 1 if is_test else agent.decide.closings
        if not lifts or not (last is None or last.reason in LOST_GRASPS):
            if last is None or last.reason not in _NEXT_GRASP or last.closed:
                yield attempt
            return
        if last is not None:
            failed += [search.grasps[attempt.rank].contact_points] * last.closed
            scenario, contacts = _learned(attempt, last)
        felt = len(contacts) - len(attempt.contacts)
        lesson = Lesson(0, 0, 0, 0.0, lost=False)
        if not is_test:
            moved = last is not None
            scenario, contacts, lesson = stages.touch_more(scenario, contacts, moved=moved)
            failed = [] if lesson.lost else failed
        yield replace(attempt, lesson=replace(lesson, felt=felt))
        if not len(contacts):
            return


def _with_ends(scenario: Scenario, contacts: Contacts) -> Scenario:
    """Return the scenario with the ends, of an object in a region, that no contact shows."""
    agent = scenario.agent
    ends = agent.unseen_ends(contacts)
    toward = tuple(tuple(float(x) for x in end.displacement) for end in ends)
    load = replace(agent.load, prior=replace(agent.load.prior, toward=toward))
    return replace(scenario, agent=replace(agent, load=load))


def _learned(attempt: Attempt, outcome: LiftOutcome) -> tuple[Scenario, Contacts]:
    """Return scenario and contacts after an attempt in which the fingers closed."""
    felt, scenario = outcome.measured_contacts, attempt.scenario.after_lift(outcome)
    felt = replace(felt, free_radii=np.maximum(felt.free_radii - CONTACT_ERROR, 0.0))
    load, agent = scenario.agent.load.of_mesh(attempt.mesh), scenario.agent
    agent = agent.deciding(grasps=max(agent.decide.grasps, _MORE_GRASPS))
    # An object that was not lifted may be heavier, because the table carried a part.
    if outcome.weighed is not None and (outcome.lifted or outcome.weighed > load.mass):
        load = replace(load, mass=outcome.weighed, mass_spread=0.0)
        agent = replace(agent, load=KnownLoad(load))
    return replace(scenario, agent=agent), attempt.contacts.append(felt)


def _likeliest_first(search: GraspSearch, failed: Sequence[FloatArray]) -> list[int]:
    """Return the indices of all grasps, the likeliest to succeed first.

    A failed grasp makes another fail with probability ``exp(-d^2 / 2 l^2)``, where d is the root
    mean square distance of the failed contacts from the nearest ones of the other.
    """

    def failure(rank: int) -> float:
        grasp, success = search.grasps[rank], 1.0
        for points in failed:
            between = cdist(grasp.contact_points, points).min(axis=0)
            success *= 1.0 - np.exp(-0.5 * np.mean(between**2) / _ALIKE**2)
        return -success * grasp.quality.get("success_probability", 1.0) if failed else 0.0

    return sorted(range(len(search.grasps)), key=failure)
