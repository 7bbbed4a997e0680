"""Reports in words: summary lines of explorations and runs, sentences for their reason codes."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from types import MappingProxyType
from typing import Any

from lis_grasp.arms.use import violations
from lis_grasp.exceptions import counted
from lis_grasp.results.motion_times import times_line
from lis_grasp.results.placed import place_lines

PURPOSES: Mapping[str, str] = MappingProxyType(
    {
        "search": "to find the object",
        "extent": "for its ends",
        "repeat": "to track it",
        "policy": "by the policy",
    }
)
"""What probes are for, in words, by `Probe.purpose`."""

# Below this intersection over union the estimate is called poor.
_LOW_IOU = 0.8
# Below this coverage more touches are advised.
_LOW_COVERAGE = 0.9


def exploration_lines(facts: dict[str, Any]) -> tuple[str, ...]:
    """Return the summary of an exploration, from the facts of `exploration_facts`."""
    made, asked = facts.get("made", facts["contacts"]), facts["asked"]
    more = f" and {facts['contacts'] - made} at ends of slides" if facts["contacts"] > made else ""
    lines = []
    search = facts.get("search")
    if search is not None:
        first = "found     after" if search["found"] else "found     nothing in the region after"
        probes = counted(search["probes"], "probe")
        lines.append(f"{first} {probes}, {search['seconds']:.0f} s of motion")
    lines += [f"touched   {made} of {asked} contacts{more}, from {_probes(facts)}"]
    if made < asked:
        lines.append(f"ended     before {asked} contacts: {facts['ended']}")
    if facts.get("motion") is not None:
        lines.append(motion_line(facts["motion"]))
    within = f"within {1e3 * facts['covered_radius']:.0f} mm of a contact"
    truth = facts["reachable_coverage"]
    if truth is not None:
        parts = [f"{100 * truth:.0f} % of the reachable true surface"]
        if facts["estimate_coverage"] is not None:
            parts.append(f"{100 * facts['estimate_coverage']:.0f} % of the estimate")
        advice = "" if truth >= _LOW_COVERAGE else "; more touches cover more"
        lines.append(f"covered   {' and '.join(parts)}, {within}{advice}")
    return tuple(lines)


def _probes(facts: Mapping[str, Any]) -> str:
    """Return the number of probes, and what they were for, where a report has it."""
    purposes, probes = facts.get("purposes", {}), counted(facts["probes"], "probe")
    parts = [
        f"{purposes.get(key) or 'none'} {words}"
        for key, words in PURPOSES.items()
        if purposes.get(key) or key == "policy"
    ]
    return f"{probes}: {', '.join(parts)}" if len(parts) > 1 else probes


def motion_line(facts: dict[str, Any]) -> str:
    """Return the sentence about `motion_facts`."""
    line = (
        f"moved     ended {1e3 * facts['displacement']:.1f} mm from where it was; one touch moved"
        f" it by {1e3 * facts['largest_motion']:.1f} mm"
    )
    for name in ("tracking_error", "contact_error"):
        if facts[name] is not None:
            line += f"; {name.replace('_', ' ')} {1e3 * facts[name]:.2f} mm"
    line += "" if facts["tracked"] else "; not tracked"
    losses = facts["losses"]
    if losses:
        line += f"; lost {losses} time{'s' * (losses > 1)}, found again {facts['joined']}"
    return line


def run_lines(report: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the summary of a run, from its report."""
    surface, grasps, lift = report["surface"], report["grasps"], report["lift"]
    edge = surface["edge_rmsd"]
    edges = "" if edge is None else f", {1e3 * edge:.2f} mm at the edges"
    lines = [
        *exploration_lines(report["exploration"]),
        f"estimated rmsd {1e3 * surface['rmsd']:.2f} mm{edges}",
    ]
    lines += [f"doubted   {warning}" for warning in report.get("warnings", ())]
    lines += view_lines(report.get("views", {}))
    iou = surface["iou"]
    if iou is not None and iou < _LOW_IOU:
        lines.append(
            f"          only {iou:.2f} of its volume and the object's is common (IoU):"
            " untouched parts are guessed, and concavities that no finger enters are filled"
        )
    if grasps["number"]:
        lines.append(
            f"planned   {grasps['number']} grasps; epsilon of the best"
            f" {grasps['best_epsilon_estimate']:.3f} on the estimate,"
            f" {grasps['best_epsilon_truth']:.3f} on the true object"
        )
    else:
        lines.append("planned   no grasp found")
    for number, attempt in enumerate(report["attempts"][:-1], start=1):
        lesson = attempt.get("lesson")
        taught = "the next grasp" if lesson is None else lesson_sentence(lesson)
        lines.append(f"grasp {number} {attempt['reason'].replace('_', ' ')}; then {taught}")
    if lift.get("grip_margin") is not None:
        needed = "what the planned contacts need in the largest shake"
        margin = f"the grip was {lift['grip_margin']:.1f} times {needed}"
        lines.append(f"weighed   {lift['weighed']:.2g} kg; {margin}")
    if lift["held"]:
        lines.append(
            f"lifted    {lift['mass']:.3g} kg, and held through the shake;"
            f" slip {1e3 * lift['slip']:.1f} mm, turn {degrees(lift['turn']):.1f} deg"
        )
        lines += _pose_lines(lift)
    else:
        lifted = "lifted, but not held" if lift["lifted"] else "not held"
        no_grasp = lift["reason"] == "no_grasp"
        why = LIFT_REASONS.get(lift["reason"], lift["reason"])  # a later version's as is
        why = no_grasp_sentence(grasps["rejections"], grasps.get("hit_bodies")) if no_grasp else why
        lines.append(f"{lifted}: {why}")
    lines += place_lines(report) + _world_lines(report)
    if "motion" in report:  # older reports have none
        lines.append(times_line(report["motion"]))
    if "arm" in report:
        lines.append(_arm_line(report))
    return tuple(lines)


