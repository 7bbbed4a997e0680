"""Compare grasps of lis_grasp and of FRoGGeR: same hand, objects, measures and lift simulation.

    python benchmarks/bench_frogger.py --frogger FOLDER --frogger-python PYTHON \\
        [box cylinder scan.ply ...] [--seeds 5] [--scenes table,free] [--output rows.jsonl]

FOLDER is a clone of FRoGGeR (github.com/alberthli/frogger; Li, Culbertson, Burdick and Ames, IROS
2023), PYTHON the interpreter of an environment with its dependencies. Without them lis_grasp runs
alone. Rows are appended to the output object by object, and the tables are of all rows in it. Lifts
are simulated in Drake and in MuJoCo. docs/frogger.md describes the comparison.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from peer_process import run_peer
from scipy.stats import binomtest, fisher_exact

from lis_grasp import shapes
from lis_grasp.geometry import make_pose
from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.epsilon import epsilon_on
from lis_grasp.grasping.force_closure import min_weight, resisted_force
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasp_ranking import GraspScorer
from lis_grasp.grasping.grasps import Grasp, LoadPrior
from lis_grasp.grasping.inverse_kinematics import solve_ik
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import model_path
from lis_grasp.simulation.drake.lift import simulate_lift as lift_in_drake
from lis_grasp.simulation.mujoco.lift import simulate_lift as lift_in_mujoco

OURS, THEIRS, FIXED = "lis_grasp", "FRoGGeR", "FRoGGeR, fixed"
PLANNERS = (OURS, THEIRS, FIXED)
SCENES = ("table", "free")
SIMULATORS = {"drake": lift_in_drake, "mujoco": lift_in_mujoco}
LIFTS = (*SIMULATORS, *(f"{name}_in_place" for name in SIMULATORS))  # keys of a row
# FRoGGeR's palm link begins at the wrist, ours where the fingers begin, along the same axes [m].
_WRIST_TO_FINGERS = 0.095
_OPENING = 0.02  # [m] of the pads before they close, as in ForceClosureSampler
_SAME_HAND = 1e-4  # [m] within which the fingertips of both models must agree
# Practically no approach: the trial begins with the opened hand at the grasp.
_IN_PLACE = LiftOptions(standoff=0.002, approach_time=0.05)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="*", default=list(shapes.NAMES))
    parser.add_argument("--frogger", type=Path, help="folder of a clone of FRoGGeR")
    parser.add_argument("--frogger-python", type=Path, default=Path(sys.executable))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--scenes", default="table,free")
    parser.add_argument("--friction", type=float, default=0.7)
    parser.add_argument("--mass", type=float, default=0.2, help="[kg]")
    parser.add_argument("--time-limit", type=float, default=60.0, help="of a grasp [s]")
    parser.add_argument("--output", type=Path, default=Path("frogger.jsonl"))
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):  # one core, for FRoGGeR's process too
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    hand = round_tipped_allegro()
    if options.frogger is None:
        print("FRoGGeR is left out: give a clone of it with --frogger FOLDER", file=sys.stderr)
    for name in options.objects:
        mesh = shapes.find(name).mesh
        # FRoGGeR first: if it cannot run, the benchmark ends at once with the reason.
        rows = their_rows(hand, mesh, options) if options.frogger else []
        rows += our_rows(hand, mesh, options)
        with options.output.open("a") as file:
            for row in rows:
                file.write(json.dumps({"object": Path(name).stem, **row}) + "\n")
        print(f"{name} done", file=sys.stderr, flush=True)
    print_tables([json.loads(line) for line in options.output.read_text().splitlines()])


def our_rows(hand: Hand, mesh: trimesh.Trimesh, options: argparse.Namespace) -> list[dict]:
    sampler = ForceClosureSampler(hand, friction=options.friction, mass=options.mass)
    rows = []
    for scene in options.scenes.split(","):
        support = float(mesh.bounds[0, 2]) if scene == "table" else None
        for seed in [2**31, *range(options.seeds)]:  # the first one warms up
            unprepared = mesh.copy()  # a mesh keeps what was computed from it
            cpu, wall = time.process_time(), time.perf_counter()
            rng = np.random.default_rng(seed)
            search = sampler.sample(unprepared, rng=rng, support_height=support, count=1)
            row = {"planner": OURS, "scene": scene, "seed": seed}
            row |= {"cpu": time.process_time() - cpu, "wall": time.perf_counter() - wall}
            if seed == 2**31:
                continue
            row["found"] = bool(search.grasps)
            if search.grasps:
                row |= evaluate(hand, mesh, search.grasps[0], scene, options)
            rows.append(row)
    return rows


def their_rows(hand: Hand, mesh: trimesh.Trimesh, options: argparse.Namespace) -> list[dict]:
    modes = [f"{s}{m}" for s in options.scenes.split(",") for m in ("", " fixed")]
    with tempfile.TemporaryDirectory() as folder:
        mesh.export(Path(folder) / "object.ply")
        job = {
            "mesh": str(Path(folder) / "object.ply"),
            "seeds": list(range(options.seeds)),
            "friction": options.friction,
            "time_limit": options.time_limit,
            "modes": modes,
        }
        source, python = options.frogger, options.frogger_python
        result = run_peer(job, Path(folder), name="FRoGGeR", source=source, python=python)
    rows = []
    for mode, plans in result["plans"].items():
        scene, fixed = mode.split()[0], mode.endswith("fixed")
        for plan in plans:
            row = {"planner": FIXED if fixed else THEIRS, "scene": scene}
            row |= {key: plan[key] for key in ("seed", "cpu", "wall", "starts", "found")}
            row["preparation"] = result["preparation"]
            if plan["found"]:
                planned = trimesh.proximity.closest_point(mesh, np.array(plan["planned_contacts"]))[
                    1
                ]
                row["planned_off"] = float(np.median(planned))
                grasp = their_grasp(hand, mesh, plan, options)
                row |= evaluate(hand, mesh, grasp, scene, options)
            rows.append(row)
    return rows


def round_tipped_allegro() -> Hand:
    """Return our Allegro-sized hand with the published fingertips, balls of 12 mm radius."""
    shipped = model_path("hands/allegro/allegro.yaml")
    urdf = shipped.with_suffix(".urdf").read_text("utf-8")
    nail = r"    <(visual|collision)>\s*<origin xyz=\"0.006 0 0.009\"/>.*?</\1>\n"
    urdf, nails = re.subn(nail, "", urdf, flags=re.DOTALL)
    urdf = urdf.replace('<sphere radius="0.006"/>', '<sphere radius="0.012"/>')
    urdf = urdf.replace('<cylinder radius="0.006"', '<cylinder radius="0.0105"')
    text = shipped.read_text("utf-8")
    pad = "center: [0.006, 0, 0.009], radius: 0.003"
    if nails != 8 or pad not in text:
        sys.exit("the fingertips of the shipped Allegro-sized hand must have nails of 3 mm radius")
    text = text.replace(pad, "center: [0, 0, 0], radius: 0.012")
    text = text.replace("axis: [0.7071, 0, 0.7071]", "axis: [0.894, 0, 0.447]")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "allegro.urdf").write_text(urdf, "utf-8")
        Path(folder, "allegro.yaml").write_text(text, "utf-8")
        return Hand.load(Path(folder, "allegro.yaml"))


def their_grasp(
    hand: Hand, mesh: trimesh.Trimesh, plan: dict, options: argparse.Namespace
) -> Grasp:
    """Return a posture of FRoGGeR's model as a grasp of ours; contacts are moved onto the mesh.

    FRoGGeR plans no opened posture, approach or forces: they are chosen as for our grasps. So are
    the qualities, of which the lift's grip force depends on ``load_per_grip``.
    """
    X_PL = make_pose(np.eye(3), [0.0, 0.0, _WRIST_TO_FINGERS])
    X_OH = np.array(plan["X_OP"]) @ X_PL @ hand.X_LH
    q = np.array(plan["joint_positions"])
    apart = np.abs(hand.pad_centers(X_OH, q) - np.array(plan["tips"])).max()
    if apart > _SAME_HAND:
        sys.exit(
            f"the fingertips of FRoGGeR's Allegro hand and ours must agree within"
            f" {1e3 * _SAME_HAND:g} mm to be compared; they are {1e3 * apart:.1f} mm apart"
        )
    q = np.clip(q, hand.lower, hand.upper)
    points, _, faces = trimesh.proximity.closest_point(mesh, np.array(plan["touches"]))
    normals = mesh.face_normals[faces]
    used = np.ones((1, 4), bool)
    batch = GraspBatch(points[None], normals[None], used, X_OH[None], q[None])
    away = replace(batch, points=batch.points + _OPENING * batch.normals)
    batch = replace(batch, opened=solve_ik(hand, away, palm_fixed=True).q)
    prior = LoadPrior(options.friction, options.mass)
    scorer = GraspScorer(hand, mesh, prior=prior, rng=np.random.default_rng(plan["seed"]))
    (grasp,) = scorer.plan_forces(scorer.predict_success(batch))
    return replace(grasp, accepted="by FRoGGeR")


def evaluate(
    hand: Hand, mesh: trimesh.Trimesh, grasp: Grasp, scene: str, options: argparse.Namespace
) -> dict:
    """Return the quality of a grasp on the true object and, above a table, the results of lifts."""
    points, normals, friction = grasp.contact_points, grasp.contact_normals, options.friction
    floor = float(mesh.bounds[0, 2])
    checker = HandCollisionChecker(
        hand, mesh, support_height=floor if scene == "table" else None, clearance=0.0
    )
    model = WrenchModel(friction, origin=mesh.center_mass)
    row = {
        "fingers": len(grasp.contact_fingers),
        "epsilon": epsilon_on(mesh, hand, points, normals, friction=friction),
        "weight": resisted_force(points, normals, (0.0, 0.0, 1.0), model),
        "min_weight": min_weight(points, normals, WrenchModel(friction)),
        "hits": checker.first_collision(grasp.X_OH, grasp.joint_positions, pads_may_touch=True),
    }
    if scene == "table":
        row |= lift_reasons(hand, mesh, grasp, options)
    return row


def lift_reasons(
    hand: Hand, mesh: trimesh.Trimesh, grasp: Grasp, options: argparse.Namespace
) -> dict:
    """Return how the lift ends in each simulator, and, if it fails, how it ends in place."""
    conditions = {"support_height": float(mesh.bounds[0, 2])}
    conditions |= {"mass": options.mass, "friction": options.friction}
    reasons = {}
    for name, simulate in SIMULATORS.items():
        for trial in (LiftOptions(), _IN_PLACE):
            outcome = simulate(LiftSetup(mesh, hand, grasp, options=trial, **conditions))
            reasons.setdefault(name, outcome.reason)
            reasons[f"{name}_in_place"] = outcome.reason
            if outcome.held:  # no second trial, without the approach, is needed
                break
    return reasons


def print_tables(rows: list[dict]) -> None:
    for scene in SCENES:
        here = [row for row in rows if row["scene"] == scene]
        if not here:
            continue
        print(
            f"\nScene: {scene}\n\n| object | planner | found | s, one core: median (quartiles)"
            " | epsilon | weight | min-weight | force closure | hits nothing | held, Drake"
            " | held, MuJoCo | in place, Drake | in place, MuJoCo |"
        )
        print("|---" * 13 + "|")
        for name in [None, *sorted({row["object"] for row in here})]:
            for planner in PLANNERS:
                chosen = [
                    row
                    for row in here
                    if row["planner"] == planner and name in (None, row["object"])
                ]
                if chosen:
                    print(f"| {name or 'all'} | {planner} | {line(chosen)} |")
    print()
    for planner in PLANNERS:
        mine = [row for row in rows if row["planner"] == planner and row["found"]]
        for key in LIFTS:
            if any(key in row for row in mine):
                print(f"{planner}, {key}: {lift_line(rows, planner, key)}")
        off = [row["planned_off"] for row in mine if "planned_off" in row]
        if off:
            print(f"{planner}: planned contacts are {1e3 * np.median(off):.1f} mm off the surface")
    print_agreement([row for row in rows if "mujoco" in row])


def lift_line(rows: list[dict], planner: str, key: str) -> str:
    """Return the rate held with its interval, the test against our rate, and all reasons."""
    table = []
    for name in (OURS, planner):
        ends = [row.get(key) for row in rows if row["planner"] == name and row["scene"] == "table"]
        table.append((ends.count("held"), len(ends) - ends.count("held")))
    held, lost = table[1]
    low, high = binomtest(held, held + lost).proportion_ci(method="wilson")
    test = f", p = {fisher_exact(table).pvalue:.3f} (Fisher's)" if planner != OURS else ""
    reasons = Counter(row[key] for row in rows if row["planner"] == planner and key in row)
    rate = f"{held} of {held + lost} held ({100 * low:.0f} to {100 * high:.0f} %)"
    return f"{rate}{test}; {dict(reasons)}"


def print_agreement(lifted: list[dict]) -> None:
    """Print on how many grasps the two simulators agree, and the others."""
    for planner in PLANNERS:
        mine = [row for row in lifted if row["planner"] == planner]
        differ = [row for row in mine if (row["drake"] == "held") != (row["mujoco"] == "held")]
        print(f"{planner}: the simulators agree on {len(mine) - len(differ)} of {len(mine)} lifts")
        for row in differ:
            print(f"  {row['object']}, seed {row['seed']}: {row['drake']}, {row['mujoco']}")


def line(rows: list[dict]) -> str:
    """Return the cells of one planner's rows."""
    low, mid, high = np.percentile([row["cpu"] for row in rows], [25, 50, 75])
    found = [row for row in rows if row["found"]]
    cells = [f"{len(found)}/{len(rows)}", f"{mid:.2f} ({low:.2f} to {high:.2f})"]
    for key in ("epsilon", "weight", "min_weight"):
        cells.append(f"{np.median([row[key] for row in found]):.3f}" if found else "-")
    cells.append(f"{sum(row['min_weight'] > 1e-9 for row in found)}/{len(found)}")
    cells.append(f"{sum(row['hits'] is None for row in found)}/{len(found)}")
    for key in LIFTS:
        lifts = [row[key] for row in found if key in row]
        cells.append(f"{lifts.count('held')}/{len(rows)}" if lifts else "-")
    return " | ".join(cells)


if __name__ == "__main__":
    main()
