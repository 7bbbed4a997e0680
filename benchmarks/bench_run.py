"""Success rate of `lis-grasp run`: the object is lifted and held, for objects x seeds.

    python benchmarks/bench_run.py box cylinder mallet --seeds 3 --estimator patch

Options of `run` follow, such as `--known` for objects of known place and size, touched in the air.

Objects are built-in names, mesh files, or names of test objects of the studies; `tools` stands for
eight tools and flat things. Each run is a process of its own, as for a user. The
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

from lis_grasp import shapes
from lis_grasp.experiments.test_objects.shape_sets import TOOLS, build_shape


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % score interval of a proportion (Wilson 1927)."""
    z, p = 1.96, successes / trials
    center = (p + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z * np.sqrt(p * (1 - p) / trials + z**2 / (4 * trials**2)) / (1 + z**2 / trials)
    return center - half, center + half


def run(name: str, seed: int, options: list[str], output: Path) -> dict | str:
    """Return the report of a run, or the sentence with which it failed."""
    command = [sys.executable, "-m", "lis_grasp.cli.main", "run", name, "--seed", str(seed)]
    done = subprocess.run(
        [*command, *options, "--output", str(output)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        return done.stderr.strip().splitlines()[-1]
    return json.loads((output / "report.json").read_text())


def objects_of(names: list[str], folder: Path) -> list[str]:
    """Return built-in names and paths of mesh files; test objects are written to a folder."""
    found = []
    for name in names:
        for one in TOOLS if name == "tools" else (name,):
            if one in shapes.NAMES or Path(one).suffix:
                found.append(one)
                continue
            path = folder / f"{one}.stl"
            build_shape(one).mesh.export(path)
            found.append(str(path))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="+")
    parser.add_argument("--seeds", type=int, default=3)
    arguments, options = parser.parse_known_args()
    print("object                seed  touches  motion [s]  rmsd [mm]  slip [mm]  time [s]  lift")
    reports = []
    trials = held = 0
    with tempfile.TemporaryDirectory() as meshes:
        for name in objects_of(arguments.objects, Path(meshes)):
            for seed in range(arguments.seeds):
                with tempfile.TemporaryDirectory() as folder:
                    report = run(name, seed, options, Path(folder))
                trials += 1
                if isinstance(report, str):
                    print(f"{Path(name).stem:22s}{seed:4d}  {report}", flush=True)
                    continue
                reports.append(report)
                held += report["lift"]["held"]
                print(line(report), flush=True)
    low, high = wilson(held, trials)
    print(f"held {held} of {trials} (95 % interval {100 * low:.0f} to {100 * high:.0f} %)")
    for title, unit, factor, value in (
        ("touches", "", 1.0, lambda r: r["exploration"]["contacts"]),
        ("hand motion", " s", 1.0, lambda r: r["exploration"]["seconds"]),
        ("rmsd", " mm", 1e3, lambda r: r["surface"]["rmsd"]),
        ("time", " s", 1.0, lambda r: r["timings"]["total"]),
    ):
        print(f"median {title}: {factor * np.median([value(r) for r in reports]):.3g}{unit}")


def line(report: dict) -> str:
    """Return one line of the table."""
    lift, touched = report["lift"], report["exploration"]
    slip = "-" if lift.get("slip") is None else f"{1e3 * lift['slip']:.1f}"
    return (
        f"{report['object']:22s}{report['seed']:4d}  {touched['contacts']:7d}"
        f"  {touched['seconds']:10.0f}  {1e3 * report['surface']['rmsd']:9.2f}  {slip:>9}"
        f"  {report['timings']['total']:8.1f}  {lift['reason']}"
    )


if __name__ == "__main__":
    main()
