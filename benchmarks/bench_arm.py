"""Touch, grasp and lift with an arm: objects x seeds x robot stations, one row a trial.

    python benchmarks/bench_arm.py --meshes ycb/*.ply --seeds 5 --rows results/arm.jsonl
    python benchmarks/bench_arm.py --stations iiwa14+allegro --objects box,torus --seeds 1

Each trial is a process of its own, as for a user; its row is written at once. The same command
continues where it ended; after a change of the package, begin another file. `--parts 2 --part 0`
runs every second trial. Objects of the YCB set have their own mass. Place and size of the object
are known, unless `--unknown` is given. Intervals are 95 % score intervals (Wilson 1927).
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from scipy.stats import binomtest

from lis_grasp import shapes
from lis_grasp.io.json_lines import append_lines, read_lines
from lis_grasp.lifting.arm_use import violations

STATIONS = "iiwa14+allegro,panda+wsg50"
_LONGEST = 1200.0  # of a trial [s]

# Runs the command as a user does, and records the time of each planned path.
_RUN = """
import json, sys, time
from lis_grasp.arms.transit import TransitPlanner
from lis_grasp.cli.main import main
seconds, plan = [], TransitPlanner.plan
def timed(*arguments, **options):
    start = time.process_time()
    try:
        return plan(*arguments, **options)
    finally:
        seconds.append(time.process_time() - start)
TransitPlanner.plan = timed
code = main(sys.argv[2:])
open(sys.argv[1], "w").write(json.dumps(seconds))
sys.exit(code)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stations", default=STATIONS, help="arm+hand, separated by commas")
    parser.add_argument("--objects", default=",".join(shapes.NAMES), help="separated by commas")
    parser.add_argument("--meshes", nargs="*", default=[], help="further objects, mesh files")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--touches", default="20")
    parser.add_argument("--unknown", action="store_true", help="nothing is known of the object")
    parser.add_argument("--rows", type=Path, help="file of rows; a temporary one without it")
    parser.add_argument("--parts", type=int, default=1)
    parser.add_argument("--part", type=int, default=0)
    parser.add_argument("--summary", action="store_true", help="print the rows' summary only")
    options = parser.parse_args()
    with TemporaryDirectory() as folder:
        rows = options.rows or Path(folder) / "rows.jsonl"
        if not options.summary:
            run_missing(options, rows)
        _, made = read_lines(rows)
    for station in dict.fromkeys(row["station"] for row in made):
        summarise(station, [row for row in made if row["station"] == station])


def run_missing(options: argparse.Namespace, path: Path) -> None:
    """Run every trial that has no row yet, seed by seed."""
    objects = [*filter(None, options.objects.split(",")), *options.meshes]
    trials = [
        (station, name, seed)
        for seed in range(options.first_seed, options.first_seed + options.seeds)
        for name in objects
        for station in options.stations.split(",")
    ]
    header = {"touches": options.touches, "unknown": options.unknown}
    found, rows = read_lines(path)
    if found and found != header:
        sys.exit(f"{path} has rows of {found}: name another file with --rows")
    done = {(row["station"], row["object"], row["seed"]) for row in rows}
    for number, (station, name, seed) in enumerate(trials):
        short = Path(name).stem
        if number % options.parts == options.part and (station, short, seed) not in done:
            row = {"station": station, "object": short, "seed": seed}
            row |= trial(station, name, seed, options)
            append_lines(path, header, [row])
            print(line(row), flush=True)


def trial(station: str, name: str, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """Run one trial, and return its row."""
    arm, hand = station.split("+")
    with TemporaryDirectory() as folder:
        times = Path(folder) / "paths.json"
        command = [sys.executable, "-c", _RUN, str(times), "run", name, "--arm", arm]
        command += ["--hand", hand, "--touches", options.touches, "--seed", str(seed)]
        command += ["--output", f"{folder}/run"] + ([] if options.unknown else ["--known"])
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, check=False, timeout=_LONGEST
            )
            trouble = done.stderr.strip().splitlines()[-1] if done.returncode else ""
        except subprocess.TimeoutExpired:
            trouble = f"took longer than {_LONGEST:g} s"
        after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - start
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        timed = {"wall_seconds": round(wall, 1), "cpu_seconds": round(cpu, 1)}
        if trouble:
            return {"held": False, "lifted": False, "reason": "failed", "message": trouble, **timed}
        report = json.loads(Path(f"{folder}/run/report.json").read_text())
        paths = json.loads(times.read_text())
    return {**facts(report), **timed, "paths": len(paths), "path_seconds": middle(paths)}


