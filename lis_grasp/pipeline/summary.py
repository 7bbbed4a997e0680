"""Summary lines of an exploration and of a run, in words, from the facts of their reports."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import Any

from lis_grasp.exceptions import counted
from lis_grasp.lifting.arm_use import violations
from lis_grasp.pipeline.reasons import lesson_sentence, lift_sentence, no_grasp_sentence
from lis_grasp.pipeline.report_json import motion_line

# Below this intersection over union the estimate is named as poor.
_LOW_IOU = 0.8
# Below this coverage more touches are advised.
_LOW_COVERAGE = 0.9


def exploration_lines(facts: dict[str, Any]) -> tuple[str, ...]:
    """Return the summary of an exploration, from the facts of `exploration_facts`."""
    made, asked = facts["contacts"], facts["asked"]
    lines = []
    search = facts.get("search")
    if search is not None:
        first = "found     after" if search["found"] else "found     nothing in the region after"
        probes = counted(search["probes"], "probe")
        lines.append(f"{first} {probes}, {search['seconds']:.0f} s of motion")
    lines += [f"touched   {made} of {asked} contacts, from {facts['probes']} probes"]
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
        advice = "" if truth >= _LOW_COVERAGE else "; more touches (`touches`) cover more"
        lines.append(f"covered   {' and '.join(parts)}, {within}{advice}")
    return tuple(lines)


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
        lines.append(f"attempt {number} {attempt['reason'].replace('_', ' ')}; then {taught}")
    if lift.get("grip_margin") is not None:
        margin = f"the grip was {lift['grip_margin']:.1f} times what the largest shake needs"
        lines.append(f"weighed   {lift['weighed']:.2g} kg; {margin}")
    if lift["held"]:
        lines.append(
            f"lifted    {lift['mass']:.3g} kg, and held through the shake;"
            f" slip {1e3 * lift['slip']:.1f} mm, turn {degrees(lift['turn']):.1f} deg"
        )
    else:
        lifted = "lifted, but not held" if lift["lifted"] else "not held"
        no_grasp = lift["reason"] == "no_grasp"
        why = no_grasp_sentence(grasps["rejections"]) if no_grasp else lift_sentence(lift["reason"])
        lines.append(f"{lifted}: {why}")
    if "arm" in report:
        lines.append(_arm_line(report))
    return tuple(lines)


def headline(report: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return the numbers of a run that matter most, each with what it is."""
    lift, predicted = report["lift"], report["attempts"][-1]["success_probability"]
    outcome = "held" if lift["held"] else lift["reason"].replace("_", " ")
    numbers = [(outcome, "lifted and shaken")]
    if report["surface"]["rmsd"] is not None:
        numbers.append((f"{1e3 * report['surface']['rmsd']:.1f} mm", "error of the estimate"))
    numbers.append((f"{report['touches']}", "touches"))
    if predicted is not None:
        numbers.append((f"{100 * predicted:.0f} %", "predicted success"))
    return tuple(numbers)


def _arm_line(report: Mapping[str, Any]) -> str:
    """Return the sentence about what touches and lifts demanded of the arm."""
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
    violated = violations(uses)
    steps = sum(use.get("steps", 0) for use in uses)
    if violated:
        line += f"; VIOLATED in {steps} steps: {'; '.join(violated)}"
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
