"""Robots' logs as CSV tables: one row for each moment.

The columns are ``time`` [s]; ``force`` [N] or ``fx,fy,fz``; the tip ``x,y,z`` [m], optionally
``qx,qy,qz,qw``; the object, optionally, ``ox,oy,oz`` and ``oqx,oqy,oqz,oqw``. Forces are in the
frame of the tip if that has an orientation, else in the frame of the poses.
"""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.csv_tables import SECONDS, numbers, read_table, without_unit
from lis_grasp.io.units import UNITS
from lis_grasp.logs._streams import LONGEST_GAP, FrameTree, TimedForces, TimedPoses, Topic
from lis_grasp.typing import FloatArray

_FORCES = (("fx", "fy", "fz"), ("force",))
_POSES = {
    "tip": (("x", "y", "z"), ("qx", "qy", "qz", "qw")),
    "object": (("ox", "oy", "oz"), ("oqx", "oqy", "oqz", "oqw")),
}
_COLUMNS = {"time", *chain.from_iterable((*_FORCES, *chain.from_iterable(_POSES.values())))}
# Columns of a bag as PlotJuggler and others write them: /ft/wrench/force/x, pose.position.x.
_OF_BAG = re.compile(r"(?:.*[./])?(force|position|orientation)[./_]([xyzw])")
_OF_BAG_NAMES = {"force": "f", "position": "", "orientation": "q"}
_OTHERS = {"velocity", "effort"}  # of joints
_LEAST_STEP = 1e-4  # [s], of a log in the right unit


class CsvLog:
    """Forces and poses of a CSV table: the topics `force`, `tip` and, if it is there, `object`."""

    def __init__(self, path: Path, *, posed: bool = True) -> None:
        """Read a table, with the tip if `posed`; `InvalidFileError` if it lacks columns, or more.

        Columns are those of bags too, as ``wrench.force.x``, and may state units, as ``time_ms``.
        """
        self._path, self._columns = path, _known_columns(path)
        present = set(self._columns)
        self._force = next((names for names in _FORCES if present >= set(names)), ())
        if "time" not in present or not self._force or (posed and not present >= set("xyz")):
            raise InvalidFileError(
                f"a log as CSV needs the columns time, fx,fy,fz or force, and x,y,z of the tip;"
                f" {path} has {', '.join(read_table(path)[0])}",
                path=path,
            )
        _require_seconds(path, self._columns["time"])
        count = len(self._columns["time"])
        known = [name for name, (point, _) in _POSES.items() if present >= set(point)]
        self.topics = (
            Topic("force", ",".join(self._force), count, "force"),
            *(Topic(name, ",".join(_POSES[name][0]), count, "pose") for name in known),
        )

    def forces(self, topic: str) -> TimedForces:
        """Return the forces."""
        turned = "qx" in self._columns
        order = np.argsort(self._columns["time"], kind="stable")
        values = self._table(self._force)[order]
        return TimedForces(self._columns["time"][order], values, "tip" if turned else "")

    def poses(self, topic: str) -> TimedPoses:
        """Return the poses of `tip` or `object`; without quaternions they are not turned."""
        point, turn = _POSES[topic]
        positions = self._table(point)
        unturned = np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))
        quaternions = self._table(turn) if set(turn) <= set(self._columns) else unturned
        values = np.hstack([positions, quaternions])
        return TimedPoses.collect(self._columns["time"], values, child=topic, name=topic)

    def frames(self) -> FrameTree:
        """Return no transforms: a table has none."""
        return FrameTree({})

    def joints(self, names: tuple[str, ...]) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Return times and positions of joints whose columns have their names, as of bags too.

        Such as ``elbow``, ``/joint_states/elbow/position`` or ``position.elbow``.
        """
        titles, rows = read_table(self._path)
        found = {}
        for k, title in enumerate(titles):
            parts = re.split(r"[./]", title)
            for name in set(parts) & set(names) if not _OTHERS & set(parts) else ():
                found[name] = (self._columns["time"], numbers(self._path, rows, k, title))
        return found

    def _table(self, names: tuple[str, ...]) -> FloatArray:
        return np.column_stack([self._columns[name] for name in names])


def _known_columns(path: Path) -> dict[str, FloatArray]:
    """Return the columns of a log that are read, in metres and seconds, by their names here."""
    names, rows = read_table(path)
    columns: dict[str, FloatArray] = {}
    for k, full in enumerate(names):
        name, unit = without_unit(full)
        if of_bag := _OF_BAG.fullmatch(name):
            name = _OF_BAG_NAMES[of_bag[1]] + of_bag[2]
        name = "time" if name in ("timestamp", "stamp", "__time") else name
        if name not in _COLUMNS:
            continue
        if name == "time" and name in columns:
            continue
        if name in columns:
            message = f"{path} has two columns for {name}; the second is {full}: keep one"
            raise InvalidFileError(message, path=path)
        columns[name] = numbers(path, rows, k, full) * {**UNITS, **SECONDS}.get(unit, 1.0)
    return columns


def _require_seconds(path: Path, times: FloatArray) -> None:
    """Raise if rows of a log are farther apart than poses are interpolated."""
    steps = np.diff(np.unique(times[np.isfinite(times)]))
    step = float(np.median(steps)) if len(steps) else 0.0
    if step <= LONGEST_GAP:
        return
    units = [u for u, s in SECONDS.items() if _LEAST_STEP <= step * s <= LONGEST_GAP]
    advice = f"if they are {units[0]}, name the column time_{units[0]}" if units else "log faster"
    raise InvalidFileError(
        f"rows of a log must be at most {LONGEST_GAP:g} s apart; those of {path} are {step:g} apart"
        f" (median of column time): {advice}",
        path=path,
    )
