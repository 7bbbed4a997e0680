"""Experiments on whole programs: results and costs of commands, times of answers and of fits."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from lis_grasp import Contacts, extract_mesh, shapes
from lis_grasp.arms.use import violations
from lis_grasp.evaluation.surface_error import sample_mesh
from lis_grasp.exceptions import EstimationError, LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.surfaces import ESTIMATORS, judge_contacts
from lis_grasp.typing import FloatArray
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.test_objects.shape_sets import TEST_OBJECTS, build_shape

THIS, BESIDE = "this", "beside"
"""Variants of commands: this package, and another version in a folder."""

_PROGRAM = (sys.executable, "-m", "lis_grasp.cli.main")
# A small process between: on Linux a started program inherits the peak memory of its starter.
_STOPWATCH = """
import json, os, subprocess, sys, time
start = time.perf_counter()
command = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, use = os.wait4(command.pid, 0)
times = time.perf_counter() - start, use.ru_utime + use.ru_stime
print(json.dumps([os.waitstatus_to_exitcode(status), *times, use.ru_maxrss]))
"""
_QUERIES = 200_000
_MEASURED = 11  # answers, about the wanted number of contacts
_BUDGET = 0.5  # [s] of repetitions of one call


@dataclass(frozen=True, slots=True)
class CommandTrial:
    """A command line, run in a process of its own as by a user."""

    command: str
    """Verb and options, with ``{object}``, ``{seed}`` and the new folder ``{folder}``; commands
    before ``&&`` prepare it and are not measured."""
    object: str
    """Built-in shape, mesh file, or test object, which is written as a mesh file."""
    seed: int
    beside: str = field(default="", compare=False)
    """Folder of another version of the package."""

    def facts(self) -> Row:
        """Return the columns that identify the trial."""
        return {"command": self.command, "object": Path(self.object).stem, "seed": self.seed}


def measure_command(trial: CommandTrial, variant: str) -> Row:
    """Return the costs of a command, and facts of its report if it writes one.

    The processor time includes that of all processes of the command; the memory is the largest of
    one process [MB]. A command that fails is a row with its last sentence.
    """
    package = trial.beside if variant == BESIDE else str(Path(shapes.__file__).parents[2])
    paths = [package, os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    with tempfile.TemporaryDirectory() as folder:
        name = trial.object
        if name in TEST_OBJECTS:
            name = f"{folder}/{name}.stl"
            build_shape(trial.object).mesh.export(name)
        text = trial.command.format(object=name, seed=trial.seed, folder=folder)
        for words in map(shlex.split, text.split("&&")):
            row = _run([*_PROGRAM, *words], folder, environment)
            if row.get("reason"):
                return row
        report = Path(folder, "report.json")
        return row | (_of_report(json.loads(report.read_text())) if report.is_file() else {})


def _run(command: list[str], folder: str, environment: dict[str, str]) -> Row:
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        # The folder of the process is its own: Python would find the package of this one first.
        watch = [sys.executable, "-IS", "-c", _STOPWATCH, *command]
        output = subprocess.run(
            watch, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=errors, check=True
        ).stdout
        errors.seek(0)
        said = errors.read().strip().splitlines()
    status, wall, processor, memory = json.loads(output)
    row: Row = {"wall": wall, "processor": processor, "memory": memory / 1024.0}
    if status:
        row |= {"held": False, "reason": said[-1] if said else f"exit {status}"}
    return row


def _of_report(report: Row) -> Row:
    lift, arm = report["lift"], report.get("arm") or {}
    uses = [arm.get("touches"), *(attempt.get("arm") for attempt in report["attempts"])]
    uses = [use for use in uses if use is not None]
    return {
        **{name: lift.get(name) for name in ("held", "reason", "slip")},
        "attempts": len(report["attempts"]),
        "touches": report["touches"],
        "motion": report["exploration"]["seconds"],
        "rmsd": report["surface"]["rmsd"],
        "violations": violations(uses),
        "effort": max((use["effort"] for use in uses), default=None),
        "speed": max((use["speed"] for use in uses), default=None),
    }


@dataclass(frozen=True, slots=True)
class ServiceTrial:
    """Touches of an object that `lis-grasp next --serve` chooses."""

    object: str
    seed: int
    hand: str
    touches: int
    """Answers with about this number of contacts are measured."""


def measure_service(trial: ServiceTrial, estimator: str) -> list[Row]:
    """Return the time of each answer by this process's clock and by the service's processor."""
    shape = shapes.build(trial.object)
    options = ["--hand", trial.hand, "--estimator", estimator, "--seed", str(trial.seed)]
    center = [str(x) for x in shape.mesh.bounds.mean(axis=0)]
    options += ["--support", str(shape.mesh.bounds[0, 2]), "--size", str(shape.size)]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        command = [*_PROGRAM, "next", "--serve", *options, "--center", *center, "--output", folder]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        with subprocess.Popen(command, **pipes) as service:  # type: ignore[call-overload]

            def ask(request: Row) -> Row:
                service.stdin.write(json.dumps(request).encode() + b"\n")
                service.stdin.flush()
                answer: Row = json.loads(service.stdout.readline())
                return answer

            touch = ask({"request": "next"})
            for _ in range(4 * trial.touches):
                report = _felt(shape.mesh, np.array(touch["start"]), np.array(touch["end"]))
                start, before = time.perf_counter(), _processor_seconds(service.pid)
                touch = ask({"request": "next", **report})
                seconds = time.perf_counter() - start
                used = _processor_seconds(service.pid) - before
                if not touch["ok"] or touch["contacts"] > trial.touches + _MEASURED // 2:
                    break
                if abs(touch["contacts"] - trial.touches) <= _MEASURED // 2:
                    rows.append({"wall": seconds, "processor": used})
            ask({"request": "stop"})
    if not rows:
        raise EstimationError(f"the service must answer about {trial.object}; it did not")
    return rows


def _felt(mesh: trimesh.Trimesh, start: FloatArray, end: FloatArray) -> Row:
    """Return the contact of a point that moves, as a request reports it."""
    points, _, faces = mesh.ray.intersects_location([start], [end - start], multiple_hits=False)
    if not len(points) or np.linalg.norm(points[0] - start) > np.linalg.norm(end - start):
        return {"status": "missed", "free_points": [start.tolist()]}
    normals = mesh.face_normals[faces].tolist()
    return {"points": points.tolist(), "normals": normals, "free_points": [start.tolist()]}


def _processor_seconds(process: int) -> float:
    """Return the processor time of another process, which the kernel counts in steps of 10 ms."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class FitTrial:
    """Contacts spread over the mallet of 0.20 m."""

    contacts: int
    seed: int


