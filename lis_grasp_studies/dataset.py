"""Runs as a data set: touches, estimate, grasps and outcome of each, one row of a Parquet file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, LisGraspError, needed_package
from lis_grasp.exploration import Observation
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import Run
from lis_grasp.records import fields_of
from lis_grasp.results.folder import EARLIER, LOG, read_touches

_REPORT = "report.json"
_NAMES = ("object", "hand", "arm", "estimator", "simulator", "seed")
_ROWS = 16  # of a group of rows, which a reader loads at once

_Read = TypeVar("_Read")


def run_folders(folder: Path) -> list[Path]:
    """Return the folders of runs in a folder and below it, by their names.

    Raises `InvalidFileError` if there are none.
    """
    found = sorted(p.parent for p in folder.rglob(_REPORT) if EARLIER not in p.parts)
    if not found:
        raise InvalidFileError(
            f"{folder} and the folders below it have no run ({_REPORT}): name a folder in which"
            " `lis-grasp run` wrote",
            path=folder,
        )
    return found


def write_dataset(
    path: Path,
    folders: Sequence[Path],
    *,
    report: Callable[[int], None] = lambda done: None,
    skip: Callable[[Path, LisGraspError], None] | None = None,
) -> int:
    """Write runs as a Parquet file, one row each, and return their number.

    Parameters
    ----------
    path
        The file.
    folders
        Folders of runs.
    report
        Called with the number of rows so far.
    skip
        Called with a folder that cannot be read, and why; None to raise then.

    Examples
    --------
    >>> _ = run("box", "wsg50", folder="runs/0", known=True, prober="kinematic", touches=12)
    >>> write_dataset(Path("runs.parquet"), run_folders(Path("runs")))
    1
    >>> from pyarrow.parquet import read_table
    >>> row = read_table("runs.parquet").to_pylist()[0]
    >>> row["object"], row["lift"]["held"], len(row["contacts"]["points"])
    ('box', True, 12)
    """
    with needed_package("pyarrow", "study"):
        import pyarrow
        from pyarrow import parquet
    schema, count = _schema(), 0
    with (
        whole_file(path) as temporary,
        parquet.ParquetWriter(temporary, schema, compression="zstd") as writer,
    ):
        found = read_runs(folders, run_row, report, skip)
        while rows := list(islice(found, _ROWS)):
            writer.write_table(pyarrow.Table.from_pylist(rows, schema))
            count += len(rows)
    return count


def read_runs(
    folders: Sequence[Path],
    read: Callable[[Path], _Read],
    report: Callable[[int], None],
    skip: Callable[[Path, LisGraspError], None] | None,
) -> Iterator[_Read]:
    """Yield what is read of each run; `report` and `skip` as in `write_dataset`."""
    for number, folder in enumerate(folders, start=1):
        try:
            made = read(folder)
        except LisGraspError as error:
            if skip is None:
                raise
            skip(folder, error)
        else:
            yield made
        report(number)


def run_row(folder: Path) -> Row:
    """Return the row of a run; what it has not is None, and its true object if that is not found.

    Raises `InvalidFileError` if the folder has no run, or a file is damaged.
    """
    run = Run.load(folder)
    facts = run.facts
    if run.report is None:
        raise InvalidFileError(f"{folder} has no {_REPORT}: run it again", path=folder)
    log = folder / LOG
    probes = read_touches(log)[1] if log.is_file() else ()
    try:
        truth = None if run.truth is None else run.truth.mesh
    except LisGraspError:
        truth = None
    return {
        "run": folder.as_posix(),
        "version": facts.get("version"),
        **{name: run.report["config"].get(name) for name in _NAMES},
        "task": json.dumps(run.report["config"]),
        "probes": [_probe(probe.observation) for probe in probes],
        "contacts": None if run.contacts is None else _contacts(run.contacts),
        "estimate": _mesh(run.mesh),
        "truth": _mesh(truth),
        "grasps": [_grasp(grasp) for grasp in run.grasps or ()],
        "lift": {**run.lift, "grasp": _lifted(run)} if run.lift else None,
        "report": json.dumps(run.report),
    }


def _lifted(run: Run) -> int | None:
    """Return the index of the lifted grasp in the run's grasps."""
    attempts = (run.report or {}).get("attempts")
    return int(attempts[-1]["grasp"]) - 1 if attempts else None


def _probe(observation: Observation) -> Row:
    outcome = observation.outcome
    pose = outcome.hand_pose
    return {
        "status": outcome.status,
        "reason": outcome.reason,
        "target": outcome.probe.target,
        "direction": outcome.probe.direction,
        "seconds": outcome.duration,
        "contacts": len(outcome.contacts),
        "X_OH": None if pose is None else np.ravel(pose.X_OH),
        "joint_positions": None if pose is None else pose.joint_positions,
    }


def _contacts(contacts: Contacts) -> Row:
    left_out = ("free_points", "free_radii", "judged")
    return {n: _plain(value) for n, value in fields_of(contacts).items() if n not in left_out}


def _mesh(mesh: trimesh.Trimesh | None) -> Row | None:
    if mesh is None:
        return None
    return {
        "vertices": _plain(np.asarray(mesh.vertices)),
        "faces": _plain(np.asarray(mesh.faces)),
        "uncertainty": mesh.vertex_attributes.get("uncertainty"),
    }


def _grasp(grasp: Grasp) -> Row:
    return {name: _plain(value) for name, value in fields_of(grasp).items() if name != "accepted"}


def _plain(value: Any) -> Any:
    if not isinstance(value, np.ndarray) or value.ndim < 2:
        return value
    return np.ravel(value) if value.shape == (4, 4) else list(value)


def _schema() -> Any:
    """Return the columns of a data set and their types."""
    import pyarrow as pa

    number, text, texts = pa.float64(), pa.string(), pa.list_(pa.string())
    numbers, points = pa.list_(number), pa.list_(pa.list_(number, 3))
    vector, pose = pa.list_(number, 3), pa.list_(number, 16)
    mesh = pa.struct(
        {"vertices": points, "faces": pa.list_(pa.list_(pa.int32(), 3)), "uncertainty": numbers}
    )
    probe = {"status": text, "reason": text, "target": vector, "direction": vector}
    probe |= {"seconds": number, "contacts": pa.int32(), "X_OH": pose, "joint_positions": numbers}
    contacts = {"points": points, "normals": points, "forces": numbers, "times": numbers}
    contacts |= {"fingers": texts, "position_noise": numbers, "normal_noise": numbers}
    grasp = {"hand": text, "family": text, "X_OH": pose, "joint_names": texts}
    grasp |= {"joint_positions": numbers, "pregrasp_positions": numbers, "approach_O": vector}
    grasp |= {"contact_points": points, "contact_normals": points, "contact_fingers": texts}
    grasp |= {"contact_forces": points, "quality": pa.map_(text, number)}
    lift = {"grasp": pa.int32(), "held": pa.bool_(), "reason": text, "mass": number}
    lift |= {"slip": number, "turn": number}
    return pa.schema(
        {
            **dict.fromkeys(("run", "version", *_NAMES[:-1]), text),
            _NAMES[-1]: pa.int64(),
            "task": text,
            "probes": pa.list_(pa.struct(probe)),
            "contacts": pa.struct(contacts),
            "estimate": mesh,
            "truth": mesh,
            "grasps": pa.list_(pa.struct(grasp)),
            "lift": pa.struct(lift),
            "report": text,
        }
    )
