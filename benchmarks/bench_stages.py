"""Time of each stage of `lis-grasp run`, what it is spent on, and the ratio to another commit.

    python benchmarks/bench_stages.py box mallet --than 6b40c02 --only-now=--known

Runs of both commits alternate, each in a process of its own with one thread. Options that this
benchmark does not know go to `lis-grasp run` of both. `--known` was the condition of all runs
before it was an option. Times are medians of wall time [s], so other work on the machine counts;
"processor" is the time of all stages without it. What a stage is spent on is from one more run
under cProfile, as fractions of its processor time; kinds may contain one another, as fits evaluate
surfaces.
"""

from __future__ import annotations

import argparse
import json
import os
import pstats
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

_HERE = Path(__file__).parents[1]

# Kinds of work by file and function; their cumulative times are added up.
_KINDS = {
    "physics": (("<built-in", "AdvanceTo"),),
    "surface fits": (("surfaces/", "from_contacts"),),
    "surface evaluation": (("surfaces/", "evaluate"), ("surfaces/", "gradient")),
    "meshing": (("meshing/extraction.py", "extract_mesh"),),
    "next touch": (("exploration/policy.py", "next_probe"),),
    "inverse kinematics": (("grasping/inverse_kinematics.py", "solve_ik"),),
    "collision": (("hands/collision.py", "first_collisions"), ("hands/collision.py", "nearest")),
    "epsilon": (("grasping/expanding_polytope.py", "inscribed_ball_radii"),),
    "page": (("visualization/run_scene.py", "write_scene_of"),),
    "imports": (("<frozen importlib._bootstrap>", "_find_and_load"),),
}


def run(source: Path, name: str, options: list[str], profile: Path | None = None) -> dict:
    """Return the times of a run with the package in a folder, and write its profile."""
    environment = os.environ | {"PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    profiler = [] if profile is None else ["-m", "cProfile", "-o", str(profile)]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, *profiler, "-m", "lis_grasp.cli.main", "run", name, *options]
        start, used = time.perf_counter(), _processor_time()
        # Elsewhere, because `python -m` prefers the package of the current folder.
        done = subprocess.run(
            [*command, "--output", folder],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
        )
        seconds = time.perf_counter() - start
        if done.returncode:
            sys.exit(f"{name} failed: {done.stderr.strip().splitlines()[-1]}")
        times = json.loads((Path(folder) / "report.json").read_text())["timings"]
    times["start"] = seconds - times.pop("total")
    return times | {"all": seconds, "processor": _processor_time() - used}


def _processor_time() -> float:
    """Return the processor time of all processes started so far [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def spent(profile: Path) -> dict[str, float]:
    """Return the fraction of a run's time that each kind of work takes."""
    stats = pstats.Stats(str(profile)).stats  # type: ignore[attr-defined]
    total = sum(own for _, _, own, _, _ in stats.values())
    fractions = {}
    for kind, places in _KINDS.items():
        found = {
            place: (callers, inclusive)
            for place, (_, _, _, inclusive, callers) in stats.items()
            if any(part in f"{place[0]} {place[2]}" and word in place[2] for part, word in places)
        }
        # Calls from one of the same kind are part of its time already.
        nested = sum(
            times[3]
            for callers, _ in found.values()
            for caller, times in callers.items()
            if caller in found
        )
        fractions[kind] = (sum(time for _, time in found.values()) - nested) / total
    return fractions


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="+")
    parser.add_argument("--than", metavar="COMMIT", help="compare with this commit")
    parser.add_argument(
        "--only-now",
        action="append",
        default=[],
        metavar="OPTION",
        help="an option of `run` that the other commit does not have",
    )
    parser.add_argument("--rounds", type=int, default=3)
    arguments, options = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        sources = {"now": _HERE}
        if arguments.than:
            sources["than"] = Path(folder) / "than"
            archive = subprocess.run(
                ["git", "archive", arguments.than], cwd=_HERE, check=True, capture_output=True
            )
            sources["than"].mkdir()
            unpack = ["tar", "-x", "-C", str(sources["than"])]
            subprocess.run(unpack, input=archive.stdout, check=True)
        for name in arguments.objects:
            times = {key: [] for key in sources}
            for _ in range(arguments.rounds):
                for key, source in sources.items():
                    mine = arguments.only_now if key == "now" else []
                    times[key].append(run(source, name, [*options, *mine]))
            print(f"{name}\n  {'stage':10s} {'time [s]':>9s}" + "  ratio" * bool(arguments.than))
            for stage in times["now"][0]:
                medians = {
                    key: np.median([each.get(stage, np.nan) for each in rows])
                    for key, rows in times.items()
                }
                line = f"  {stage:10s} {medians['now']:9.2f}"
                if arguments.than:
                    line += f" {medians['than'] / medians['now']:6.2f}"
                print(line, flush=True)
            profile = Path(folder) / "run.prof"
            run(_HERE, name, [*options, *arguments.only_now], profile)
            parts = sorted(spent(profile).items(), key=lambda item: -item[1])
            print("  spent on " + ", ".join(f"{kind} {part:.0%}" for kind, part in parts))


if __name__ == "__main__":
    main()
