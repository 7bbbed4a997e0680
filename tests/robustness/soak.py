"""Explore, estimate and grasp many times in one process; check that no resource accumulates.

    python tests/robustness/soak.py                  # 1000 cycles, almost an hour
    python tests/robustness/soak.py --cycles 60      # a few minutes
    python tests/robustness/soak.py --meshes mug.obj can.stl

A cycle runs `explore`, `estimate` and `grasp` in this process, with a random object, hand and
estimator; touches are kinematic. In the first and every twentieth cycle after it the hand touches
in Drake, the best grasp is lifted, and the scene is written. Each cycle has a folder, which is
removed after it.

After every cycle garbage is collected and free memory is returned to the system. Then these are
counted: resident memory, Python's threads, the process's threads, open files, and files in the
folder for temporary files. The first cycles, which import modules and fill caches, are warm-up. Of
the rest, the median of the last fifth may exceed that of the first by 5 % in memory and by nothing
in threads and open files; no temporary file may be left. Exit code 1 if that is violated, or if a
command failed. Ctrl-C and SIGTERM print the results so far.

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
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from lis_grasp.cli.main import main as run_verb
from lis_grasp.robots.shipped_models import HAND_NAMES
from lis_grasp.shapes import NAMES
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp.visualization.run_scene import write_scene_of

# One cycle in this many touches in Drake, lifts, and writes a scene.
_THOROUGH = 20
# Warm-up, as a fraction of the cycles; and the allowed growth of memory after it.
_WARM_UP = 0.1
_GROWTH = 0.05

_INTERRUPTED = 130


@dataclass(frozen=True)
class Counts:
    """Resources of the process after a cycle.

    Parameters
    ----------
    memory
        Resident [MB].
    python_threads, threads, files
        Threads known to Python, all threads of the process, and open file descriptors.
    temporary
        Files and folders in the folder for temporary ones.
    """

    memory: float
    python_threads: int
    threads: int
    files: int
    temporary: int


def count(scratch: Path) -> Counts:
    """Collect garbage, return free memory to the system, and count resources."""
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


def cycle(rng: np.random.Generator, objects: Sequence[str], *, thorough: bool) -> list[str]:
    """Explore, estimate and grasp; return the command that failed, if any."""
    hand = str(rng.choice(HAND_NAMES))
    commands = {
        "explore": ["explore", str(rng.choice(objects)), "--hand", hand],
        "estimate": ["estimate", "contacts.ply", "--estimator", str(rng.choice(list(ESTIMATORS)))],
        "grasp": ["grasp", "surface.ply", "--hand", hand, "--grasps", "2"],
    }
    commands["explore"] += [
        *("--prober", "dynamic" if thorough else "kinematic"),
        *("--touches", str(rng.integers(10, 16))),
        *("--estimator", str(rng.choice(list(ESTIMATORS)))),
        *("--seed", str(rng.integers(2**31))),
        *("--position-noise", str(rng.choice([0.0, 0.001]))),
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if thorough:
            commands["lift"] = ["lift", "grasps.json", "--jobs", "1"]
        for verb, command in commands.items():
            if verb != "explore":
                command[1] = str(folder / command[1])
            if run_quietly([*command, "--output", name]):
                return [" ".join(command)]
        if thorough:
            write_scene_of(folder)
    return []


def run_quietly(command: list[str]) -> int:
    """Run a command in this process; print its output if it failed."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        code = run_verb(command)
    if code == _INTERRUPTED:
        raise KeyboardInterrupt
    if code:
        print(output.getvalue(), end="", flush=True)
    return code


def soak(cycles: int, objects: Sequence[str], seed: int) -> tuple[list[Counts], list[str]]:
    """Run the cycles; return the counts after each, and the failed commands."""
    counts, failed = [], []
    start, before = time.monotonic(), tempfile.tempdir
    with tempfile.TemporaryDirectory(prefix="soak-") as name:
        tempfile.tempdir, scratch = name, Path(name)  # this process's folder for temporary files
        try:
            for index in range(cycles):
                rng = np.random.default_rng([seed, index])
                thorough = index % _THOROUGH == 0
                failed += [f"cycle {index}: {f}" for f in cycle(rng, objects, thorough=thorough)]
                counts.append(count(scratch))
                if index == 0 or (index + 1) % max(1, cycles // 25) == 0:
                    print_row(index + 1, time.monotonic() - start, counts[-1])
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        finally:
            tempfile.tempdir = before
    return counts, failed


def print_row(cycles: int, seconds: float, counts: Counts) -> None:
    if cycles == 1:
        print("| cycles | seconds | memory [MB] | python threads | threads | files | temporary |")
        print("|---|---|---|---|---|---|---|")
    memory, *numbers = astuple(counts)
    row = [f"{cycles}", f"{seconds:.0f}", f"{memory:.1f}", *map(str, numbers)]
    print(f"| {' | '.join(row)} |", flush=True)


def growth(counts: Sequence[Counts]) -> dict[str, tuple[float, float]]:
    """Return the medians of each count over the first and the last fifth after the warm-up."""
    settled = counts[round(_WARM_UP * len(counts)) :]
    fifth = max(1, len(settled) // 5)
    medians = {}
    for field in fields(Counts):
        values = [getattr(c, field.name) for c in settled]
        first, last = np.median(values[:fifth]), np.median(values[-fifth:])
        medians[field.name] = (float(first), float(last))
    return medians


def faults_of(counts: Sequence[Counts]) -> list[str]:
    """Return a sentence for each resource that accumulated."""
    faults = []
    for name, (first, last) in growth(counts).items():
        allowed = first * (1.0 + _GROWTH) if name == "memory" else first
        if last > allowed:
            faults.append(f"{name} grew from {first:g} to {last:g}")
    if counts[-1].temporary:
        faults.append(f"{counts[-1].temporary} temporary files are left")
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cycles", type=int, default=1000)
    parser.add_argument("--meshes", nargs="*", default=[], help="mesh files, beside the built-ins")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    counts, failed = soak(options.cycles, [*NAMES, *options.meshes], options.seed)
    if not counts:
        return 1
    print("\n| after warm-up | first fifth | last fifth | change |")
    print("|---|---|---|---|")
    for name, (first, last) in growth(counts).items():
        change = f"{100 * (last / first - 1):+.2f} %" if first else f"{last:+g}"
        print(f"| {name} | {first:.1f} | {last:.1f} | {change} |")
    faults = [*failed, *faults_of(counts)]
    for fault in faults:
        print(fault)
    print(f"{len(counts)} cycles, {len(failed)} commands failed")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
