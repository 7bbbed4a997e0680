"""Time and outcome of simulated lifts: the best grasps planned on the true built-in shapes.

python benchmarks/bench_lift.py [--hand allegro] [--seeds 1] [--best 1] [--masses 0.1 0.2 0.5]
"""

import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lis_grasp import ForceClosureSampler, Hand, shapes
from lis_grasp.io.json_lines import Row
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.simulation.drake.lift import simulate_lift
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import grouped_table, median_cell, split


@dataclass(frozen=True)
class LiftTrial:
    object: str
    seed: int
    hand: str
    best: int


def lifts(trial: LiftTrial, mass: str) -> list[Row]:
    mesh, hand = shapes.build(trial.object).mesh, Hand.load(trial.hand)
    height = float(mesh.bounds[0, 2])
    search = ForceClosureSampler(hand).sample(
        mesh, rng=np.random.default_rng(trial.seed), support_height=height
    )
    rows: list[Row] = [] if search.grasps else [{"reason": "no_grasp", "seconds": None}]
    for rank, grasp in enumerate(search.grasps[: trial.best], start=1):
        start = time.perf_counter()
        outcome = simulate_lift(LiftSetup(mesh, hand, grasp, height, mass=float(mass)))
        seconds = time.perf_counter() - start
        rows.append({"rank": rank, "reason": outcome.reason, "seconds": seconds})
    return rows


def main() -> None:
    defaults = {"hand": "allegro", "seeds": 1, "best": 1, "masses": ["0.2"], "jobs": 1}
    options = read_options(__doc__, **defaults, output=Path("results/bench_lift"))
    trials = [
        LiftTrial(name, seed, options.hand, options.best)
        for seed in range(options.seeds)
        for name in shapes.NAMES
    ]
    experiment = Experiment("bench_lift", lifts, variant="mass")
    file = options.output / "rows.jsonl"
    rows = experiment.complete(trials, options.masses, file, jobs=options.jobs)
    columns = [
        ("reasons", lambda rows: str(dict(Counter(row["reason"] for row in rows)))),
        ("median of a lift [s]", median_cell("seconds")),
    ]
    groups = split(rows, "mass", "object")
    print(grouped_table("lifts", "Lifts", "mass [kg] | object", groups, columns).text())


if __name__ == "__main__":
    main()
