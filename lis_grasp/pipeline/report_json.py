"""Run report: surface errors, grasp quality on estimate and true object, and the lift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.grasp_on_truth import epsilon_on_truth
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.evaluation.touch_coverage import reachable_coverage, touch_coverage, touch_radius
from lis_grasp.exploration import STEP_FRACTION, Exploration
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.pipeline.arm_station import station_facts
from lis_grasp.pipeline.object_motion import motion_facts, true_object
from lis_grasp.pipeline.object_setup import support_height, table_of
from lis_grasp.pipeline.regrasp import Attempt
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape, placed
from lis_grasp.version import __version__


def build_report(
    config: RunConfig,
    shape: Shape,
    hand: Hand,
    attempts: Sequence[Attempt],
    *,
    exploration: Exploration,
    station: Station | None = None,
    arm_use: ArmUse | None = None,
) -> dict[str, Any]:
    """Return the report of a run as plain values, in metres and seconds, without timings.

    Surface, grasps and lift are those of the last attempt.
    """
    last = attempts[-1]
    truth = shape if last.X_WO is None else placed(shape, last.X_WO)
    return {
        "version": __version__,
        "config": config.facts(),
        "object": shape.name,
        "hand": config.hand,
        **arm_facts(station, arm_use),
        "estimator": config.estimator,
        "seed": config.seed,
        "touches": len(exploration.contacts),
        "exploration": exploration_facts(config, shape, hand, exploration, last.mesh),
        "repairs": list(shape.repairs),
        "surface": _surface_facts(truth, last.contacts, last.mesh),
        "grasps": _grasp_facts(config, truth, hand, last.search),
        "attempts": [_attempt_facts(attempt) for attempt in attempts],
        "lift": lift_facts(last.outcome, mass=config.mass_of(shape.mesh)),
    }


def exploration_facts(
    config: RunConfig,
    shape: Shape,
    hand: Hand,
    exploration: Exploration,
    estimate: trimesh.Trimesh | None = None,
) -> dict[str, Any]:
    """Return what an exploration made of what was asked, and what it covered, as plain values.

    Covered is what is within `covered_radius` [m] of a contact on its side. The true surface is
    known in simulation only; exploration never uses it.
    """
    contacts = exploration.contacts
    truth = true_object(shape, exploration)
    radius = touch_radius(shape.mesh)
    tips = [posture.radius for posture in hand.probe_postures.values() if posture.radius > 0.0]
    return {
        "asked": config.touches,
        "contacts": len(contacts),
        "probes": len(exploration.outcomes),
        "ended": exploration.ended,
        "seconds": exploration.duration,
        "search": None if config.region is None else _search_facts(exploration),
        "motion": motion_facts(shape, exploration),
        "covered_radius": radius,
        "reachable_coverage": reachable_coverage(
            truth.mesh,
            contacts,
            tip_radius=min(tips, default=0.1 * radius),
            radius=radius,
            support_height=table_of(config, support_height(shape, config)),
        ),
        "estimate_coverage": None
        if estimate is None
        else touch_coverage(estimate, contacts, radius=radius),
    }


def _search_facts(exploration: Exploration) -> dict[str, Any]:
    """Return the number of probes and the time [s] up to the first contact, as plain values."""
    outcomes, seconds = exploration.outcomes, 0.0
    for number, outcome in enumerate(outcomes, start=1):
        seconds += outcome.duration
        if len(outcome.contacts):
            return {"found": True, "probes": number, "seconds": seconds}
    return {"found": False, "probes": len(outcomes), "seconds": seconds}


def _surface_facts(shape: Shape, contacts: Contacts, mesh: trimesh.Trimesh) -> dict[str, Any]:
    error = surface_error(mesh, shape, contacts, explored_radius=STEP_FRACTION * shape.size)
    return {
        **asdict(error),
        "triangles": len(mesh.faces),
        "watertight": bool(mesh.is_watertight),
    }


def _grasp_facts(
    config: RunConfig, shape: Shape, hand: Hand, search: GraspSearch
) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "number": len(search.grasps),
        "candidates": search.candidates,
        "rejections": dict(search.rejections),
        "best_epsilon_estimate": None,
        "best_epsilon_truth": None,
    }
    if search.grasps:
        best = search.grasps[0]
        facts["best_epsilon_estimate"] = best.quality["epsilon"]
        facts["best_epsilon_truth"] = epsilon_on_truth(
            best, shape.mesh, hand, friction=config.friction
        )
    return facts


def _attempt_facts(attempt: Attempt) -> dict[str, Any]:
    if attempt.outcome is None:
        return {
            "grasp": None,
            "success_probability": None,
            "measured_contacts": 0,
            "reason": "no_grasp",
        }
    return {
        "grasp": attempt.rank + 1,
        "success_probability": attempt.search.grasps[attempt.rank].quality["success_probability"],
        "measured_contacts": len(attempt.outcome.measured_contacts),
        "reason": attempt.outcome.reason,
        **_use_facts(attempt.outcome),
    }


def _use_facts(outcome: LiftOutcome) -> dict[str, Any]:
    return {} if outcome.arm is None else {"arm": asdict(outcome.arm)}


def arm_facts(station: Station | None, arm_use: ArmUse | None = None) -> dict[str, Any]:
    """Return arm, base, mount and use by touches as plain values; nothing without an arm."""
    if station is None:
        return {}
    facts = {"name": station.arm.name, "adapter": station.mount.adapter, **station_facts(station)}
    if arm_use is not None and arm_use.steps:
        facts["touches"] = asdict(arm_use)
    return {"arm": facts}


def lift_facts(outcome: LiftOutcome | None, *, mass: float) -> dict[str, Any]:
    """Return the outcome of a lift of a mass [kg] as plain values; None means no grasp found."""
    if outcome is None:
        return {"lifted": False, "held": False, "reason": "no_grasp", "mass": mass}
    return {
        "lifted": outcome.lifted,
        "held": outcome.held,
        "reason": outcome.reason,
        "mass": mass,
        "slip": outcome.slip,
        "turn": outcome.turn,
        "acceleration_survived": outcome.acceleration_survived,
        "simulated_seconds": outcome.duration,
        **_use_facts(outcome),
    }
