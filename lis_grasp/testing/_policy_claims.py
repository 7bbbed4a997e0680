"""Claims about an exploration policy."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.testing._known_surfaces import block, directions
from lis_grasp.testing._policy_subject import (
    PROBES,
    PolicySubject,
    Step,
    ask,
    prober_in,
    same,
    space_of,
)
from lis_grasp.testing.check import Claims, draws_globally
from lis_grasp.typing import FloatArray

CLAIMS = Claims()

_ASKED_AGAIN = (0, 1, 4, PROBES - 1)  # steps of an exploration
_LEAST_MOTION = 1e-3  # [m]
_TOUCHING = 0.3  # least fraction of probes that touch
_PLACES, _APART = 4, 0.1  # least places that are touched, and their distance in sizes
_REFUSED = 8  # probes in a row that are blocked
_ELSEWHERE, _SMALLER = np.array([0.6, -0.4, 0.3]), 0.5
_MANY, _SECONDS = 300, 20.0  # contacts, and processor time of a choice [s]


@CLAIMS.add("make an object with next_probe of a Workspace", "give the class __init__(self, space)")
def _makes_a_policy(of: PolicySubject) -> str:
    policy = of.policy(space_of(np.zeros(3)))
    has = callable(getattr(policy, "next_probe", None))
    return "" if has else f"it made a {type(policy).__name__} without next_probe"


@CLAIMS.add("return a Probe before the first touch", "touch the place that the workspace names")
def _first_probe(of: PolicySubject) -> str:
    chosen = of.on_table[0].chosen
    return "" if isinstance(chosen, Probe) else f"it returned {chosen!r}"


@CLAIMS.add("return a Probe, or None to end", "return lis_grasp.exploration.Probe(...)")
def _every_answer(of: PolicySubject) -> str:
    wrong = [s.chosen for s in of.on_table if not isinstance(s.chosen, Probe | None)]
    return f"it returned a {type(wrong[0]).__name__}" if wrong else ""


@CLAIMS.add(
    "choose the same probe from the same knowledge and generator", "draw from rng, and nowhere else"
)
def _repeatable(of: PolicySubject) -> str:
    for step in _some(of.on_table):
        again = ask(of.policy(space_of(np.zeros(3))), step.contacts, step.outcomes, step.seed)
        if not same(step.chosen, again):
            return f"after {len(step.outcomes)} probes, a new policy chose another one"
    return ""


@CLAIMS.add("keep no state from one call to the next", "take the past from contacts and outcomes")
def _keeps_no_state(of: PolicySubject) -> str:
    policy = of.policy(space_of(np.zeros(3)))
    for step in reversed(_some(of.on_table)):
        if not same(step.chosen, ask(policy, step.contacts, step.outcomes, step.seed)):
            return f"asked after a later question, it chose another probe {len(step.outcomes)}"
    return ""


@CLAIMS.add("leave the global random generator alone", "draw from rng, and nowhere else")
def _global_generator(of: PolicySubject) -> str:
    step = of.on_table[-1]

    def use() -> None:
        ask(of.policy(space_of(np.zeros(3))), step.contacts, step.outcomes, step.seed)

    return "it drew numbers from it" if draws_globally(use) else ""


@CLAIMS.add("leave the outcomes and contacts as they are", "work on a copy")
def _knowledge_unchanged(of: PolicySubject) -> str:
    step = of.on_table[-1]
    given, contacts = list(step.outcomes), replace(step.contacts)
    ask(of.policy(space_of(np.zeros(3))), contacts, given, step.seed)
    if [id(outcome) for outcome in given] != [id(outcome) for outcome in step.outcomes]:
        return "it changed the list of outcomes"
    fixed = contacts == step.contacts and not contacts.points.flags.writeable
    return "" if fixed else "the contacts were changed, or made writeable"


@CLAIMS.add("take outcomes as any sequence", "use indices and loops alone, no method of a list")
def _outcomes_in_a_list(of: PolicySubject) -> str:
    step = of.on_table[-1]
    chosen = ask(of.policy(space_of(np.zeros(3))), step.contacts, [*step.outcomes], step.seed)
    return "" if same(chosen, step.chosen) else "a list gave another probe than a tuple"


@CLAIMS.add(
    "pass through the ball of radius `space.radius` about `space.center`",
    "aim at a point of the workspace",
)
def _aims_at_the_object(of: PolicySubject) -> str:
    return _beside(of.on_table, space_of(np.zeros(3)))


@CLAIMS.add(
    "start outside of the object and above the table",
    "make the standoff longer: space.approach_distance(point, direction) leads out of the ball",
)
def _starts_in_free_space(of: PolicySubject) -> str:
    prober = prober_in(space_of(np.zeros(3)))
    outcomes = [prober.probe(probe) for probe in _probes(of.on_table)]
    bad = [o.reason for o in outcomes if o.status == "blocked" and o.reason.endswith("start")]
    return f"{bad[0]} of {len(bad)} of {len(outcomes)} probes" if bad else ""


@CLAIMS.add("move", "give the probe a standoff and an overshoot above 0")
def _moves(of: PolicySubject) -> str:
    short = [p for p in _probes(of.on_table) if p.standoff + p.overshoot < _LEAST_MOTION]
    return f"{len(short)} probes are shorter than {1e3 * _LEAST_MOTION:g} mm" if short else ""


@CLAIMS.add(
    f"touch the block with {100 * _TOUCHING:g} % of its probes",
    "aim at the estimated surface, or at the middle of the workspace",
)
def _touches(of: PolicySubject) -> str:
    return _seldom(of.on_table, space_of(np.zeros(3)))


@CLAIMS.add("touch different places", "aim where no contact is near")
def _touches_different_places(of: PolicySubject) -> str:
    space = space_of(np.zeros(3))
    contacts = _contacts(of.on_table, space)
    places: list[FloatArray] = []
    for point in contacts:
        if all(np.linalg.norm(point - other) > _APART * space.size for other in places):
            places.append(point)
    if len(places) >= _PLACES:
        return ""
    far = pdist(contacts).max(initial=0.0) if len(contacts) > 1 else 0.0
    return f"{len(of.on_table)} probes touched {len(places)}, at most {1e3 * far:.0f} mm apart"


@CLAIMS.add(
    "not return a probe that was blocked", "leave out targets among the outcomes, or draw from rng"
)
def _blocked_probes(of: PolicySubject) -> str:
    policy, step = of.policy(space_of(np.zeros(3))), of.on_table[-1]
    outcomes = list(step.outcomes)
    for k in range(_REFUSED):
        chosen = ask(policy, step.contacts, outcomes, 100 + k)
        if chosen is None:
            break
        refused = outcomes[len(step.outcomes) :]
        if any(same(chosen, outcome.probe) for outcome in refused):
            return f"it returned a probe again after {len(refused)} were blocked"
        outcomes.append(ProbeOutcome(chosen, "blocked", reason="no room"))
    return ""


@CLAIMS.add("not return a probe that missed", "leave out targets among the outcomes")
def _missed_probes(of: PolicySubject) -> str:
    policy, outcomes = of.policy(space_of(np.zeros(3))), list[ProbeOutcome]()
    for k in range(_REFUSED):
        chosen = ask(policy, Contacts.empty(), outcomes, 100 + k)
        if chosen is None:
            break
        if any(same(chosen, outcome.probe) for outcome in outcomes):
            return f"it returned a probe again after {len(outcomes)} that touched nothing"
        outcomes.append(ProbeOutcome(chosen, "missed"))
    return ""


@CLAIMS.add("work anywhere in space", "use space.center, not the origin")
def _works_elsewhere(of: PolicySubject) -> str:
    space = space_of(_ELSEWHERE)
    steps = of.explored(space)
    return _beside(steps, space) or _seldom(steps, space)


@CLAIMS.add("work at any size", "measure lengths in space.size or space.step")
def _works_at_another_size(of: PolicySubject) -> str:
    space = space_of(np.zeros(3), scale=_SMALLER)
    steps = of.explored(space)
    return _beside(steps, space) or _seldom(steps, space)


@CLAIMS.add("work without a table", "expect space.support_height to be None")
def _works_without_a_table(of: PolicySubject) -> str:
    space = space_of(np.zeros(3), table=False)
    steps = of.explored(space)
    return _beside(steps, space) or _seldom(steps, space)


def _asked(of: PolicySubject, contacts: Contacts, outcomes: Sequence[ProbeOutcome] = ()) -> str:
    space = space_of(np.zeros(3))
    chosen = ask(of.policy(space), contacts, outcomes, 0)
    if not isinstance(chosen, Probe | None):
        return f"it returned a {type(chosen).__name__}"
    return _beside([Step(contacts, (), 0, chosen)], space)


@CLAIMS.add("choose a probe after one contact", "use no statistic that one contact lacks")
def _one_contact(of: PolicySubject) -> str:
    return _asked(of, block().subset([0]))


@CLAIMS.add("take contacts that no probe made", "do not pair contacts with outcomes")
def _contacts_from_elsewhere(of: PolicySubject) -> str:
    return _asked(of, block())


@CLAIMS.add("go on when all contacts were lost", "expect outcomes without contacts")
def _lost_contacts(of: PolicySubject) -> str:
    return _asked(of, Contacts.empty(), of.on_table[-1].outcomes)


@CLAIMS.add(
    f"choose among {_MANY} contacts within {_SECONDS:g} s of processor time",
    "query neighbours by a tree",
)
def _many_contacts(of: PolicySubject) -> str:
    ways = directions(_MANY)
    half = block().bounds[1]
    scale = np.min(half / np.maximum(np.abs(ways), 1e-9), axis=1)
    points = scale[:, None] * ways
    face = np.argmin(half / np.maximum(np.abs(ways), 1e-9), axis=1)
    normals = np.sign(np.take_along_axis(ways, face[:, None], axis=1)) * np.eye(3)[face]
    start = time.process_time()
    found = _asked(of, Contacts(points, normals))
    spent = time.process_time() - start
    return found or (f"it took {spent:.0f} s" if spent > _SECONDS else "")


def _some(steps: Sequence[Step]) -> list[Step]:
    return [steps[k] for k in _ASKED_AGAIN if k < len(steps)]


def _probes(steps: Sequence[Step]) -> list[Probe]:
    return [step.chosen for step in steps if isinstance(step.chosen, Probe)]


def _contacts(steps: Sequence[Step], space: Workspace) -> FloatArray:
    prober = prober_in(space)
    found = [prober.probe(probe).contacts.points for probe in _probes(steps)]
    return np.concatenate([np.empty((0, 3)), *found])


def _seldom(steps: Sequence[Step], space: Workspace) -> str:
    """Return that too few probes touch; else empty."""
    probes = _probes(steps)
    touched = len(_contacts(steps, space))
    enough = probes and touched >= _TOUCHING * len(probes)
    return "" if enough else f"{touched} of {len(probes)} probes touched it"


def _beside(steps: Sequence[Step], space: Workspace) -> str:
    """Return how many probes do not pass through the object's ball; else empty."""
    bad, probes = 0, _probes(steps)
    for probe in probes:
        along = float((space.center - probe.start) @ probe.direction)
        along = min(max(along, 0.0), probe.standoff + probe.overshoot)
        nearest = probe.start + along * probe.direction
        bad += int(np.linalg.norm(nearest - space.center) > space.radius)
    return f"{bad} of {len(probes)} probes do not" if bad else ""
