"""Compare grasps of lis_grasp and of SpringGrasp, planned on the same contacts.

    python benchmarks/bench_springgrasp.py --springgrasp FOLDER --springgrasp-python PYTHON \\
        [box cylinder scan.ply ...] [--seeds 2] [--output rows.jsonl]

FOLDER is a clone of SpringGrasp (github.com/Stanford-TML/SpringGrasp_release; Chen, Bohg and Liu,
RSS 2024), PYTHON the interpreter of an environment with its dependencies. Rows are appended to the
output, and what is there already is not run again. docs/springgrasp.md describes the comparison.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from bench_frogger import round_tipped_allegro
from peer_process import run_peer
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from springgrasp_lift import LiftedObject, Springs
from springgrasp_worker import TABLE

from lis_grasp import Contacts, Grasp, Hand, pipeline
from lis_grasp.exceptions import LisGraspError
from lis_grasp.grasping.contact_sets import ContactSets
from lis_grasp.grasping.grasp_ranking import GraspScorer
from lis_grasp.grasping.load_prior import LoadPrior
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.pipeline.run_config import SIMULATORS
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.shapes import STABLE
from lis_grasp.typing import FloatArray

OURS = ("blend", "gpis")
THEIRS = {"SpringGrasp": 0.0, "SpringGrasp, radius": 1.0}  # fraction of the tips' radius
_GRASPS = 5  # ranked, of which the first is executed: as in the studies
_OPENING = 0.02  # [m] of the pads before they close, as in ForceClosureSampler
_SAME_HAND = 1e-4  # [m] within which the fingertips of both models must agree
_IN_PLACE = LiftOptions(standoff=0.002, approach_time=0.05)  # as in bench_frogger.py
# SpringGrasp plans for a left hand, the mirror image of ours. Its joints that spread the fingers
# turn about the same axis as ours, all others in the mirrored direction.
_MIRROR = np.diag([1.0, -1.0, 1.0])
_SPREADING = [0, 4, 8]
_PALM_PITCH = 1.5708  # of its base link in its palm frame [rad]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="+", help="built-in shapes or mesh files")
    parser.add_argument("--springgrasp", type=Path, required=True, help="folder of a clone")
    parser.add_argument("--springgrasp-python", type=Path, default=Path(sys.executable))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--touches", type=int, default=40)
    parser.add_argument("--friction", type=float, default=0.8)
    parser.add_argument("--mass", type=float, default=0.2, help="[kg]")
    parser.add_argument("--iterations", type=int, default=200, help="of SpringGrasp")
    parser.add_argument("--planners", nargs="+", default=[*OURS, *THEIRS])
    parser.add_argument("--output", type=Path, default=Path("springgrasp.jsonl"))
    options = parser.parse_args()
    rows = read(options.output)
    for seed in range(options.seeds):
        for name in options.objects:
            facts = {"object": Path(name).stem, "seed": seed}
            known = {row["planner"] for row in rows if facts.items() <= row.items()}
            missing = [planner for planner in options.planners if planner not in known]
            if not missing:
                continue
            for row in rows_of(name, seed, missing, options):
                with options.output.open("a") as file:
                    file.write(json.dumps(facts | row) + "\n")
            print(f"{name} {seed} done", file=sys.stderr, flush=True)
    print_tables(read(options.output))


def read(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def rows_of(
    name: str, seed: int, planners: list[str], options: argparse.Namespace
) -> Iterator[dict]:
    """Yield a row for each planner, of grasps planned on the same contacts."""
    config = pipeline.RunConfig(
        object=name,
        pose=STABLE,
        prober="kinematic",
        position_noise=0.0005,
        normal_noise=float(np.radians(3.0)),
        touches=options.touches,
        seed=seed,
    )
    scenario = pipeline.Scenario.from_config(config, hand=Hand.load("allegro"))
    contacts = pipeline.touch(scenario).contacts
    hand = round_tipped_allegro()
    shape = scenario.truth.shape
    target = LiftedObject(shape.mesh, options.mass, options.friction)
    for planner in planners:
        try:
            if planner in OURS:
                row = our_row(planner, target, hand, contacts, scenario.known, options)
            else:
                row = their_row(planner, target, hand, contacts, seed, options)
        except LisGraspError as error:
            row = {"found": False, "failure": str(error)}
        yield {"planner": planner, "contacts": len(contacts)} | row


def our_row(
    estimator: str,
    target: LiftedObject,
    hand: Hand,
    contacts: Contacts,
    known: pipeline.Known,
    options: argparse.Namespace,
) -> dict:
    cpu, wall = time.process_time(), time.perf_counter()
    known = replace(known, estimator=estimator, hand=hand, grasps=_GRASPS)
    _, mesh = pipeline.estimate(known, contacts)
    estimated = time.process_time() - cpu
    load = LoadPrior(options.friction, options.mass)
    search = pipeline.plan(replace(known, load=load, mass_by_volume=False), mesh)
    row = {"cpu": time.process_time() - cpu, "wall": time.perf_counter() - wall}
    row |= {"cpu_estimate": estimated, "found": bool(search.grasps)}
    if not search.grasps:
        return row
    return row | lifts("trial", target, hand, search.grasps[0])


def their_row(
    planner: str,
    target: LiftedObject,
    hand: Hand,
    contacts: Contacts,
    seed: int,
    options: argparse.Namespace,
) -> dict:
    radius = THEIRS[planner] * hand.pads[0].radius
    X_WS = np.eye(4)  # frame of SpringGrasp's world, before it is mirrored
    X_WS[:2, 3] = contacts.points[:, :2].mean(axis=0)
    X_WS[2, 3] = -TABLE
    points = (contacts.points + radius * contacts.normals - X_WS[:3, 3]) @ _MIRROR
    job = {
        "points": points.tolist(),
        "friction": options.friction,
        "iterations": options.iterations,
        "seed": seed,
    }
    source, python = options.springgrasp, options.springgrasp_python
    with tempfile.TemporaryDirectory() as folder:
        result = run_peer(job, Path(folder), name="SpringGrasp", source=source, python=python)
    plans = [our_plan(hand, result, i, X_WS) for i in range(len(result["costs"]))]
    apart = max(plan["apart"] for plan in plans)
    if apart > _SAME_HAND:
        sys.exit(
            f"the fingertips of SpringGrasp's Allegro hand, mirrored, and ours must agree within"
            f" {1e3 * _SAME_HAND:g} mm to be compared; they are {1e3 * apart:.2f} mm apart"
        )
    row = {"cpu": result["cpu"], "wall": result["wall"], "apart": apart}
    plans = sorted((plan for plan in plans if plan["margin"] > 0.0), key=lambda p: p["cost"])
    row |= {"found": bool(plans), "feasible": len(plans)}
    if not plans:
        return row
    # Its arm planner avoids the table and the convex hull of the points.
    hull = trimesh.Trimesh(contacts.points).convex_hull
    checker = HandCollisionChecker(hand, hull, support_height=0.0, clearance=0.0)
    for plan in plans:
        postures(hand, plan)
        plan["hits"] = checker.first_collision(plan["X_WH"], plan["opened"])
    free = [plan for plan in plans if plan["hits"] is None]
    best = (free or plans)[0]
    row |= {"collision_free": len(free), "hits": best["hits"], "cost": best["cost"]}
    for name in ("beyond_limits", "tip_error", "target_error"):
        row[name] = best[name]
    row["depth"] = float(np.linalg.norm(best["targets"] - best["contacts"], axis=1).mean())
    prior = LoadPrior(options.friction, options.mass)
    scorer = GraspScorer(hand, hull, prior=prior, rng=np.random.default_rng(seed))
    grasp = their_grasp(hand, best, scorer)

    springs = Springs(best["tips"], best["targets"], best["springs"])
    pregrasp = replace(grasp, joint_positions=best["q"])
    return (
        row
        | lifts("trial", target, hand, grasp)
        | lifts("springs", target, hand, pregrasp, springs)
    )


def lifts(
    execution: str, target: LiftedObject, hand: Hand, grasp: Grasp, springs: Springs | None = None
) -> dict:
    """Return the reasons of lifts in each simulator, with the approach and without."""
    row = {}
    for simulator in SIMULATORS:
        for place, options in (("", LiftOptions()), ("_in_place", _IN_PLACE)):
            if row.get(f"{execution}_{simulator}") == "held":
                row[f"{execution}_{simulator}{place}"] = "held"  # without a second trial
                continue
            outcome = target.lift(simulator, hand, grasp, options, springs)
            row[f"{execution}_{simulator}{place}"] = outcome.reason
    return row


def our_plan(hand: Hand, result: dict, i: int, X_WS: FloatArray) -> dict:
    """Return one grasp of SpringGrasp, mirrored, for our hand and in W."""
    palm = np.array(result["palms"][i])
    X_SP = np.eye(4)
    X_SP[:3, :3] = _MIRROR @ Rotation.from_euler("XYZ", palm[3:]).as_matrix() @ _MIRROR
    X_SP[:3, 3] = _MIRROR @ palm[:3]
    X_PL = np.eye(4)
    X_PL[:3, :3] = Rotation.from_euler("y", _PALM_PITCH).as_matrix()
    X_WH = X_WS @ X_SP @ X_PL @ hand.X_LH
    q = np.array(result["joint_positions"][i])
    q[_SPREADING] *= -1.0
    plan = {
        name: np.array(result[name][i]) @ _MIRROR + X_WS[:3, 3]
        for name in ("tips", "contacts", "targets")
    }
    return plan | {
        "X_WH": X_WH,
        "q": q,
        "normals": np.array(result["normals"][i]) @ _MIRROR,
        "springs": np.array(result["springs"][i]),
        "cost": result["costs"][i],
        "margin": min(result["margins"][i]),
        "apart": float(np.abs(hand.pad_centers(X_WH, q) - plan["tips"]).max()),
    }


def postures(hand: Hand, plan: dict) -> None:
    """Add postures within the joint limits, which SpringGrasp does not know.

    Like its execution, they follow from positions of the fingertips: opened, pregrasp, targets.
    """
    X_WH, q = plan["X_WH"], plan["q"]
    plan["beyond_limits"] = float(np.maximum(hand.lower - q, q - hand.upper).max())
    tips, normals = plan["tips"], plan["normals"]
    height = np.sum(normals * (tips - plan["contacts"]), axis=1, keepdims=True)
    away = hand.pads[0].radius + _OPENING
    plan["q"], plan["tip_error"] = reach(hand, X_WH, q, tips)
    plan["opened"], _ = reach(
        hand, X_WH, plan["q"], tips + np.maximum(away - height, 0.0) * normals
    )
    plan["closed"], plan["target_error"] = reach(hand, X_WH, plan["q"], plan["targets"])


def reach(hand: Hand, X_WH: FloatArray, q: FloatArray, tips: FloatArray) -> tuple:
    """Return joint positions near q whose pad centres are at `tips`, and the largest error [m]."""

    def residuals(q: FloatArray) -> FloatArray:
        errors = 1e3 * (hand.pad_centers(X_WH, q) - tips).ravel()
        return np.concatenate([errors, 0.3 * (q - start)])

    start = np.clip(q, hand.lower + 1e-6, hand.upper - 1e-6)
    q = least_squares(residuals, start, bounds=(hand.lower, hand.upper), max_nfev=60).x
    return q, float(np.linalg.norm(hand.pad_centers(X_WH, q) - tips, axis=1).max())


def their_grasp(hand: Hand, plan: dict, scorer: GraspScorer) -> Grasp:
    """Return a plan as a grasp that closes from the opened posture towards the targets.

    The trial squeezes it as hard as its planned contacts need, like a grasp of ours.
    """
    used = np.ones((1, len(hand.pads)), dtype=bool)
    sets = ContactSets(plan["contacts"][None], plan["normals"][None], used)
    return Grasp(
        hand=hand.name,
        X_OH=plan["X_WH"],
        joint_names=hand.joint_names,
        joint_positions=plan["closed"],
        pregrasp_positions=plan["opened"],
        approach_O=plan["X_WH"][:3, :3] @ hand.approach_H,
        contact_points=plan["contacts"],
        contact_normals=plan["normals"],
        contact_fingers=hand.fingers,
        contact_forces=plan["springs"][:, None] * (plan["targets"] - plan["contacts"]),
        quality={"epsilon": 0.0, "load_per_grip": float(scorer.loads_per_grip(sets)[0])},
        accepted="by SpringGrasp",
    )


COLUMNS = [
    f"{execution}_{simulator}{place}"
    for execution in ("trial", "springs")
    for place in ("", "_in_place")
    for simulator in SIMULATORS
]


def print_tables(rows: list[dict]) -> None:
    print(f"| object | planner | found | s per grasp | {' | '.join(COLUMNS)} |")
    print("|---" * (4 + len(COLUMNS)) + "|")
    for name in [None, *sorted({row["object"] for row in rows})]:
        for planner in (*OURS, *THEIRS):
            chosen = [
                row for row in rows if row["planner"] == planner and name in (None, row["object"])
            ]
            if chosen:
                print(f"| {name or 'all'} | {planner} | {line(chosen)} |")
    for planner in (*OURS, *THEIRS):
        own = [row for row in rows if row["planner"] == planner]
        for key in COLUMNS:
            reasons = Counter(row[key] for row in own if key in row)
            if reasons:
                print(f"{planner}, {key}: {dict(reasons)}")


def line(rows: list[dict]) -> str:
    """Return the cells of one planner's rows."""
    times = [row["cpu"] for row in rows if "cpu" in row] or [np.nan]
    low, mid, high = np.percentile(times, [25, 50, 75])
    found = sum(row["found"] for row in rows)
    cells = [f"{found} of {len(rows)}", f"{mid:.1f} ({low:.1f} to {high:.1f})"]
    for key in COLUMNS:
        reasons = [row.get(key) for row in rows]
        executed = any(reason is not None for reason in reasons)
        cells.append(f"{reasons.count('held')} of {len(rows)}" if executed else "-")
    return " | ".join(cells)


if __name__ == "__main__":
    main()
