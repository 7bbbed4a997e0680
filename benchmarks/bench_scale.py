"""Memory and losses of a large study on a Dask cluster whose processes are killed.

Trials are empty: their rows have the columns of real ones. So what is measured is the study itself,
its files, its client and its scheduler. Scheduler and workers are processes of their own; workers
are killed and replaced, the scheduler is killed once and started again, and with it the command.

    python benchmarks/bench_scale.py --trials 10000 --kill-every 1500
    python benchmarks/bench_scale.py --real --trials 200 --kill-every 20

With `--real` the trials touch, estimate, plan and lift a mesh. Its file is missing for some seconds
at a quarter of the trials, and the rows are compared with those of an undisturbed study.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil

from lis_grasp import shapes
from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp_studies.runner import DaskCluster, local_scheduler, run_trials
from lis_grasp_studies.study.study import Study
from lis_grasp_studies.study.study_results import StudyResults
from lis_grasp_studies.study.study_trial import MACHINE, TIMES, blank_row, run_trial
from lis_grasp_studies.trial_results import Job

_MEGABYTE = 1e6
_MISSING = 8.0  # how long the mesh file is missing [s]


def empty_rows(job: Job) -> list[Row]:
    """Return the rows of a trial without its work."""
    shape = shapes.build(job.trial.object)
    return [blank_row(job.trial, name, shape) for name in job.variants]


class Cluster:
    """A scheduler and workers as processes of their own."""

    def __init__(self, workers: int) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        self._environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
        self._environment["PYTHONPATH"] += f":{os.environ.get('PYTHONPATH', '')}"
        self.scheduler = self.start_scheduler()
        self.workers = [self._start_worker() for _ in range(workers)]

    def start_scheduler(self) -> subprocess.Popen[bytes]:
        port = self.address.rpartition(":")[2]
        return self._start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")

    def _start_worker(self) -> subprocess.Popen[bytes]:
        return self._start("worker", self.address, "--nthreads", "1", "--no-dashboard")

    def _start(self, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", *arguments]
        quiet = subprocess.DEVNULL
        return subprocess.Popen(
            command, env=self._environment, stdout=quiet, stderr=quiet, start_new_session=True
        )

    def replace_a_worker(self, rng: random.Random) -> None:
        number = rng.randrange(len(self.workers))
        _kill(self.workers[number])
        self.workers[number] = self._start_worker()

    def replace_the_scheduler(self) -> None:
        _kill(self.scheduler)
        self.scheduler = self.start_scheduler()
        for number, worker in enumerate(self.workers):
            _kill(worker)
            self.workers[number] = self._start_worker()

    def stop(self) -> None:
        for process in (self.scheduler, *self.workers):
            _kill(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and those that it started."""
    with contextlib.suppress(psutil.NoSuchProcess):
        for child in psutil.Process(process.pid).children(recursive=True):
            child.kill()
    process.kill()
    process.wait()


def _memory(pid: int) -> float:
    """Return the resident memory of a process [MB]."""
    return psutil.Process(pid).memory_info().rss / _MEGABYTE


def _steps(
    study: Study, folder: Path, address: str, trial: Callable[[Job], list[Row]]
) -> Iterator[tuple[int, int]]:
    results = StudyResults(folder)
    jobs, total = results.missing(study), len(study.trials())
    return run_trials(jobs, total, results.lines, DaskCluster(address), trial)


def _hide(path: Path) -> None:
    """Take a file away, and bring it back some seconds later."""
    hidden = path.rename(path.with_suffix(".away"))
    threading.Timer(_MISSING, hidden.rename, [path]).start()


def _same(row: Row) -> Row:
    """Return what does not differ between equal trials."""
    return {name: value for name, value in row.items() if name not in (*TIMES, MACHINE)}


def _undisturbed(study: Study, folder: Path) -> list[Row]:
    results = StudyResults(folder)
    jobs, total = results.missing(study), len(study.trials())
    for _ in run_trials(jobs, total, results.lines, local_scheduler(None), run_trial):
        pass
    return results.of(study)


def main() -> None:
    """Print the memory by the number of rows, and compare the rows with the study."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--real", action="store_true", help="trials with their work")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kill-every", type=int, default=400, help="trials between two kills")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "block.stl"
        shapes.build("box").mesh.export(mesh)
        study = Study(
            objects=(str(mesh),) if options.real else ("box",),
            estimators=("blend",),
            touches=(10,),
            noise=("none",),
            seeds=tuple(range(options.trials)),
            reference="blend",
        )
        disturbed = Path(folder) / "disturbed"
        _disturb(study, disturbed, mesh, options)
        rows = StudyResults(disturbed).of(study)
        print(f"{len(rows)} rows of {options.trials} trials, {len({r['key'] for r in rows})} keys")
        if options.real:
            expected = _undisturbed(study, Path(folder) / "undisturbed")
            equal = sum(
                _same(row) == _same(other) for row, other in zip(rows, expected, strict=True)
            )
            print(f"{equal} rows of {len(expected)} are those of the undisturbed study")


def _disturb(study: Study, folder: Path, mesh: Path, options: argparse.Namespace) -> None:
    """Run a study while workers, the scheduler and, with `--real`, the mesh disappear."""
    rng, trial = random.Random(options.seed), run_trial if options.real else empty_rows
    cluster, start = Cluster(options.workers), time.perf_counter()
    done, killed, restarted, hidden = 0, 0, False, False
    print("rows | seconds | client [MB] | scheduler [MB]")
    try:
        while done < options.trials:
            try:
                for done, _ in _steps(study, folder, cluster.address, trial):
                    if options.real and not hidden and 4 * done >= options.trials:
                        hidden = True
                        _hide(mesh)
                    if done % options.kill_every:
                        continue
                    seconds = time.perf_counter() - start
                    memory = _memory(os.getpid()), _memory(cluster.scheduler.pid)
                    print(f"{done} | {seconds:.0f} | {memory[0]:.0f} | {memory[1]:.0f}", flush=True)
                    cluster.replace_a_worker(rng)
                    killed += 1
                    if not restarted and 2 * done >= options.trials:
                        restarted = True
                        cluster.replace_the_scheduler()
            except LisGraspError as error:
                print(f"run again after: {str(error)[:100]}", flush=True)
                time.sleep(1.0)
    finally:
        cluster.stop()
    print(
        f"killed: {killed} workers, {'the' if restarted else 'no'} scheduler;"
        f" the mesh was {'away for some seconds' if hidden else 'always there'}"
    )


if __name__ == "__main__":
    main()