def measure_fit(trial: FitTrial, estimator: str) -> Row:
    """Return the shortest times of a fit, of the field at a point, of a mesh and of the judgement.

    The field is evaluated within a spacing of the surface; the mesh has cells of 1/64 of the
    object; memory is the peak while fitting (tracemalloc, NumPy's arrays) [B].
    """
    shape = shapes.build("mallet", shapes.PAPER_SIZE)
    points, faces = sample_mesh(shape.mesh, trial.contacts)
    contacts = Contacts(points, np.asarray(shape.mesh.face_normals)[faces])
    rng = np.random.default_rng(trial.seed)
    aside = contacts.spacing * rng.uniform(-1.0, 1.0, (_QUERIES, 3))
    queries = contacts.points[rng.integers(len(points), size=_QUERIES)] + aside
    make = ESTIMATORS[estimator]
    try:
        surface = make(contacts)
        tracemalloc.start()
        make(contacts)
        memory = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return {
            "fit": _best_time(lambda: make(contacts)),
            "field": _best_time(lambda: surface.evaluate(queries)) / _QUERIES,
            "mesh": _best_time(lambda: extract_mesh(surface, resolution=shape.size / 64)),
            "memory": memory,
            "judge": _best_time(lambda: judge_contacts(contacts)),
        }
    except LisGraspError as error:
        return {"failure": str(error)}


def _best_time(function: Callable[[], Any]) -> float:
    """Return the shortest time of a call [s], of as many calls as fit into the budget."""
    least, spent = np.inf, 0.0
    while spent < _BUDGET:
        start = time.perf_counter()
        function()
        taken = time.perf_counter() - start
        least, spent = min(least, taken), spent + taken
    return float(least)


COMMANDS = Experiment("commands", measure_command, CommandTrial.facts, variant="package")
SERVICE = Experiment("service", measure_service, asdict)
FITS = Experiment("fits", measure_fit, asdict)
"""The experiments; the variants of the last two are estimators."""
