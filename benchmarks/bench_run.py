"""Success rate of `lis-grasp run`: the object is lifted and held, for objects x seeds.

    python benchmarks/bench_run.py box cylinder mallet --seeds 3 --estimator patch

Options of `run` follow, such as `--known` for objects of known place and size, touched in the air.

Objects are built-in names or mesh files. Each run is a process of its own, as for a user. The
interval is the 95 % score interval (Wilson 1927).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % score interval of a proportion (Wilson 1927)."""
    z, p = 1.96, successes / trials
    center = (p + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z * np.sqrt(p * (1 - p) / trials + z**2 / (4 * trials**2)) / (1 + z**2 / trials)
    return center - half, center + half


def run(name: str, seed: int, options: list[str], output: Path) -> dict:
    command = [sys.executable, "-m", "lis_grasp.cli.main", "run", name, "--seed", str(seed)]
    subprocess.run([*command, *options, "--output", str(output)], check=True, capture_output=True)
    return json.loads((output / "report.json").read_text())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="+")
    parser.add_argument("--seeds", type=int, default=3)
    arguments, options = parser.parse_known_args()
    held = trials = 0
    print(
        f"{'object':24s} seed  rmsd  edge [mm]  epsilon: estimate  truth  slip [mm]  time [s]  lift"
    )
    for name in arguments.objects:
        for seed in range(arguments.seeds):
            with tempfile.TemporaryDirectory() as folder:
                report = run(name, seed, options, Path(folder))
            surface, grasps, lift = report["surface"], report["grasps"], report["lift"]
            trials += 1
            held += lift["held"]
            edge = surface["edge_rmsd"]
            slip = lift.get("slip")
            print(
                f"{report['object']:24s} {seed:4d} {1e3 * surface['rmsd']:5.2f}"
                f" {'-' if edge is None else f'{1e3 * edge:5.2f}':>10}"
                f" {grasps['best_epsilon_estimate'] or 0:18.3f}"
                f" {grasps['best_epsilon_truth'] or 0:6.3f}"
                f" {'-' if slip is None else f'{1e3 * slip:.1f}':>10}"
                f" {report['timings']['total']:9.1f}  {lift['reason']}",
                flush=True,
            )
    low, high = wilson(held, trials)
    print(f"held {held} of {trials} (95 % interval {100 * low:.0f} to {100 * high:.0f} %)")


if __name__ == "__main__":
    main()
