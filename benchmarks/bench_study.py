"""Rows of a study per minute on a Dask cluster of this machine, by number of workers.

Each worker does one trial beforehand (imports, file caches); then the same trials are timed on each
cluster. Ratios are meaningful only on an otherwise idle machine.

    python benchmarks/bench_study.py                # 1 and 2 workers
    python benchmarks/bench_study.py --workers 1 8 --seeds 4
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

from distributed import Client, LocalCluster

from lis_grasp_studies.runner import DaskCluster, run_trials
from lis_grasp_studies.study.study import Study
from lis_grasp_studies.study.study_results import StudyResults
from lis_grasp_studies.study.study_trial import run_trial

OBJECTS = ("box", "mallet", "sphere", "hollow_cylinder")
ESTIMATORS = ("gpis", "blend")


def study_of(objects: tuple[str, ...], touches: int, seeds: tuple[int, ...]) -> Study:
    return Study(
        objects=objects, estimators=ESTIMATORS, touches=(touches,), noise=("none",), seeds=seeds
    )


def rate(workers: int, seeds: int) -> tuple[float, float]:
    """Return rows a minute, and processor seconds of the workers a row."""
    study = study_of(OBJECTS, 10, tuple(range(seeds)))
    warm = study_of(("cylinder",), 5, (0,))
    with (
        tempfile.TemporaryDirectory() as folder,
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as cluster,
    ):
        address = cluster.scheduler_address
        with Client(address) as client:
            (job,) = StudyResults(Path(folder)).missing(warm)
            client.run(run_trial, job)
            before = client.run(time.process_time)
            start = time.perf_counter()
            results, total = StudyResults(Path(folder)), len(study.trials())
            jobs = results.missing(study)
            for _ in run_trials(jobs, total, results.lines, DaskCluster(address), run_trial):
                pass
            seconds = time.perf_counter() - start
            after = client.run(time.process_time)
        rows = len(results.of(study))
    spent = sum(after[worker] - before[worker] for worker in after)
    return 60.0 * rows / seconds, spent / rows


def main() -> None:
    """Print a line for each number of workers, and the arithmetic of a large study."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before")
    rates = {}
    for workers in options.workers:
        rates[workers], spent = rate(workers, options.seeds)
        ratio = rates[workers] / rates[options.workers[0]]
        print(
            f"{workers} workers: {rates[workers]:.1f} rows a minute ({ratio:.2f} times"
            f" {options.workers[0]}), {spent:.2f} s of processor a row",
            flush=True,
        )
    rows, workers = 10_000 * 7, 100
    hours = rows * spent / 3600.0
    print(
        f"10 000 objects of 7 estimators, one hand, budget, noise and seed: {rows} rows of"
        f" {spent:.2f} s, {hours:.0f} hours of processor, {60.0 * hours / workers:.0f} minutes on"
        f" {workers} workers"
    )


if __name__ == "__main__":
    main()