def view_lines(facts: Mapping[str, Any]) -> list[str]:
    """Return what cameras saw, and how certain its place is, if there was a camera."""
    if facts.get("dropped"):
        return [f"seen      not used: {facts['dropped']}"]
    if not facts:
        return []
    before, given = (1e3 * facts["deviation"][name] for name in ("before", "given"))
    pixels, touches = sum(facts["pixels"]), sum(facts["touches_of_seen_surface"])
    of_it = f"{touches} touch{'es' * (touches != 1)} of it"
    certain = f"known to {given:.1f} mm by the table and {of_it}"
    return [
        f"seen      by {counted(pixels, 'pixel')}; its place is {certain}, to {before:.1f} before"
    ]


def _pose_lines(lift: Mapping[str, Any]) -> list[str]:
    """Return how well the hand knows by touch where the object is in it, if it does."""
    facts = lift.get("pose_in_hand")
    if facts is None:
        return []
    known, off = (
        f"{1e3 * facts[name]['position']:.1f} mm and {degrees(facts[name]['angle']):.1f} deg"
        for name in ("band", "error")
    )
    return [f"in hand   known by touch to {known} (95 %); the error is {off}"]


def _world_lines(report: Mapping[str, Any]) -> list[str]:
    """Return which bodies beside the object the lifts pushed, and how far, if any."""
    facts = report.get("world", {}).get("lift", {})
    forces, moved = facts.get("forces", {}), facts.get("moved", {})
    pushed = []
    for name, force in forces.items():
        by = f", moved by {moved[name]:.1f} mm" if name in moved else ""
        pushed.append(f"{name} with {force:.1f} N{by}")
    return [f"pushed    {'; '.join(pushed)}"] if pushed else []


