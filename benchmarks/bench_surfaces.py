"""Errors of each estimator's surface: objects x seeds, from the same contacts.

    python benchmarks/bench_surfaces.py --seeds 10

Each object (the paper's size, 0.20 m) is touched with the simulated hand in Drake. GPIS drives the
exploration, so that none of our own estimators places the contacts. Free space is carved off every
estimate, unless --no-free-space is given. Errors are root mean squares over the explored part
(within a step, 5 cm, of a contact), in millimetres, averaged over seeds.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from lis_grasp import Contacts, Hand, pipeline, shapes, surface_error
from lis_grasp.exploration import STEP_FRACTION
from lis_grasp.io.json_lines import Row
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import grouped_table, mean_cell, split, where

MEASURES = ("rmsd", "rmsd_truth_to_estimate", "edge_rmsd")


@dataclass(frozen=True)
class SurfaceTrial:
    object: str
    seed: int
    touches: int
    explorer: str
    free_space: bool


@lru_cache(maxsize=1)
def touched(trial: SurfaceTrial) -> Contacts:
    facts = {"object": trial.object, "estimator": trial.explorer}
    config = pipeline.RunConfig(**facts, touches=trial.touches, seed=trial.seed)
    shape = shapes.build(trial.object, size=shapes.PAPER_SIZE)
    scenario = pipeline.Scenario.from_config(config, shape, Hand.load("allegro"))
    return pipeline.touch(scenario).contacts


def measure(trial: SurfaceTrial, estimator: str) -> Row:
    shape, contacts = shapes.build(trial.object, size=shapes.PAPER_SIZE), touched(trial)
    known = pipeline.Perception(estimator=estimator, free_space=trial.free_space)
    _, mesh = pipeline.estimate(known, contacts)
    radius = STEP_FRACTION * shape.size
    error = surface_error(mesh, shape, contacts, explored_radius=radius)
    return {name: getattr(error, name) for name in MEASURES}


def main() -> None:
    defaults = {"seeds": 10, "touches": 40, "explorer": "gpis", "no_free_space": False}
    options = read_options(__doc__, **defaults, jobs=2, output=Path("results/bench_surfaces"))
    trials = [
        SurfaceTrial(name, seed, options.touches, options.explorer, not options.no_free_space)
        for name in shapes.NAMES
        for seed in range(options.seeds)
    ]
    experiment = Experiment("bench_surfaces", measure)
    rows = experiment.complete(
        trials, list(ESTIMATORS), options.output / "rows.jsonl", jobs=options.jobs
    )
    columns = [
        (
            name,
            lambda rows, name=name: " ".join(
                mean_cell(m, 1e3, 2)(where(rows, estimator=name)) for m in MEASURES
            ),
        )
        for name in ESTIMATORS
    ]
    title = "estimate -> truth, truth -> estimate, edges [mm]; means over seeds"
    groups = {**split(rows, "object"), "all": rows}
    print(grouped_table("surfaces", title, "object", groups, columns).text())


if __name__ == "__main__":
    main()
