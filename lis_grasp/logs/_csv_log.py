"""Logs that are CSV tables: forces, poses and joint positions in the columns of one row."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidFileError, note
from lis_grasp.io.csv_tables import (
    ANGLES,
    SECONDS,
    column_numbers,
    factor_of,
    read_table,
    without_unit,
)
from lis_grasp.logs._columns import FORCES, POINT, read_columns
from lis_grasp.logs._streams import (
    LONGEST_GAP,
    FrameTree,
    JointSeries,
    TimedForces,
    TimedPoses,
    Topic,
)
from lis_grasp.logs.reading import LogReading
from lis_grasp.typing import FloatArray

_OTHERS = {"velocity", "effort"}  # other values of joints
_LEAST_STEP = 1e-4  # [s], of a log in the right unit


class CsvLog:
    """Forces and poses of a CSV table: the topics `force`, `tip` and, if it is there, `object`."""

    def __init__(
        self, path: Path, *, posed: bool = True, reading: LogReading = LogReading()
    ) -> None:
        """Read a table, with the tip if `posed`; `InvalidFileError` if it lacks columns.

        Columns may have the names in bags, as ``wrench.force.x``, and state units, as ``time_ms``.
        Rows that repeat a time are spread, in order, up to the next time.
        """
        self._path, self._reading = path, reading
        self._columns = columns = read_columns(path)
        self._force = next((names for names in FORCES if columns.has("tip", names)), ())
        timed = ("", "time") in columns.values
        if not timed or not self._force or (posed and not columns.has("tip", POINT)):
            raise InvalidFileError(
                f"a log as CSV needs the columns time, fx,fy,fz or force, and x,y,z of the tip;"
                f" {path} has {', '.join(read_table(path)[0])}",
                path=path,
            )
        self._times = _in_order(path, columns.values["", "time"])
        self._require_order()
        count = len(self._times)
        known = [body for body in ("tip", "object") if columns.has(body, POINT)]
        titles = columns.titles
        forces = ",".join(titles["tip", name] for name in self._force)
        self.topics = (
            Topic("force", forces, count, "force"),
            *(
                Topic(body, ",".join(titles[body, n] for n in self._names(body)), count, "pose")
                for body in known
            ),
        )
        used = {titles["", "time"], *(titles["tip", name] for name in self._force)}
        used |= {titles[body, name] for body in known for name in self._names(body)}
        self.unused = (*columns.unused, *(t for t in titles.values() if t not in used))

    def forces(self, topic: str) -> TimedForces:
        """Return the forces, in a frame that the table does not name."""
        order = np.argsort(self._times, kind="stable")
        return TimedForces(self._times[order], self._columns.table("tip", self._force)[order])

    def poses(self, topic: str) -> TimedPoses:
        """Return the poses of `tip` or `object`; unturned without columns of an orientation."""
        positions = self._columns.table(topic, POINT)
        quaternions = self._columns.quaternions(topic, self._reading.orientation)
        values = np.hstack([positions, quaternions])
        return TimedPoses.collect(self._times, values, child=topic, name=topic)

    def frames(self) -> FrameTree:
        """Return no transforms: a table has none."""
        return FrameTree({})

    def joints(self, names: tuple[str, ...]) -> dict[str, list[JointSeries]]:
        """Return positions of joints whose columns have their names, also as in bags.

        Examples are ``elbow``, ``/joint_states/elbow/position`` and ``position.elbow``.
        """
        titles, rows = read_table(self._path)
        lowered = {name.lower(): name for name in names}
        found: dict[str, list[JointSeries]] = {}
        for k, title in enumerate(titles):
            text, unit = without_unit(title) if title.lower() not in lowered else (title, "")
            parts = set(re.split(r"[./]", text))
            for name in parts & lowered.keys() if not _OTHERS & parts else ():
                factor = factor_of(self._path, title, unit, {**ANGLES, "m": 1.0, "mm": 1e-3})
                positions = factor * column_numbers(self._path, rows, k, title)
                found.setdefault(lowered[name], []).append(
                    JointSeries(title, self._times, positions)
                )
        return found

    def joint_names(self) -> tuple[str, ...]:
        """Return the columns that are not understood; some may be joints."""
        return self._columns.unused

    def _names(self, body: str) -> tuple[str, ...]:
        ignored = self._reading.orientation == "ignored"
        return (*POINT, *(() if ignored else self._columns.turn_names(body)))

    def _require_order(self) -> None:
        """Raise if times go back but the tip's path does not: the table has two recordings."""
        if not self._columns.has("tip", POINT) or not np.any(np.diff(self._times) < 0.0):
            return
        path = self._columns.table("tip", POINT)
        path, times = path[np.isfinite(path).all(axis=1)], self._times
        times = times[np.isfinite(self._columns.table("tip", POINT)).all(axis=1)]
        in_rows, in_time = (
            float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
            for way in (path, path[np.argsort(times, kind="stable")])
        )
        if in_time > 2.0 * in_rows:
            back = int(np.flatnonzero(np.diff(self._times) < 0.0)[0]) + 2
            raise InvalidFileError(
                f"times of {self._path} go back in row {back}: in their order the tip would travel"
                f" {in_time:.3g} m, in that of the rows {in_rows:.3g} m: give each recording a"
                " table of its own",
                path=self._path,
            )


def _in_order(path: Path, times: FloatArray) -> FloatArray:
    """Return the times of rows; those that repeat a time are spread, in order, up to the next one.

    Raises `InvalidFileError` if all times are equal, or rows are too far apart to interpolate
    poses.
    """
    known = np.isfinite(times)
    stamps, group, counts = np.unique(times[known], return_inverse=True, return_counts=True)
    repeated = int(known.sum()) - len(stamps)
    if len(stamps) == 1 and repeated:
        raise InvalidFileError(
            f"all rows of {path} have the time {stamps[0]:.10g}: save it with all its digits, or"
            " add a column with finer times",
            path=path,
        )
    steps = np.diff(stamps)
    step = float(np.median(steps)) if len(steps) else 0.0
    if step > LONGEST_GAP:
        units = [u for u, s in SECONDS.items() if _LEAST_STEP <= step * s <= LONGEST_GAP]
        advice = f"if they are {units[0]}, name the column time_{units[0]}"
        if not units or 2 * repeated > int(known.sum()):
            rows = f"{repeated} of {int(known.sum())} rows repeat a time" if repeated else ""
            advice = f"{rows}: give finer times" if rows else "log faster"
        raise InvalidFileError(
            f"rows of a log must be at most {LONGEST_GAP:g} s apart; those of {path} are {step:g}"
            f" apart (median of column time): {advice}",
            path=path,
        )
    if not repeated:
        return times
    note(
        f"{path}: {repeated} of {int(known.sum())} rows repeat a time; they are taken in order,"
        " evenly up to the next time"
    )
    order = np.argsort(group, kind="stable")
    rank = np.empty(len(group))
    rank[order] = np.arange(len(group)) - np.repeat(np.cumsum(counts) - counts, counts)
    gaps = np.minimum(np.append(steps, step), step)
    spread = times.copy()
    spread[known] = stamps[group] + gaps[group] * rank / counts[group]
    return spread