def headline(report: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return the most important numbers of a run, each with its meaning."""
    lift, predicted = report["lift"], report["attempts"][-1]["success_probability"]
    outcome = "held" if lift["held"] else lift["reason"].replace("_", " ")
    lifted = "lifted, but not held" if lift["lifted"] else "not held"
    numbers = [(outcome, "lifted and shaken" if lift["held"] else lifted)]
    if (place := report.get("place")) is not None:
        how = "stands as planned" if place["placed"] else "not placed"
        numbers.append((place["reason"].replace("_", " "), how))
    if report["surface"]["rmsd"] is not None:
        numbers.append((f"{1e3 * report['surface']['rmsd']:.1f} mm", "error of the estimate"))
    numbers.append((f"{report['touches']}", "touches"))
    times = report.get("motion", {})
    if times.get("until_lifted") is not None:
        numbers.append((f"{times['until_lifted']:.0f} s", "of motion until it was lifted"))
    if predicted is not None:
        numbers.append((f"{100 * predicted:.0f} %", "predicted success"))
    return tuple(numbers)


def _arm_line(report: Mapping[str, Any]) -> str:
    """Return the sentence about the demands of touches and lifts on the arm."""
    arm, lift = report["arm"], report["lift"].get("arm")
    lifts = [attempt.get("arm") for attempt in report["attempts"][:-1]]
    uses = [use for use in (arm.get("touches"), *lifts, lift) if use is not None]
    if not uses:
        return f"arm       {arm['name']}: it did not move in a simulation"
    effort, speed = (max(use[limit] for use in uses) for limit in ("effort", "speed"))
    line = (
        f"arm       {arm['name']}: at most {100 * effort:.0f} % of its efforts and"
        f" {100 * speed:.0f} % of its speeds"
    )
    if "touches" in arm:
        line += f"; touches of at most {arm['touches']['contact_force']:.1f} N"
    phases = {"touching": uses[: "touches" in arm], "lifting": uses["touches" in arm :]}
    said = {phase: "; ".join(violations(of_phase)) for phase, of_phase in phases.items()}
    violated = "; ".join(f"while {phase}: {what}" for phase, what in said.items() if what)
    steps = sum(use.get("steps", 0) for use in uses)
    if violated:
        line += f"; unwanted contacts or limits (of {steps} steps) {violated}"
    else:
        line += f"; unwanted contacts: none in {steps} steps"
    shakes = [] if lift is None else lift["shakes"]
    if shakes:
        least = min(shakes, key=lambda shake: shake["by_motion"] / shake["asked"])
        if least["by_motion"] < least["asked"]:
            line += (
                f"; shaken along {least['direction']} by {least['by_motion']:.1f} of"
                f" {least['asked']:.1f} m/s^2, the rest by forces on the object"
            )
    return line


LIFT_REASONS: Mapping[str, str] = MappingProxyType(
    {
        "held": "the object was lifted and held through the shake",
        "no_grasp": "no grasp was found",
        "unstable": "the object does not rest on the table by itself: turn its mesh so that it"
        " rests on a face",
        "collision_on_approach": "the opened hand hit the object during the approach: the"
        " estimate is too small there, so make more touches (`touches`), or try the next grasps"
        " (`best` of the lift)",
        "no_contact": "fewer than two fingers, or no cup, met the object: the estimate is too large"
        " there, so make more touches (`touches`)",
        "no_seal": "the suction cup's lip does not lie on the object all around: permit tests"
        " (`closings`), or make more touches (`touches`)",
        "pulled_off": "the suction cup's lip came off the object: try the next grasps"
        " (`best` of the lift), or a smaller `mass`",
        "set_down": "the object slipped at the start of the lift, or was weighed as too heavy for"
        " the grip, and the hand set it down: permit more attempts (`attempts`), or try a smaller"
        " `mass`",
        "aborted": "the tactile check rejected the grasp before the squeeze: permit more tests"
        " (`closings`), or make more touches (`touches`)",
        "ejected": "closing the fingers drove the object out of the hand: try the next grasps"
        " (`best` of the lift), or make more touches (`touches`)",
        "not_lifted": "the hand rose without the object: it slid out, or is too heavy for the"
        " grip; try the next grasps (`best` of the lift), or a smaller `mass`",
        "dropped": "the object was lifted and then lost: try the next grasps"
        " (`best` of the lift), or a smaller `mass`",
        "slipped": "the object is still in the hand, but moved too far in it: try the next grasps"
        " (`best` of the lift), or a smaller `mass`",
        "turned": "the object is still in the hand, but turned too far in it: try the next grasps"
        " (`best` of the lift), or a smaller `mass`",
        "no_arm_motion": "the arm has no collision-free path to the grasp: move its base (`base`)",
        "out_of_arm_reach": "a joint of the arm reached its limit during the motion: move its base"
        " (`base`)",
        "torque_limit": "a joint of the arm was at its largest effort for 50 ms: move its base"
        " nearer to the object (`base`), or try a smaller `mass`",
        "arm_collision": "a link of the arm touched something: move its base (`base`)",
        "hit_body": "the hand, or the object in it, pushed a body beside the object with more than"
        " 2 N (`world`): try the next grasps (`best` of the lift), or make room",
        "diverged": "the simulation failed: try the next grasps (`best` of the lift)",
    }
)
"""A sentence for every reason of `LiftOutcome`, and for ``no_grasp``."""

REJECTIONS: Mapping[str, str] = MappingProxyType(
    {
        "lower_than_fingertips": "the object is lower than this hand can pinch: its"
        " fingertips, on the table (`support`), would be at its upper edge or above; take thinner"
        " fingertips or a suction cup, or turn the object so that it is higher",
        "steep": "all reachable surface faces up or down: turn the object's mesh so that it stands"
        " higher, or take a suction cup",
        "no_opposing_surface": "there is no surface opposite a finger's contact that faces the"
        " other way: the object tapers, or is open there",
        "no_surface_for_a_finger": "opposite a finger's contact, there is no surface for every"
        " other finger: bring fingers side by side closer together in the hand's pregrasps",
        "no_flat_supported_surface": "no flat part of the surface is large and high enough for a"
        " pad, and touched if it is an estimate: turn the object so that it is higher, or make more"
        " touches (`touches`)",
        "no_seal": "the surface is too narrow or too curved for the suction cup's lip there",
        "no_force_closure": "the contacts could not resist every force: raise `friction`, or make"
        " more touches (`touches`)",
        "out_of_reach": "a finger does not get to its contact: the object is too wide or too narrow"
        " for this hand",
        "pad_does_not_face_the_surface": "a fingertip would touch with its edge, not its pad",
        "grasp_hits_object": "a link of the closed hand would be inside the object: check the pads"
        " (lis-grasp hand view), and name concave links under convex_parts in the hand's YAML",
        "grasp_hits_support": "a link of the closed hand would be inside the table: the object is"
        " low for this hand",
        "grasp_hits_obstacle": "a link of the closed hand would hit a body beside the object"
        " (`world`)",
        "lift_hits_obstacle": "the hand would hit a body in the lift or its shake, from 3 to 30 cm"
        " high (`world`): there must be room above the hand",
        "carried_hits_obstacle": "the object in the hand would hit a body in the lift or its shake,"
        " from 3 to 30 cm high (`world`): there must be room beside and above the object",
        "retreat_hits_obstacle": "the opened hand that lets go of a lost object would hit a body"
        " (`world`): there must be 12 cm behind the hand at the height of the lift",
        "grasp_hits_self": "two links of the closed hand would collide",
        "approach_hits_object": "the opened hand would hit the object during the approach: the"
        " object is wide for this hand's opening",
        "approach_hits_support": "the opened hand would hit the table during the approach: the"
        " object is low for this hand",
        "approach_hits_obstacle": "the opened hand would hit a body during the approach (`world`):"
        " there must be 12 cm behind the hand",
        "approach_hits_self": "two links of the opened hand would collide",
        "out_of_arm_reach": "the arm does not reach the pose of the hand: move its base, or turn"
        " the hand on the flange (mount in the hand's YAML)",
        "no_straight_arm_motion": "a joint limit of the arm ends the straight approach or lift:"
        " move its base",
        "no_collision_free_arm_path": "the arm finds no path from home to the approach: move its"
        " base",
        "arm_hits_object": "a link of the arm would hit the object",
        "arm_hits_table": "a link of the arm, or of the hand that it carries, would hit the table:"
        " put the arm's base higher",
        "arm_hits_obstacle": "a link of the arm, or of the hand that it carries, would hit a body"
        " beside the object (`world`)",
        "arm_hits_self": "a link of the arm would hit another, or the hand",
        "outranked": "other grasps were better",
    }
)
"""A sentence for every reason of rejection in `GraspSearch.rejections`."""


def lesson_sentence(lesson: Mapping[str, Any]) -> str:
    """Return what a failed attempt taught, from the fields of a `Lesson`."""
    felt, touched, probes = lesson["felt"], lesson["touched"], lesson["probes"]
    if not lesson["lost"] and not probes:
        return f"{felt} contacts felt; planned anew"
    where = f"found {1e3 * lesson['moved']:.0f} mm away"
    if lesson["lost"]:
        where = f"not where it was: explored anew, {touched} contacts" if touched else "not found"
    return f"{felt} contacts felt; {where}; {probes} probes, {touched} new contacts"


def no_grasp_sentence(
    rejections: Mapping[str, int], hit_bodies: Mapping[str, int] | None = None
) -> str:
    """Return that no grasp was found, and the commonest reason, with advice.

    The body that most candidates would hit is named, if there is one.
    """
    counts = {reason: count for reason, count in rejections.items() if count}
    if not counts:
        return f"{LIFT_REASONS['no_grasp']}: make more touches (`touches`)"
    most = max(counts, key=lambda reason: counts[reason])
    part = 100.0 * counts[most] / sum(counts.values())
    in_the_way = ""
    if hit_bodies:
        name = max(hit_bodies, key=lambda body: hit_bodies[body])
        in_the_way = f"; {name} was in the way of {counted(hit_bodies[name], 'candidate')}"
    return (
        f"{LIFT_REASONS['no_grasp']}; of the rejected candidates, {part:.0f} % because"
        f" {REJECTIONS.get(most, most)}{in_the_way}"
    )
