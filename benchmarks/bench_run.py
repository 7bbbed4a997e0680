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
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from lis_grasp import shapes
from lis_grasp_studies.test_objects.shape_sets import TOOLS, build_shape


def run(name: str, seed: int, options: list[str], output: Path) -> dict | str:
    """Return the report of a run, done before or now, or the sentence with which it failed."""
    report = output / "report.json"
    if not report.exists():
        command = [sys.executable, "-m", "lis_grasp.cli.main", "run", name, "--seed", str(seed)]
        done = subprocess.run(
            [*command, *options, "--output", str(output)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            return done.stderr.strip().splitlines()[-1]
    return json.loads(report.read_text())


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
    parser.add_argument("--jobs", type=int, default=1, help="runs at once")
    parser.add_argument("--output", type=Path, help="keeps the results, and continues from them")
    arguments, options = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.output or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        trials = list(product(objects_of(arguments.objects, folder), range(arguments.seeds)))

        def one(trial: tuple[str, int]) -> dict | str:
            name, seed = trial
            return run(name, seed, options, folder / f"{Path(name).stem}-seed{seed}")

        reports = []
        print(
            "object                seed  touches  motion [s]  rmsd [mm]  slip [mm]  time [s]  lift"
        )
        with ThreadPoolExecutor(arguments.jobs) as pool:
            for (name, seed), report in zip(trials, pool.map(one, trials), strict=True):
                if isinstance(report, str):
                    print(f"{Path(name).stem:22s}{seed:4d}  {report}", flush=True)
                else:
                    reports.append(report)
                    print(line(report), flush=True)
    held = sum(report["lift"]["held"] for report in reports)
    low, high = binomtest(held, len(trials)).proportion_ci(method="wilson")
    print(f"held {held} of {len(trials)} (95 % interval {100 * low:.0f} to {100 * high:.0f} %)")
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
