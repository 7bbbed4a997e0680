"""Run report: surface errors, grasp quality on estimate and true object, and the lift."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.arms.use import ArmUse
from lis_grasp.evaluation.grasp_on_truth import epsilon_on_truth
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.evaluation.touch_coverage import reachable_coverage, touch_coverage, touch_radius
from lis_grasp.exploration import STEP_FRACTION, Exploration, Region
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.results.motion_times import motion_times
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.stages.configured_arm import station_facts
from lis_grasp.stages.regrasp import Attempt
from lis_grasp.stages.scenario import Scenario
from lis_grasp.version import __version__

# Number of points on the true surface that measure the tracking error.
_SAMPLES = 2000


def build_report(
    scenario: Scenario,
    exploration: Exploration,
    attempts: Sequence[Attempt],
    arm_use: ArmUse | None = None,
) -> dict[str, Any]:
    """Return the report of a run as plain values, in metres and seconds, without timings.

    Surface, grasps and lift are from the last attempt. `scenario` is the one after the
    exploration, `arm_use` the demands of touches on the arm.
    """
    task, last = scenario.task, attempts[-1]
    return {
        "version": __version__,
        "config": task.facts(),
        "object": scenario.truth.shape.name,
        "hand": task.robot.hand,
        **arm_facts(scenario.agent.station, arm_use),
        "estimator": task.decide.estimator,
        "seed": task.seed,
        "touches": exploration.made,
        "exploration": exploration_facts(scenario, exploration, last.mesh),
        "repairs": list(scenario.truth.shape.repairs),
        "surface": _surface_facts(last),
        "grasps": _grasp_facts(last),
        "attempts": [_attempt_facts(attempt) for attempt in attempts],
        "motion": motion_times(exploration, attempts),
        "lift": lift_facts(last.outcome, mass=scenario.truth.mass),
        **place_facts(last.scenario, last.outcome),
        **world_facts(attempts),
        **view_facts(scenario, exploration),
    }


def exploration_facts(
    scenario: Scenario, exploration: Exploration, estimate: trimesh.Trimesh | None = None
) -> dict[str, Any]:
    """Return the touches made and wanted, and the covered surface, as plain values.

    `scenario` is the one after the exploration. Surface within `covered_radius` [m] of a contact on
    its side is covered. The true surface is known in simulation only; exploration never uses it.
    """
    contacts, agent = exploration.contacts, scenario.agent
    shape = scenario.truth.shape
    truth = scenario.truth.shape_now
    radius = touch_radius(shape.mesh)
    tips = [p.radius for p in agent.hand.probe_postures.values() if p.radius > 0.0]
    return {
        "asked": agent.decide.touches,
        "made": exploration.made,
        "contacts": len(contacts),
        "probes": len(exploration.outcomes),
        "purposes": Counter(outcome.probe.purpose for outcome in exploration.outcomes),
        "ended": exploration.ended,
        "seconds": exploration.duration,
        "search": _search_facts(exploration) if isinstance(agent.space, Region) else None,
        "motion": motion_facts(scenario, exploration),
        # Contacts that were given to known bodies beside the object, by their names.
        **({"attributed": dict(exploration.touched_beside)} if len(agent.surroundings) else {}),
        "covered_radius": radius,
        "reachable_coverage": reachable_coverage(
            truth.mesh,
            contacts,
            tip_radius=min(tips, default=0.1 * radius),
            radius=radius,
            support_height=agent.perception.support_height,
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


def _surface_facts(attempt: Attempt) -> dict[str, Any]:
    shape, mesh = attempt.scenario.truth.shape_now, attempt.mesh
    radius = STEP_FRACTION * shape.size
    error = surface_error(mesh, shape, attempt.contacts, explored_radius=radius)
    return {
        **asdict(error),
        "triangles": len(mesh.faces),
        "watertight": bool(mesh.is_watertight),
    }


def _grasp_facts(attempt: Attempt) -> dict[str, Any]:
    search, truth = attempt.search, attempt.scenario.truth
    facts: dict[str, Any] = {
        "number": len(search.grasps),
        "candidates": search.candidates,
        "rejections": dict(search.rejections),
        **({"hit_bodies": dict(search.hit_bodies)} if search.hit_bodies else {}),
        "best_epsilon_estimate": None,
        "best_epsilon_truth": None,
    }
    if search.grasps:
        best, mesh = search.grasps[0], truth.shape_now.mesh
        facts["best_epsilon_estimate"] = best.quality["epsilon"]
        facts["best_epsilon_truth"] = epsilon_on_truth(
            best, mesh, attempt.scenario.agent.hand, friction=truth.friction
        )
    return facts


def _attempt_facts(attempt: Attempt) -> dict[str, Any]:
    outcome = attempt.outcome
    grasp = None if outcome is None else attempt.search.grasps[attempt.rank]
    return {
        "grasp": None if grasp is None else attempt.rank + 1,
        "success_probability": None if grasp is None else grasp.quality["success_probability"],
        "family": None if grasp is None else grasp.family,
        "measured_contacts": 0 if outcome is None else len(outcome.measured_contacts),
        "reason": "no_grasp" if outcome is None else outcome.reason,
        **({} if attempt.lesson is None else {"lesson": asdict(attempt.lesson)}),
        **({} if outcome is None else _use_facts(outcome)),
    }


def view_facts(scenario: Scenario, exploration: Exploration) -> dict[str, Any]:
    """Return what cameras saw of the object, given its touches; nothing without a camera.

    `deviation` [m] is that of the place of the seen surface by the camera's pose, `given` by touch
    and table, `before` by the prior alone; `dropped` says why the views were not used.
    """
    agent, task = scenario.agent, scenario.task
    if not task.sees:
        return {}
    if agent.views is None:
        return {"views": {"dropped": "the object was lost"}}
    known = agent.views.given(exploration.contacts)
    facts = {
        "number": len(known.views),
        "pixels": [int(view.object_mask.sum()) for view in known.views],
        "touches_of_seen_surface": [one.touches for one in known.calibrations],
        "deviation": {"before": agent.views.displacement, "given": known.displacement},
        "dropped": known.reason or None,
    }
    return {"views": facts}


def world_facts(attempts: Sequence[Attempt]) -> dict[str, Any]:
    """Return what touches and lifts did to the bodies beside the object; nothing without bodies.

    By name: `contacts` of touches, `forces`, the largest [N], and `moved`, how far free bodies
    moved, all together [mm].
    """
    truth = attempts[-1].scenario.truth  # before the last grasp
    if not len(truth.surroundings):
        return {}
    touch = {
        "forces": dict(sorted(truth.disturbance.forces.items())),
        "contacts": dict(sorted(truth.disturbance.contacts.items())),
        "moved": {name: 1e3 * moved for name, moved in sorted(truth.pushed.items())},
    }
    forces: dict[str, float] = {}
    moved: dict[str, float] = {}
    for attempt in attempts:
        outcome = attempt.outcome
        for name, force in ({} if outcome is None else outcome.forces).items():
            forces[name] = max(force, forces.get(name, 0.0))
        for body in attempt.scenario.truth.surroundings.free:
            after = None if outcome is None else outcome.X_EB.get(body.name)
            distance = 0.0 if after is None else 1e3 * body.displacement(after)
            moved[body.name] = moved.get(body.name, 0.0) + distance
    return {"world": {"touch": touch, "lift": {"forces": forces, "moved": moved}}}


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
    """Return the outcome of a lift of a mass [kg] as plain values; None without a grasp."""
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
        "weighed": outcome.weighed,
        "grip_margin": outcome.grip_margin,
        **_pose_facts(outcome),
        **({"forces": dict(outcome.forces)} if outcome.forces else {}),
        **_use_facts(outcome),
    }


def _pose_facts(outcome: LiftOutcome) -> dict[str, Any]:
    """Return the pose of the object in the palm as felt, its band, and its error [m, rad]."""
    pose, errors = outcome.pose_in_hand, outcome.pose_error
    if pose is None or errors is None:
        return {}
    bands = {"position": pose.position_band, "angle": pose.angle_band}
    known = {"X_HO": pose.X_HO.tolist(), "band": bands, "covariance": pose.covariance.tolist()}
    return {"pose_in_hand": {**known, "error": dict(zip(bands, errors, strict=True))}}


def ranked_facts(rank: int, scenario: Scenario, outcome: LiftOutcome) -> dict[str, Any]:
    """Return what became of the lift, and of the placing, with a grasp of a rank from 1."""
    lifted = lift_facts(outcome, mass=scenario.truth.mass)
    return {"rank": rank, **lifted, **place_facts(scenario, outcome)}


def place_facts(scenario: Scenario, outcome: LiftOutcome | None) -> dict[str, Any]:
    """Return what became of an object that was to be placed, as plain values; nothing for others.

    `moved` [m] and `turned` [rad] are from the planned pose of the true object, ``planned.X_EO``.
    """
    if scenario.agent.decide.place is None:
        return {}
    made = None if outcome is None else outcome.place
    if made is None:
        return {"place": {"placed": False, "reason": "not_held"}}
    planned: dict[str, Any] | None = None
    if made.plan is not None:
        planned = {
            "X_EO": (made.plan.motion @ scenario.truth.X_EO).tolist(),
            "stands": made.plan.stands,
            "band": made.plan.band,
            "gaps": dict(made.plan.gaps),
        }
    errors = {"moved": made.moved, "turned": made.turned, "leaning": made.leaning}
    placed = {"placed": made.placed, "reason": made.reason}
    return {"place": {**placed, **errors, "felt": made.felt, "planned": planned}}


def motion_facts(scenario: Scenario, exploration: Exploration) -> dict[str, Any] | None:
    """Return how far touches moved a free object, and the tracking error, as plain values.

    `displacement` [m] is that of the centre of its box overall, `largest_motion` [m] that of any
    point by one touch. `tracking_error` [m] is the mean distance of the true surface from the same
    surface at the believed pose: 0 for motions that leave the surface in place. It is None after
    a loss, which begins another map, until both are joined. `contact_error` [m] is the root mean
    square distance of the contacts from the true surface at its current pose. `scenario` is the
    one after the exploration. None for a fixed object.
    """
    if not scenario.task.world.is_free or not exploration.observations:
        return None
    shape, X_EO = scenario.truth.shape, scenario.truth.X_EO
    beliefs = [o.belief for o in exploration.observations if o.belief is not None]
    X_WE = beliefs[-1].X_WE if beliefs else np.eye(4)
    center = shape.mesh.bounds.mean(axis=0)
    moved = trimesh.transform_points(center[None], X_WE @ X_EO)[0] - center
    points, _ = trimesh.sample.sample_surface(shape.mesh, _SAMPLES, seed=0)
    off, _ = distances_to_mesh(apply_pose(X_EO, points), shape.mesh)
    now = apply_pose(inverse_pose(X_EO), exploration.contacts.points)
    misplaced = distances_to_mesh(now, shape.mesh)[0] if len(now) else None
    losses = sum(belief.trust == "lost" for belief in beliefs)
    found = sum(belief.joined is not None for belief in beliefs)
    return {
        "displacement": float(np.linalg.norm(moved)),
        "largest_motion": max(outcome.moved for outcome in exploration.outcomes),
        "tracked": bool(beliefs),
        "tracking_error": None if losses > found else float(off.mean()),
        "contact_error": None if misplaced is None else float(np.sqrt(np.mean(misplaced**2))),
        "repeated_probes": sum(belief.repeated for belief in beliefs),
        "losses": losses,
        "joined": found,
    }
