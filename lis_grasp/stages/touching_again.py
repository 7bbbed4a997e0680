"""Touches after a grasp: the object is found again, and touched some more times."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

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
from lis_grasp.exploration.prior import estimated_from
from lis_grasp.exploration.probe import end_at_home
from lis_grasp.exploration.probe_motions import surface_probe
from lis_grasp.exploration.strategy import PROBES_PER_TOUCH
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import (
    disturbance_by,
    exploration_rng,
    make_perception,
    make_prober,
    make_strategy,
    true_pose,
)

# Number of touches after a failed attempt, beside those that find the object again.
_MORE_TOUCHES = 4


# Most known contacts that may be touched again to find the object.
_TOUCHED_AGAIN = 48


@dataclass(frozen=True, slots=True)
class Lesson:
    """What a failed attempt taught: the hand's contacts, and the touches after it."""

    felt: int  #: contacts that the hand measured
    touched: int  #: contacts by touches after it; all that are known, if the object was lost
    probes: int  #: of these touches
    moved: float  #: displacement of the object's frame where it was found [m]
    lost: bool  #: whether it was found somewhere else, earlier contacts unused
    seconds: float = 0.0  #: of their motion


def touch_more(
    scenario: Scenario, contacts: Contacts, *, moved: bool
) -> tuple[Scenario, Contacts, Lesson]:
    """Touch an object of known contacts some more times; if it has moved, find it first.

    An exploration of a free object continues by simulated touches with forces. After a motion,
    known contacts are touched again and register the object (`PoseTracker`). If they contradict the
    contacts, it has toppled or is far away. Then it is explored anew, and the earlier contacts are
    used as soon as the new ones show where they are.

    Returns the scenario and all contacts in the frame of the found object, and counts.
    It was not found if there are no contacts.
    """
    agent = scenario.agent
    if isinstance(agent.space, Workspace):
        space = replace(agent.space, support_height=agent.support_height)
        agent = replace(agent, space=space)
    most = min(_TOUCHED_AGAIN, len(contacts))  # none after a view alone
    again = np.unique(np.linspace(0, len(contacts) - 1, most).round()).astype(int)
    rest = contacts.subset(np.delete(np.arange(len(contacts)), again))
    tracker = PoseTracker(agent.robot.sensor.position_noise)
    perception = make_perception(agent.perception, rest)
    perception = replace(perception, tracker=tracker, beside=agent.known_bodies)
    given = agent.perception.prior.given(contacts)
    known = given.seen.append(contacts)
    surface = estimated_from(perception.estimate, known, given)
    space = agent.known_space.grown(known).fitted_to(known)
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
    rng.spawn(len(landmarks) + 1)  # earlier touches had the first generators
    touches = agent.decide.touches
    wanted, lost = len(landmarks) + _MORE_TOUCHES, False
    for state in explore_steps(prober, perception, strategy, rng=rng, start=start):
        probes = len(state.observations)
        for last in state.observations[-1:]:
            if last.is_lost or last.is_joined:
                wanted, lost = (touches if last.is_lost else 0), last.is_lost
        in_doubt = state.belief is not None and state.belief.trust == "doubted"
        made = len(state.contacts) >= wanted and not in_doubt
        if made or probes >= PROBES_PER_TOUCH * (touches if lost else 2 * _MORE_TOUCHES):
            break
    X_EF = np.eye(4) if state.belief is None else state.belief.X_WE
    scenario = scenario.after(state.result, true_pose(prober), disturbance_by(prober))
    found = state.touched
    touched = len(found) - (0 if lost else len(contacts))
    distance = float(np.linalg.norm(X_EF[:3, 3]))
    seconds = state.duration + end_at_home(prober)
    return scenario, found, Lesson(0, touched, probes, distance, lost, seconds)
