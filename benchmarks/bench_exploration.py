"""Cost of explorations, and what is known after so many touches: coverage, ends and errors.

    python benchmarks/bench_exploration.py mallet --cost --touches 40 160 320
    python benchmarks/bench_exploration.py gear --seeds 3 --touches 100 200 500
    python benchmarks/bench_exploration.py hammer pen --policies spread cover --touches 10 20

Touches are made by geometry alone, of fixed objects of which nothing is known: in a stable pose in
a region of a table, with a realistic sensor. `--cost` runs `lis-grasp explore` in a process of its
own and prints its CPU time, and the largest memory. Otherwise it prints the fraction of reachable
surface within a touch's radius of a contact on its side; the errors of the two ends of the estimate
along the object's longest axis, the larger one and the fraction of ends more than 20 mm off; root
mean squares from the estimate to the truth and back, everywhere; and probes and robot time.

Continues where it stopped when run again with the same folder.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp import Hand, pipeline
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.evaluation.touch_coverage import reachable_coverage, touch_radius
from lis_grasp.exploration import Exploration
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.conditions import UNKNOWN
from lis_grasp.pipeline.scenario import place_object
from lis_grasp.typing import FloatArray
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import Column, grouped_table, mean_cell, split, values_of
from lis_grasp_studies.study.trial import Setup, find_object

HAND, TIP_RADIUS = "allegro", 0.012
FAR_OFF = 0.02  # error of an end [m]


@dataclass(frozen=True)
class Trial:
    object: str
    seed: int
    touches: str
    """Numbers of contacts, joined by spaces."""


def measure_cost(trial: Trial, policy: str) -> Row:
    """Return the CPU time [s] and the largest resident memory [MB] of a process that explores."""
    words = ["explore", trial.object, "--prober", "kinematic", "--policy", policy]
    words += ["--touches", trial.touches, "--seed", str(trial.seed)]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lis_grasp.cli.main", *words, "--output", folder]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} failed")
    return {"cpu": usage.ru_utime + usage.ru_stime, "memory": usage.ru_maxrss / 1024.0}


def measure_quality(trial: Trial, policy: str) -> list[Row]:
    """Return a row for each number of contacts of one exploration."""
    counts = [int(word) for word in trial.touches.split()]
    config = pipeline.RunConfig(
        **{**UNKNOWN, "free": False},
        hand=HAND,
        prober="kinematic",
        policy=policy,
        touches=max(counts),
        seed=int(np.random.SeedSequence([trial.seed, *trial.object.encode()]).generate_state(1)[0]),
    )
    shape, _ = place_object(find_object(trial.object, Setup()), config)
    scenario = pipeline.Scenario.from_config(
        config, shape, Hand.load(HAND), recorded={"X_EO": None}
    )
    outcomes, rows = pipeline.touch(scenario).outcomes, []
    for count in counts:
        part = Exploration.replay(outcomes, touches=count)
        _, mesh = pipeline.estimate(scenario.known, part.contacts)
        error, ends = surface_error(mesh, shape, samples=2000), end_errors(mesh, shape.mesh)
        rows.append(
            {
                "count": count,
                "coverage": reachable_coverage(
                    shape.mesh,
                    part.contacts,
                    tip_radius=TIP_RADIUS,
                    radius=touch_radius(shape.mesh),
                    support_height=0.0,
                ),
                "end": float(ends.max()),
                "far_off": float(np.mean(ends > FAR_OFF)),
                "rms": error.rmsd,
                "rms_back": error.rmsd_truth_to_estimate,
                "probes": len(part.outcomes),
                "seconds": part.duration,
            }
        )
    return rows


def end_errors(estimate: trimesh.Trimesh, truth: trimesh.Trimesh) -> FloatArray:
    """Return the errors of both ends along the truth's longest axis, shape (2,) [m]."""
    X, extents = trimesh.bounds.oriented_bounds(truth)
    axis = X[int(np.argmax(extents)), :3]
    of_estimate, of_truth = estimate.vertices @ axis, truth.vertices @ axis
    errors = [of_estimate.min() - of_truth.min(), of_estimate.max() - of_truth.max()]
    return np.abs(errors)


def median_and_mean(column: str) -> Callable[[Sequence[Row]], str]:
    def cell(rows: Sequence[Row]) -> str:
        values = 1e3 * values_of(rows, column)
        return f"{np.median(values):.1f} / {values.mean():.1f}"

    return cell


COST: list[Column] = [("CPU [s]", mean_cell("cpu")), ("memory [MB]", mean_cell("memory", digits=0))]
QUALITY: list[Column] = [
    ("runs", lambda rows: str(len(rows))),
    ("coverage", mean_cell("coverage", digits=2)),
    ("end [mm], median / mean", median_and_mean("end")),
    ("ends > 20 mm [%]", mean_cell("far_off", 100.0, 0)),
    ("estimate to truth [mm]", median_and_mean("rms")),
    ("truth to estimate [mm]", median_and_mean("rms_back")),
    ("probes", mean_cell("probes")),
    ("robot [s]", mean_cell("seconds")),
]


def main() -> None:
    lists = {"objects": ["mallet"], "policies": ["cover"], "touches": [40, 160, 320]}
    numbers = {"seeds": 1, "first_seed": 0, "jobs": 1}
    options = read_options(
        __doc__, cost=False, **lists, **numbers, output=Path("results/exploration")
    )
    counts = [str(count) for count in options.touches]
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    trials = [
        Trial(name, seed, text)
        for seed in seeds
        for name in options.objects
        for text in (counts if options.cost else [" ".join(counts)])
    ]
    kind, measure = ("cost", measure_cost) if options.cost else ("quality", measure_quality)
    experiment = Experiment(kind, measure, asdict, variant="policy")
    file = options.output / f"{kind}.jsonl"
    rows = experiment.complete(trials, options.policies, file, jobs=options.jobs)
    groups = split(rows, "touches" if options.cost else "count", "policy")
    groups = {f"{count}, {policy}": part for (count, policy), part in groups.items()}
    columns = COST if options.cost else QUALITY
    print(grouped_table(kind, f"{kind} by touches", "touches", groups, columns).text())


if __name__ == "__main__":
    main()
