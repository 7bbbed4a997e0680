"""Success rate of `lis-grasp run`: the object is lifted and held, for objects x seeds.

    python benchmarks/bench_run.py box cylinder mallet --seeds 3 --run "--estimator patch"

`--run` has options of `run`, such as "--known" for objects of known place and size, touched in the
air, or "--arm iiwa14 --hand allegro"; then contacts and limits that an arm violates are counted.
Objects are built-in names, mesh files, or names of test objects of the studies; `tools` stands
for eight tools and flat things. Each run is a process of its own, as for a user; the same command
continues in its folder. The interval is the 95 % score interval (Wilson 1927).
"""

import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from lis_grasp import shapes
from lis_grasp.io.json_lines import Row
from lis_grasp.lifting.arm_use import violations
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.statistics import rate_with_interval
from lis_grasp_studies.harness.tables import grouped_table, median_cell, split
from lis_grasp_studies.test_objects.shape_sets import TOOLS, build_shape


@dataclass(frozen=True)
class RunTrial:
    object: str
    seed: int


def run(trial: RunTrial, options: str) -> Row:
    """Return facts of the report of a run, or the sentence with which it failed."""
    with TemporaryDirectory() as folder:
        name = trial.object
        if name not in shapes.NAMES and not Path(name).suffix:
            name = f"{folder}/{name}.stl"
            build_shape(trial.object).mesh.export(name)
        command = [sys.executable, "-m", "lis_grasp.cli.main", "run", name]
        command += ["--seed", str(trial.seed), *shlex.split(options), "--output", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return {"held": False, "reason": done.stderr.strip().splitlines()[-1]}
        report = json.loads(Path(folder, "report.json").read_text())
    lift, exploration = report["lift"], report["exploration"]
    arm = report.get("arm") or {}
    uses = [arm.get("touches"), *(attempt.get("arm") for attempt in report["attempts"])]
    uses = [use for use in uses if use is not None]
    return {
        **{name: lift.get(name) for name in ("held", "reason", "slip")},
        "touches": exploration["contacts"],
        "motion": exploration["seconds"],
        "rmsd": report["surface"]["rmsd"],
        "seconds": report["timings"]["total"],
        "violations": violations(uses),
        "effort": max((use["effort"] for use in uses), default=None),
        "speed": max((use["speed"] for use in uses), default=None),
    }


def held(rows: Sequence[Row]) -> str:
    return rate_with_interval(sum(row["held"] for row in rows), len(rows))


def held_within_limits(rows: Sequence[Row]) -> str:
    good = [row for row in rows if row["held"] and not row["violations"]]
    return rate_with_interval(len(good), len(rows))


def reasons(rows: Sequence[Row]) -> str:
    return ", ".join(row["reason"] for row in rows if not row["held"])


def main() -> None:
    defaults = {"objects": ["box"], "seeds": 3, "jobs": 1, "run": ""}
    options = read_options(__doc__, **defaults, output=Path("results/bench_run"))
    names = [n for name in options.objects for n in (TOOLS if name == "tools" else (name,))]
    trials = [RunTrial(name, seed) for name in names for seed in range(options.seeds)]
    experiment = Experiment("bench_run", run, variant="options")
    file = options.output / "rows.jsonl"
    rows = experiment.complete(trials, [options.run], file, jobs=options.jobs)
    columns = [
        ("held (95 %)", held),
        ("without violation", held_within_limits),
        ("effort", median_cell("effort", digits=2)),
        ("speed", median_cell("speed", digits=2)),
        ("touches", median_cell("touches", digits=0)),
        ("motion [s]", median_cell("motion", digits=0)),
        ("rmsd [mm]", median_cell("rmsd", 1e3, 2)),
        ("slip [mm]", median_cell("slip", 1e3)),
        ("time [s]", median_cell("seconds")),
        ("other reasons", reasons),
    ]
    groups = {**split(rows, "object"), "all": rows}
    print(grouped_table("runs", "Runs, medians", "object", groups, columns).text())


if __name__ == "__main__":
    main()
