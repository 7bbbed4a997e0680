"""Regrasping: test grasps by touch; after a failure, find the object again and plan anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.spatial.distance import cdist

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import (
    Landmark,
    PoseTracker,
    RegionPolicy,
    Workspace,
    begin_again,
    explore_steps,
)
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.exploration.pose_tracking import doubted
from lis_grasp.exploration.probe_motions import surface_probe
from lis_grasp.exploration.registration import CONTACT_ERROR
from lis_grasp.geometry import unit
from lis_grasp.grasping.epsilon import robust_epsilon_on
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LOST_GRASPS, LiftOutcome
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.estimate import SurfaceEstimate
from lis_grasp.stages.lift import lift_object
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import (
    exploration_rng,
    make_perception,
    make_prober,
    make_strategy,
    true_pose,
)
from lis_grasp.typing import FloatArray

# Distance [m] in which grasps fail alike: the usual extent of an error of an estimate.
_ALIKE = 0.015
# Grasps that are planned after a failure, from which the next is chosen.
_MORE_GRASPS = 20
# Touches that a failed attempt is followed by, beside those that find the object again.
_MORE_TOUCHES = 4
# Probes without a result for each of these touches, before they are given up.
_PROBES_PER_TOUCH = 4
# Known contacts that may be touched again to find the object.
_TOUCHED_AGAIN = 48

# Closure of measured contacts above which the first grasp that is tested is lifted: of rounded
# fingertips, and of flat pads. Of five grasps each of 16 plans on development objects, by the
# four-finger hand, closure puts those that hold first in 94 % of pairs, predicted success in 84 %.
_FIRM_CLOSURE, _FIRM_CLOSURE_OF_JAWS = 0.03, 0.012

# Outcomes of grasps that hardly move the object, which is not searched for after them.
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


@dataclass(frozen=True, slots=True)
class Lesson:
    """What a failed attempt taught: what the hand felt, and the touches after it."""

    felt: int  #: contacts of the hand
    touched: int  #: contacts by touches after it; all that are known, if the object was lost
    probes: int  #: of these touches
    moved: float  #: where the object was found: the displacement of its frame [m]
    lost: bool  #: whether it was found somewhere else, earlier contacts unused


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One executed grasp, with the contacts and the estimate that it was planned on."""

    scenario: Scenario  #: before it, in the frame of the contacts
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

    After every other failure (`LOST_GRASPS`) and without a grasp, the attempt has ended, and the
    object rests somewhere. There it is found again by touch, and touched some more times
    (`touch_more`), as it is at the beginning if an end of it is unseen. A weighed mass replaces the
    prior. The next grasp is the likeliest to succeed if grasps like the failed ones fail too. The
    last grasp of the last of `Decide.attempts` is lifted without a check.

    Where the arm has no way to a grasp, or has to stop on it, the next grasp of the plan is
    executed instead, as part of the same attempt.

    The scenario is the one after the exploration (`Scenario.after`), with its contacts. The frame
    of contacts and grasps moves with the object, as believed. `stages` are repeated; None for
    `Stages`, which keep their results in memory.
    """
    stages, agent = stages or Stages(), scenario.agent
    failed: list[FloatArray] = []
    if _with_ends(scenario, contacts).agent.load_prior.toward:
        scenario, contacts, _ = stages.touch_more(scenario, contacts, moved=False)
    lifts, tests = agent.decide.attempts, agent.decide.closings
    while lifts:
        scenario = _with_ends(scenario, contacts)
        mesh = stages.estimate(scenario, contacts)
        search = stages.plan(scenario, mesh)
        attempt, check = Attempt(scenario, contacts, mesh, search, 0, None), None
        if tests or lifts > 1:
            check = _tactile_check(mesh, agent, tests / max(agent.decide.closings, 1))
        for rank in _likeliest_first(search, failed):
            outcome = stages.lift(scenario, search.grasps[rank], mesh, check)
            attempt = Attempt(scenario, contacts, mesh, search, rank, outcome)
            if outcome.reason not in _NEXT_GRASP or outcome.closed:
                break
            if outcome.duration > 0.0:
                scenario = scenario.moved(outcome.X_WO)
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
    """Return the scenario with the ends of the object in a region that no contact shows."""
    agent = scenario.agent
    ends = agent.unseen_ends(contacts)
    toward = tuple(tuple(float(x) for x in end.displacement) for end in ends)
    load = replace(agent.load_prior, toward=toward)
    return replace(scenario, agent=replace(agent, load_prior=load))


def _learned(attempt: Attempt, outcome: LiftOutcome) -> tuple[Scenario, Contacts]:
    """Return scenario and contacts after an attempt, where the fingers closed."""
    felt, scenario = outcome.measured_contacts, attempt.scenario.moved(outcome.X_WO)
    felt = replace(felt, free_radii=np.maximum(felt.free_radii - CONTACT_ERROR, 0.0))
    load, agent = scenario.agent.load_of(attempt.mesh), scenario.agent
    agent = agent.deciding(grasps=max(agent.decide.grasps, _MORE_GRASPS))
    # An object that was not lifted may be heavier: the table helped.
    if outcome.weighed is not None and (outcome.lifted or outcome.weighed > load.mass):
        load = replace(load, mass=outcome.weighed, mass_spread=0.0)
        agent = replace(agent, load_prior=load, mass_by_volume=False)
    return replace(scenario, agent=agent), attempt.contacts.append(felt)


def touch_more(
    scenario: Scenario, contacts: Contacts, *, moved: bool
) -> tuple[Scenario, Contacts, Lesson]:
    """Touch an object of known contacts some more times; if it has moved, find it first.

    An exploration is continued, of a free object, by simulated touches with forces. After a motion,
    known contacts are touched again and register the object (`PoseTracker`). If they contradict the
    contacts, it has toppled or is far away: it is explored anew, and the earlier contacts are used
    as soon as the new ones tell where they are.

    Returns the scenario and all contacts in the frame of the object where it was found, and counts.
    Without contacts, it was not found.
    """
    agent = scenario.agent
    if isinstance(agent.space, Workspace):
        space = replace(agent.space, support_height=agent.support_height)
        agent = replace(agent, space=space)
    again = np.unique(np.linspace(0, len(contacts) - 1, _TOUCHED_AGAIN).round()).astype(int)
    rest = contacts.subset(np.delete(np.arange(len(contacts)), again))
    tracker = PoseTracker(agent.robot.sensor.position_noise)
    perception = replace(make_perception(agent.perception, rest), tracker=tracker)
    surface, space = (
        perception.estimate(contacts),
        agent.known_space.grown(contacts).fitted_to(contacts),
    )
    landmarks = []
    for one in map(contacts.subset, again[:, None]):
        probe = surface_probe(one.points[0], one.normals[0], space, contacts, surface, ())
        landmarks.append(Landmark(probe, one))
    strategy = replace(make_strategy(agent), touches=None)
    if isinstance(strategy.policy, RegionPolicy):
        policy = replace(strategy.policy, landmarks=landmarks)
        strategy = replace(strategy, policy=policy)
    start = begin_again(perception, strategy, landmarks, doubted() if moved else PoseBelief.start())
    task = scenario.task.having(prober="dynamic", free=True, fingers="one")
    prober, rng = make_prober(replace(scenario, task=task)), exploration_rng(agent)
    rng.spawn(len(landmarks) + 1)  # the first generators are those of touches before
    touches = agent.decide.touches
    wanted, lost = len(landmarks) + _MORE_TOUCHES, False
    for state in explore_steps(prober, perception, strategy, rng=rng, start=start):
        probes = len(state.observations)
        for last in state.observations[-1:]:
            if last.is_lost or last.is_joined:
                wanted, lost = (touches if last.is_lost else 0), last.is_lost
        in_doubt = state.belief is not None and state.belief.trust == "doubted"
        made = len(state.contacts) >= wanted and not in_doubt
        if made or probes >= _PROBES_PER_TOUCH * (touches if lost else 2 * _MORE_TOUCHES):
            break
    X_EF = np.eye(4) if state.belief is None else state.belief.X_WE
    scenario, found = scenario.after(state.result, true_pose(prober)), state.known
    touched = len(found) - (0 if lost else len(contacts))
    distance = float(np.linalg.norm(X_EF[:3, 3]))
    return scenario, found, Lesson(0, touched, probes, distance, lost)


def _tactile_check(mesh: trimesh.Trimesh, agent: Agent, firmness: float) -> AcceptGrasp:
    """Return a check of measured contacts: a closure of more than a fraction of a firm one."""
    hand, friction = agent.hand, agent.load_prior.friction
    is_jaw = hand.kind == "parallel_jaw"
    least = firmness * (_FIRM_CLOSURE_OF_JAWS if is_jaw else _FIRM_CLOSURE)

    def accept_grasp(measured: Contacts) -> bool:
        if len(measured) < 2:
            return False
        points, normals = measured.points, measured.normals
        if is_jaw:
            points = _pushed_along_one_line(points, normals)
        return robust_epsilon_on(mesh, hand, points, normals, friction=friction) > least

    return accept_grasp


def _pushed_along_one_line(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return where two flat pads will push an object (2, 3) whose faces they touched at the ends.

    Closing pads turn the object until its faces lie on them (Brost 1988).
    """
    axis = unit(normals[1] - normals[0], least=1e-9)
    half_width = 0.5 * float((points[1] - points[0]) @ axis) * axis
    return np.asarray(points.mean(axis=0) + np.stack([-half_width, half_width]))


def _likeliest_first(search: GraspSearch, failed: Sequence[FloatArray]) -> list[int]:
    """Return the indices of all grasps, the likeliest to succeed first.

    A grasp fails with one that failed by the probability ``exp(-d^2 / 2 l^2)``, where d is the root
    mean square distance of the failed contacts from its nearest ones.
    """

    def failure(rank: int) -> float:
        grasp, success = search.grasps[rank], 1.0
        for points in failed:
            between = cdist(grasp.contact_points, points).min(axis=0)
            success *= 1.0 - np.exp(-0.5 * np.mean(between**2) / _ALIKE**2)
        return -success * grasp.quality.get("success_probability", 1.0) if failed else 0.0

    return sorted(range(len(search.grasps)), key=failure)
