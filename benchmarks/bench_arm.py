"""Touch, grasp and lift with an arm: objects x seeds x robot stations, one row a trial.

    python benchmarks/bench_arm.py box torus ycb/*.ply --seeds 5 --output results/arm
    python benchmarks/bench_arm.py --stations iiwa14+allegro --jobs 1

Each trial is a process of its own, as for a user. The same command continues where it ended; after
a change of the package, begin another folder. Objects of the YCB set have their own mass. Place and
size of the object are known, unless --unknown is given. Intervals are 95 % score intervals (Wilson
1927).
"""

import json
import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from lis_grasp import shapes
from lis_grasp.io.json_lines import Row
from lis_grasp.lifting.arm_use import violations
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.statistics import rate_with_interval
from lis_grasp_studies.harness.tables import grouped_table, median_cell, split, values_of

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


@dataclass(frozen=True)
class ArmTrial:
    object: str
    seed: int
    touches: int
    unknown: bool


def run(trial: ArmTrial, station: str) -> Row:
    """Run one trial in a process of its own; return the columns of its row."""
    arm, hand = station.split("+")
    with TemporaryDirectory() as folder:
        times = Path(folder) / "paths.json"
        command = [sys.executable, "-c", _RUN, str(times), "run", trial.object, "--arm", arm]
        command += ["--hand", hand, "--touches", str(trial.touches), "--seed", str(trial.seed)]
        command += ["--output", f"{folder}/run"] + ([] if trial.unknown else ["--known"])
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
    median = float(np.median(paths)) if paths else None
    return {**facts(report), **timed, "paths": len(paths), "path_seconds": median}


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
        "contacts": report["touches"],
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


def rate_of(chosen) -> Any:
    """Return a cell with the rate of the rows that a function chooses."""
    return lambda rows: rate_with_interval(sum(map(bool, map(chosen, rows))), len(rows))


def is_mild(row: Row) -> bool:
    """Return whether a row is held within all limits, without contact of the arm or the table.

    A grasp's approach stops where the hand meets the object.
    """
    pairs = row.get("unwanted", {})
    severe = [pair for pair in pairs if pair.startswith("arm's ") or pair.endswith("table")]
    return row["held"] and not severe and len(row["violations"]) == len(pairs)


def counts(rows: Sequence[Row], column: str) -> str:
    """Return how often each value of a column occurs, or each key of its mappings."""
    values = [row.get(column, {}) for row in rows]
    keys = [key for value in values for key in ([value] if isinstance(value, str) else value)]
    return ", ".join(f"{key} {count}" for key, count in Counter(keys).items())


def largest(column: str) -> Any:
    return lambda rows: f"{values_of(rows, column).max(initial=0.0):.3g}"


def main() -> None:
    defaults = {"objects": list(shapes.NAMES), "stations": ["iiwa14+allegro", "panda+wsg50"]}
    defaults |= {"seeds": 1, "first_seed": 0, "touches": 20, "unknown": False, "jobs": 1}
    options = read_options(__doc__, **defaults, output=Path("results/arm"))
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    trials = [
        ArmTrial(name, seed, options.touches, options.unknown)
        for seed in seeds
        for name in options.objects
    ]
    experiment = Experiment("bench_arm", run, variant="station")
    file = options.output / "rows.jsonl"
    rows = experiment.complete(trials, options.stations, file, jobs=options.jobs)
    columns = [
        ("held (95 %)", rate_of(lambda row: row["held"])),
        ("without violation", rate_of(lambda row: not row.get("violations", ["failed"]))),
        ("both", rate_of(lambda row: row["held"] and not row["violations"])),
        ("at most hand on object", rate_of(is_mild)),
        ("reasons", lambda rows: counts(rows, "reason")),
        ("unwanted contacts", lambda rows: counts(rows, "unwanted")),
        ("largest effort", largest("effort")),
        ("speed", largest("speed")),
        ("touch [N]", largest("touch_force")),
        ("a path [s]", median_cell("path_seconds", digits=2)),
        ("wall [s]", median_cell("wall_seconds")),
        ("processor [s]", median_cell("cpu_seconds")),
    ]
    for first in (("station",), ("station", "object")):
        groups = split(rows, *first)
        print(grouped_table("arm", "Trials", " | ".join(first), groups, columns).text())


if __name__ == "__main__":
    main()
