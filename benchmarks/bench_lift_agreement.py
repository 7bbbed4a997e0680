"""Agreement of simulated lifts with those of another commit, on the same stored grasps.

    python benchmarks/bench_lift_agreement.py FOLDER --than d082f28

Plans grasps on the true built-in shapes, and simulates the lift of each with both commits' code and
time steps. As a yardstick, the other commit repeats a part of its trials with the object 0.1 mm
aside, and with half the time step. All is stored in the folder; called again, it continues, so give
a changed package another folder. Trials with equal slip may not test a change at all: the gripper
touches with flat fingers, and does not feel a change of round tips.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from lis_grasp import ForceClosureSampler, Hand, shapes
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.simulation.drake.lift import simulate_lift

_HERE = Path(__file__).parents[1]
_MOVED = np.array([0.6e-4, 0.8e-4, 0.0])  # [m]


def plan(folder: Path, hands: list[str], names: list[str], seeds: int) -> None:
    """Store the grasps of each hand on each shape."""
    for name in hands:
        sampler = ForceClosureSampler(Hand.load(name))
        for shape in names:
            mesh = shapes.build(shape).mesh
            for seed in range(seeds):
                path = folder / f"{name}-{shape}-{seed}.json"
                if not path.exists():
                    height, rng = float(mesh.bounds[0, 2]), np.random.default_rng(seed)
                    sampler.sample(mesh, rng=rng, support_height=height).save(path)


def simulate(
    folder: Path,
    out: Path,
    best: int,
    masses: list[float],
    *,
    moved: bool,
    step: float | None,
    every: int,
) -> None:
    """Append the outcome of every n-th trial of the stored grasps to a file of JSON lines."""
    done = len(out.read_text().splitlines()) if out.exists() else 0
    trials = [
        (path, rank, mass)
        for path in sorted(folder.glob("*-*-*.json"))
        for rank in range(min(best, len(GraspSearch.load(path).grasps)))
        for mass in masses
    ]
    X_WO = np.eye(4)
    X_WO[:3, 3] = moved * _MOVED
    for path, rank, mass in trials[::every][done:]:
        name, shape, _ = path.stem.split("-")
        mesh, hand = shapes.build(shape).mesh, Hand.load(name)
        height, grasp = float(mesh.bounds[0, 2]), GraspSearch.load(path).grasps[rank]
        start = time.process_time()
        outcome = simulate_lift(
            LiftSetup(
                mesh,
                hand,
                grasp,
                support_height=height,
                mass=mass,
                X_WO=X_WO,
                options=LiftOptions() if step is None else LiftOptions(time_step=step),
            )
        )
        row = {
            "trial": f"{path.stem} grasp {rank + 1} {mass} kg",
            "reason": outcome.reason,
            "slip": 1e3 * outcome.slip,  # [mm]
            "turn": _turn(outcome, hand),
            "survived": outcome.acceleration_survived,
            "seconds": time.process_time() - start,
        }
        with out.open("a") as file:
            file.write(json.dumps(row) + "\n")


def _turn(outcome: LiftOutcome, hand: Hand) -> float:
    """Return the rotation of the object in the hand from its recorded start to its end [deg]."""
    poses = outcome.motion.poses
    R = [
        poses[hand.base_link][i][:3, :3].T @ poses["object"][i][:3, :3] for i in (0, -1)
    ]  # (3, 3) each
    return float(np.degrees(np.arccos(np.clip((np.trace(R[0].T @ R[1]) - 1.0) / 2.0, -1.0, 1.0))))


def compare(label: str, first: dict[str, dict], second: dict[str, dict]) -> None:
    """Print how often two sets of outcomes agree, and each disagreement."""
    pairs = [(first[name], row) for name, row in second.items() if name in first]
    held = Counter((a["reason"] == "held", b["reason"] == "held") for a, b in pairs)
    same = sum(a["reason"] == b["reason"] for a, b in pairs)
    equal = sum(a["slip"] == b["slip"] for a, b in pairs)
    print(f"{label}: {len(pairs)} trials; {same} with the same reason, {equal} with equal slip")
    print(f"  held by both {held[True, True]}, by the first only {held[True, False]},", end=" ")
    print(f"by the second only {held[False, True]}, by neither {held[False, False]}")
    for quantity, unit in (("slip", "mm"), ("turn", "deg")):
        both = [
            (a[quantity], b[quantity]) for a, b in pairs if a["reason"] == b["reason"] == "held"
        ]
        if not both:
            continue
        a, b = np.array(both).T  # (N,) each
        change = b - a
        print(
            f"  {quantity} of held ones [{unit}]: median {np.median(a):.3f} and {np.median(b):.3f};"
            f" change: mean {change.mean():+.3f}, median {np.median(change):+.4f}, 90 % within"
            f" {np.quantile(np.abs(change), 0.9):.3f}, larger in {np.mean(change > 0):.0%}"
        )
    used = [sum(row["seconds"] for row in rows) for rows in zip(*pairs, strict=True)]
    print(f"  processor time {used[0]:.0f} s and {used[1]:.0f} s: ratio {used[0] / used[1]:.2f}")
    for a, b in pairs:
        if a["reason"] != b["reason"]:
            print(
                f"  {a['trial']:38} {a['reason']:>22} slip {a['slip']:6.2f} survived"
                f" {a['survived']:.1f} | {b['reason']} slip {b['slip']:.2f} survived"
                f" {b['survived']:.1f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--than", metavar="COMMIT", default="HEAD", help="the other commit")
    parser.add_argument("--hands", default="allegro,wsg50")
    parser.add_argument("--shapes", default=",".join(shapes.NAMES))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--best", type=int, default=3, help="grasps to lift of each search")
    parser.add_argument("--masses", default="0.2,0.5", help="[kg], separated by commas")
    parser.add_argument("--yardstick", type=int, default=3, help="repeat every n-th trial")
    parser.add_argument("--step", type=float, help="time step of this commit's lifts [s]")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    folder = options.folder
    settings = {
        "than": {"moved": False, "step": None, "every": 1},
        "now": {"moved": False, "step": options.step, "every": 1},
        "moved": {"moved": True, "step": None, "every": options.yardstick},
        "finer": {"moved": False, "step": 0.0025, "every": options.yardstick},
    }
    if options.worker:
        out = folder / f"{options.worker}.jsonl"
        masses = [float(mass) for mass in options.masses.split(",")]
        simulate(folder, out, options.best, masses, **settings[options.worker])
        return
    folder.mkdir(parents=True, exist_ok=True)
    plan(folder, options.hands.split(","), options.shapes.split(","), options.seeds)
    other = folder / "source"
    if not other.exists():
        archive = subprocess.run(
            ["git", "archive", options.than], cwd=_HERE, check=True, capture_output=True
        )
        other.mkdir()
        subprocess.run(["tar", "-x", "-C", str(other)], input=archive.stdout, check=True)
    rows = {}
    for name in settings:
        source = _HERE if name == "now" else other
        environment = os.environ | {"PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
        command = [sys.executable, __file__, str(folder), "--worker", name]
        command += ["--best", str(options.best), "--masses", options.masses]
        command += ["--yardstick", str(options.yardstick)]
        if options.step is not None:
            command += ["--step", str(options.step)]
        subprocess.run(command, check=True, env=environment)
        lines = (folder / f"{name}.jsonl").read_text().splitlines()
        rows[name] = {row["trial"]: row for row in map(json.loads, lines)}
    compare("this commit", rows["than"], rows["now"])
    compare("yardstick: object moved by 0.1 mm", rows["than"], rows["moved"])
    compare("yardstick: time steps of 2.5 ms", rows["than"], rows["finer"])


if __name__ == "__main__":
    main()
