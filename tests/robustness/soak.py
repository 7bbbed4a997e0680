"""Explore, estimate and grasp many times in one process; check that no resource accumulates.

    python tests/robustness/soak.py --cycles 60      # a few minutes; 1000 take almost an hour
    python tests/robustness/soak.py --cycles 200 --explorations 8      # of 8 touches each

A cycle runs `explore`, `estimate` and `grasp` in this process, with a random object, hand and
estimator; touches are kinematic. With `--explorations` a cycle only explores; else, in the first
and every twentieth cycle after it, the hand touches in Drake, the best grasp is lifted, and the
scene is written. After every cycle garbage is collected, free memory is returned to the system, and
resources are counted. The first cycles, which import modules and fill caches, are warm-up. Of the
rest, the median of the last fifth may exceed that of the first by 5 % in memory and by nothing in
threads and open files; no temporary file may be left. Exit code 1 if that is violated, or if a
command failed.

Blocks that C libraries keep in the heap of a thread ("arena") cannot be returned from here: set
MALLOC_ARENA_MAX=1 to distinguish used from kept memory.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import gc
import io
import os
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from lis_grasp.cli.main import main as run_verb
from lis_grasp.results.page import write_scene_of
from lis_grasp.robots.shipped_models import HAND_NAMES
from lis_grasp.shapes import NAMES
from lis_grasp.surfaces import ESTIMATORS

_THOROUGH = 20  # one cycle in so many touches in Drake, lifts, and writes a scene
_WARM_UP = 0.1  # fraction of the cycles
_GROWTH = 0.05  # that is allowed to memory after it


@dataclass(frozen=True)
class Counts:
    """Resources of the process after a cycle; memory in MB, files that are open."""

    memory: float
    python_threads: int
    threads: int
    files: int
    temporary: int


def _count(scratch: Path) -> Counts:
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return Counts(
        pages * os.sysconf("SC_PAGESIZE") / 1e6,
        threading.active_count(),
        len(os.listdir("/proc/self/task")),
        len(os.listdir("/proc/self/fd")),
        sum(1 for _ in scratch.rglob("*")),
    )


def _cycle(
    rng: np.random.Generator, objects: Sequence[str], touches: int | None, *, thorough: bool
) -> list[str]:
    """Explore, without `touches` estimate and grasp too; return the command that failed, if any."""
    hand, estimators = str(rng.choice(HAND_NAMES)), list(ESTIMATORS)
    prober = "dynamic" if thorough else "kinematic"
    with tempfile.TemporaryDirectory() as name:
        commands = [
            f"explore {rng.choice(objects)} --hand {hand}"
            f" --prober {prober} --touches {touches or rng.integers(10, 16)}"
            f" --estimator {rng.choice(estimators)} --seed {rng.integers(2**31)}"
            f" --position-noise {rng.choice([0.0, 0.001])}",
            f"estimate {name}/contacts.ply --estimator {rng.choice(estimators)}",
            f"grasp {name}/surface.ply --hand {hand} --grasps 2",
            *([f"lift {name}/grasps.json --jobs 1"] if thorough else []),
        ]
        for command in commands[: 1 if touches else None]:
            output = io.StringIO()
            with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
                code = run_verb([*command.split(), "--output", name])
            if code:
                print(output.getvalue(), end="", flush=True)
                return [command]
        if thorough:
            write_scene_of(Path(name))
    return []


def soak(
    cycles: int, objects: Sequence[str], seed: int, touches: int | None = None
) -> tuple[list[Counts], list[str]]:
    """Run the cycles; return the counts after each, and the failed commands."""
    counts, failed = [], []
    before = tempfile.tempdir
    with tempfile.TemporaryDirectory(prefix="soak-") as name:
        tempfile.tempdir = name  # this process's folder for temporary files
        try:
            for index in range(cycles):
                rng = np.random.default_rng([seed, index])
                thorough = touches is None and index % _THOROUGH == 0
                faults = _cycle(rng, objects, touches, thorough=thorough)
                failed += [f"cycle {index}: {fault}" for fault in faults]
                counts.append(_count(Path(name)))
                print(index + 1, counts[-1], flush=True)
        finally:
            tempfile.tempdir = before
    return counts, failed


def faults_of(counts: Sequence[Counts]) -> list[str]:
    """Return a sentence for each resource that accumulated."""
    settled = counts[round(_WARM_UP * len(counts)) :]
    fifth = max(1, len(settled) // 5)
    faults = []
    for name in (field.name for field in fields(Counts)):
        values = [getattr(c, name) for c in settled]
        first, last = float(np.median(values[:fifth])), float(np.median(values[-fifth:]))
        if last > first * (1.0 + _GROWTH if name == "memory" else 1.0):
            faults.append(f"{name} grew from {first:g} to {last:g}")
    if counts[-1].temporary:
        faults.append(f"{counts[-1].temporary} temporary files are left")
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cycles", type=int, default=1000)
    parser.add_argument("--meshes", nargs="*", default=[], help="mesh files, beside the built-ins")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--explorations", type=int, metavar="TOUCHES", help="and nothing else")
    options = parser.parse_args()
    objects = [*NAMES, *options.meshes]
    counts, failed = soak(options.cycles, objects, options.seed, options.explorations)
    faults = [*failed, *faults_of(counts)]
    print("\n".join([*faults, f"{len(counts)} cycles, {len(failed)} commands failed"]))
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
