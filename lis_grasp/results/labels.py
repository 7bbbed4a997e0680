"""Labels of grasps: the outcome of a simulated lift of each, resumable, in many processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import trimesh

from lis_grasp.exceptions import EstimationError, require_packages
from lis_grasp.grasping.export import save_grasp_table
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import sole_writer
from lis_grasp.io.json_lines import MADE_AGAIN, append_lines, read_lines
from lis_grasp.results.folder import set_aside
from lis_grasp.results.lifted_file import lifting_of
from lis_grasp.results.progress import SILENT, Progress
from lis_grasp.results.report import ranked_facts
from lis_grasp.stages.lift import lift_object
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.worker_pool import process_count, worker_pool
from lis_grasp.version import __version__

LABELS = "labels.jsonl"
"""The log of the outcomes."""

_TABLE = "grasps.parquet"

Job = tuple[int, Grasp]
"""The rank of a grasp, from 1, and the grasp."""

Runner = Callable[[Callable[[Job], dict[str, Any]], Sequence[Job]], Iterator[dict[str, Any]]]
"""Calls a function with each job, on any machine, and yields the results in any order."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledFile:
    """Grasps with outcomes in a file."""

    path: Path
    search: GraspSearch
    labels: Sequence[Mapping[str, Any]]  #: of the grasps in order; see `ranked_facts`


def label_file(
    path: Path,
    folder: Path | None = None,
    *,
    jobs: int | None = None,
    runner: Runner | None = None,
    progress: Progress = SILENT,
    **options: Any,
) -> LabelledFile:
    """Simulate the lift of every grasp in a file, and write the grasps with their outcomes.

    The same call continues from labels.jsonl, unless the grasps, the object or an option have
    changed. For further arguments and errors see `lift_file`.

    Parameters
    ----------
    runner
        Runs the lifts, on a cluster for example; None for `jobs` processes of this machine.

    Examples
    --------
    >>> _ = shapes.find("box").mesh.export("box.stl")
    >>> _ = pipeline.grasp_file(Path("box.stl"), hand="wsg50", grasps=1)
    >>> made = pipeline.label_file(Path("grasps.json"), object="box", jobs=1)
    >>> made.path.name, made.labels[0]["held"]
    ('grasps.parquet', True)
    """
    require_packages("pyarrow", extra="study", option="a label")
    work = lifting_of(path, options, progress)
    scenario, grasps = work.scenario, work.search.grasps
    if runner is None:
        runner = partial(_in_processes, process_count(jobs))
    folder = path.parent if folder is None else folder
    header = {"labels": 1, "version": __version__, "grasps_digest": provenance.digest_of(path)}
    file = Path(scenario.task.world.object)
    digest = {"object_digest": provenance.digest_of(file)} if file.is_file() else {}
    header |= {**scenario.task.facts(), **scenario.facts(), **digest}
    log = folder / LABELS
    with sole_writer(folder):
        recorded, rows = read_lines(log, advice=MADE_AGAIN)
        if recorded != header:
            set_aside([log, folder / _TABLE], progress, "of other grasps or options")
            rows = []
        labels = {row["rank"]: row for row in rows}
        waiting = [job for job in enumerate(grasps, start=1) if job[0] not in labels]
        if labels:
            progress.say(f"resuming after {len(labels)} of {len(grasps)} lifts in {log}")
        with progress.stage(f"Lifting {scenario.truth.shape.name}") as stage:
            for row in runner(partial(_label, scenario, work.estimate), waiting):
                append_lines(log, header, [row])
                labels[row["rank"]] = row
                stage.count(len(labels), len(grasps))
            held = sum(row["held"] for row in labels.values())
            stage.result = f"held {held} of {len(grasps)}"
        in_order = [labels[rank] for rank in range(1, len(grasps) + 1)]
        table = folder / _TABLE
        save_grasp_table(table, grasps, in_order, header=provenance.merge(work.recorded, **header))
    return LabelledFile(table, work.search, in_order)


def _label(scenario: Scenario, estimate: trimesh.Trimesh | None, job: Job) -> dict[str, Any]:
    rank, grasp = job
    return ranked_facts(rank, scenario, lift_object(scenario, grasp, estimate=estimate))


def _in_processes(
    processes: int, label: Callable[[Job], dict[str, Any]], jobs: Sequence[Job]
) -> Iterator[dict[str, Any]]:
    if processes == 1 or len(jobs) < 2:
        yield from map(label, jobs)
        return
    with worker_pool(min(processes, len(jobs))) as pool:
        try:
            for future in as_completed([pool.submit(label, job) for job in jobs]):
                yield future.result()
        except BrokenProcessPool:
            raise EstimationError(
                "a process that lifted was killed, perhaps as memory ran out: the same command goes"
                " on, with fewer `jobs` if it happens again"
            ) from None
