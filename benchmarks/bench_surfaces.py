"""Errors of each estimator's surface: objects x seeds, from the same contacts.

    python benchmarks/bench_surfaces.py --seeds 10

Each object (the paper's size, 0.20 m) is touched with the simulated hand in Drake. GPIS drives the
exploration, so that none of our own estimators places the contacts. Free space is carved off every
estimate. Errors are root mean squares over the explored part (within a step, 5 cm, of a contact),
in millimetres, averaged over seeds.
"""

from __future__ import annotations

import argparse

import numpy as np

from lis_grasp import Hand, pipeline, shapes, surface_error
from lis_grasp.exploration import STEP_FRACTION
from lis_grasp.surfaces import ESTIMATORS

MEASURES = ("rmsd", "rmsd_truth_to_estimate", "edge_rmsd")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--touches", type=int, default=40)
    parser.add_argument("--explorer", choices=list(ESTIMATORS), default="gpis")
    parser.add_argument("--no-free-space", action="store_true", help="of contacts alone")
    arguments = parser.parse_args()
    hand = Hand.load("allegro")
    print("estimate -> truth | truth -> estimate | edges, mm; mean over seeds")
    print(f"{'object':16s}" + "".join(f"{name:>24s}" for name in ESTIMATORS))
    table: dict[str, list[np.ndarray]] = {name: [] for name in ESTIMATORS}
    for shape_name in shapes.NAMES:
        shape = shapes.build(shape_name, size=shapes.PAPER_SIZE)
        errors: dict[str, list[list[float]]] = {name: [] for name in ESTIMATORS}
        for seed in range(arguments.seeds):
            config = pipeline.RunConfig(
                object=shape_name,
                estimator=arguments.explorer,
                touches=arguments.touches,
                seed=seed,
            )
            scenario = pipeline.Scenario.from_config(config, shape, hand)
            contacts = pipeline.touch(scenario).contacts
            for name in ESTIMATORS:
                known = pipeline.Perception(estimator=name, free_space=not arguments.no_free_space)
                _, mesh = pipeline.estimate(known, contacts)
                error = surface_error(
                    mesh, shape, contacts, explored_radius=STEP_FRACTION * shape.size
                )
                values = [getattr(error, measure) for measure in MEASURES]
                errors[name].append([np.nan if v is None else 1e3 * v for v in values])
        row = f"{shape_name:16s}"
        for name in ESTIMATORS:
            mean = np.mean(errors[name], axis=0)
            table[name].append(mean)
            row += "".join(f"{v:8.2f}" for v in mean)
        print(row, flush=True)
    print(
        f"{'mean':16s}"
        + "".join("".join(f"{v:8.2f}" for v in np.nanmean(table[n], axis=0)) for n in ESTIMATORS)
    )


if __name__ == "__main__":
    main()