def facts(report: dict[str, Any]) -> dict[str, Any]:
    """Return what a row has of a report."""
    lift, attempts = report["lift"], report["attempts"]
    uses = [report["arm"].get("touches"), *(attempt.get("arm") for attempt in attempts)]
    uses = [use for use in uses if use is not None]
    unwanted: Counter[str] = Counter()
    for use in uses:
        unwanted.update(use["contacts"])
    return {
        "held": lift["held"],
        "lifted": lift["lifted"],
        "reason": lift["reason"],
        "mass": lift["mass"],
        "slip": lift.get("slip"),
        "touches": report["touches"],
        "probes": report["exploration"]["probes"],
        "attempts": [attempt["reason"] for attempt in attempts],
        "unwanted": dict(unwanted),
        "violations": violations(uses),
        "steps": sum(use["steps"] for use in uses),
        "effort": max((use["effort"] for use in uses), default=None),
        "speed": max((use["speed"] for use in uses), default=None),
        "touch_force": (report["arm"].get("touches") or {}).get("contact_force"),
        "timings": report["timings"],
    }


def line(row: dict[str, Any]) -> str:
    """Return a row as one line of text."""
    text = f"{row['station']:16} {row['object']:20} seed {row['seed']}  {row['reason']:14}"
    if "message" in row:
        return f"{text} {row['message']}"
    text += f" {row['touches']} touches of {row['probes']} probes"
    text += f", slip {1e3 * (row['slip'] or 0.0):.1f} mm"
    if row["effort"] is not None:
        text += f", effort {row['effort']:.2f}, speed {row['speed']:.2f}"
    text += f", {row['wall_seconds']:.0f} s ({row['cpu_seconds']:.0f} s of processor)"
    return text + (f"  VIOLATED: {'; '.join(row['violations'])}" if row["violations"] else "")


def summarise(station: str, rows: list[dict[str, Any]]) -> None:
    """Print success rates, violations and times of one station's rows."""
    print(f"\n{station}: {len(rows)} trials")
    for title, chosen in (
        ("held", [row for row in rows if row["held"]]),
        ("held without a violation", [r for r in rows if r["held"] and not r["violations"]]),
        ("without a violation", [r for r in rows if not r.get("violations", ["failed"])]),
        ("held; unwanted at most of hand and object", [r for r in rows if mild(r)]),
    ):
        low, high = binomtest(len(chosen), len(rows)).proportion_ci(method="wilson")
        rate = len(chosen) / len(rows)
        print(f"  {title}: {len(chosen)}, {rate:.1%} ({low:.1%} to {high:.1%})")
    by_object: dict[str, list[bool]] = {}
    for row in rows:
        by_object.setdefault(row["object"], []).append(row["held"])
    print("  by object:", ", ".join(f"{n} {sum(h)}/{len(h)}" for n, h in by_object.items()))
    print("  reasons:", dict(Counter(row["reason"] for row in rows)))
    unwanted: Counter[str] = Counter()
    for row in rows:
        unwanted.update(row.get("unwanted", {}).keys())
    print("  trials with an unwanted contact, by pair:", dict(unwanted) or "none")
    for key in ("effort", "speed", "touch_force", "path_seconds", "wall_seconds", "cpu_seconds"):
        values = [row[key] for row in rows if row.get(key) is not None]
        if values:
            print(f"  {key}: median {statistics.median(values):.3g}, largest {max(values):.3g}")


def mild(row: dict[str, Any]) -> bool:
    """Return whether a row is held within all limits, without contact of the arm or the table.

    A grasp's approach stops where the hand meets the object.
    """
    pairs = row.get("unwanted", {})
    severe = [pair for pair in pairs if pair.startswith("arm's ") or pair.endswith("table")]
    return row["held"] and not severe and len(row["violations"]) == len(pairs)


def middle(values: list[float]) -> float | None:
    """Return the median; None of nothing."""
    return statistics.median(values) if values else None


if __name__ == "__main__":
    main()
