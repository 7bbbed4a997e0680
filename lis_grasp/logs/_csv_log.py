"""Logs that are CSV tables: forces, poses and joint positions in the columns of one row."""

from __future__ import annotations

import re
from collections.abc import Collection
from contextlib import suppress
from copy import copy
from itertools import chain
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidFileError, note
from lis_grasp.io.csv_tables import (
    ANGLES,
    SECONDS,
    column_numbers,
    factor_of,
    without_unit,
)
from lis_grasp.logs._column_names import (
    FORCES,
    JOINT_ARRAYS,
    POINT,
    TIME,
    array_element,
)
from lis_grasp.logs._columns import read_columns
from lis_grasp.logs._orientations import Turns, find_turns, form_of, quaternions_of
from lis_grasp.logs._streams import (
    LONGEST_GAP,
    JointSeries,
    RobotLog,
    TimedForces,
    TimedPoses,
    Topic,
)
from lis_grasp.logs.reading import LogReading
from lis_grasp.typing import FloatArray

_OTHERS = {"velocity", "effort"}  # other values of joints
_LEAST_STEP = 1e-4  # [s], of a log in the right unit


class CsvLog(RobotLog):
    """Forces and poses of a CSV table: the topics `force`, `tip` and, if it is there, `object`."""

    unit_advice = "if its positions are in millimetres, name the columns x_mm,y_mm,z_mm"

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
                f" {path} has {', '.join(columns.names)}",
                path=path,
            )
        title = columns.titles["", "time"]
        self._times = _in_order(path, columns.values["", "time"], title)
        self._require_order()
        count = len(self._times)
        self._turns: dict[str, Turns | None] = {}
        forces = columns.named("tip", self._force)
        poses: dict[str, tuple[str, ...]] = {}
        for body in ("tip", "object"):
            if columns.has(body, POINT):
                poses[body] = columns.named(body, POINT)
                with suppress(InvalidFileError):  # raised when the poses are asked for
                    poses[body] += turns.titles if (turns := self._turns_of(body)) else ()
        self.topics = (
            Topic("force", ",".join(forces), count, "force"),
            *(Topic(body, ",".join(names), count, "pose") for body, names in poses.items()),
        )
        used = {columns.titles["", "time"], *forces, *chain.from_iterable(poses.values())}
        others = (*columns.unused, *columns.titles.values())
        self.unused = tuple(title for title in others if title not in used)

    def forces(self, topic: str) -> TimedForces:
        """Return the forces, in the base frame if names of a robot's arrays state it."""
        order = np.argsort(self._times, kind="stable")
        forces = self._columns.table("tip", self._force)[order]
        return TimedForces(self._times[order], forces, self._columns.force_frame)

    def poses(self, topic: str) -> TimedPoses:
        """Return the poses of `tip` or `object`; unturned without columns of an orientation."""
        positions = self._columns.table(topic, POINT)
        quaternions = np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))
        if (turns := self._turns_of(topic)) is not None:
            quaternions = quaternions_of(turns, self._reading.orientation, self._columns)
        values = np.hstack([positions, quaternions])
        return TimedPoses.collect(self._times, values, self.base, topic, topic)

    def joints(self, names: tuple[str, ...]) -> dict[str, list[JointSeries]]:
        """Return positions of joints whose columns have their names, also as in bags.

        Examples are ``elbow``, ``/joint_states/elbow/position`` and ``position.elbow``, and
        ``actual_q_2`` of an arm of UR.
        """
        lowered = {name.lower(): name for name in names}
        found: dict[str, list[JointSeries]] = {}
        for k, title in enumerate(self._columns.names):
            text, unit = without_unit(title) if title.lower() not in lowered else (title, "")
            parts = set(re.split(r"[./]", text))
            named = (parts & lowered.keys()) or _joints_of(text, lowered.keys())
            for name in named if not _OTHERS & parts else ():
                factor = factor_of(self._path, title, unit, {**ANGLES, "m": 1.0, "mm": 1e-3})
                positions = factor * column_numbers(self._path, self._columns.rows, k, title)
                found.setdefault(lowered[name], []).append(
                    JointSeries(title, self._times, positions)
                )
        return found

    def joint_names(self) -> tuple[str, ...]:
        """Return the columns that are not understood; some may be joints."""
        return self._columns.unused

    def other_readings(self) -> dict[str, CsvLog]:
        """Return the log with other meanings of the tip's orientation, by the advice to take it."""
        reading, columns, turns = self._reading, self._columns, None
        with suppress(InvalidFileError):  # of several, none can be proposed
            turns = find_turns(columns, "tip", reading.angles)
        if turns is None:
            return {}
        ignored = reading.orientation == "ignored"
        form = "ignored" if ignored else form_of(turns, reading.orientation, columns)
        own = None if ignored else quaternions_of(turns, form, columns)
        found: dict[str, CsvLog] = {}
        for other in turns.others():
            quaternions = quaternions_of(other, None, columns)
            if own is None or not np.array_equal(quaternions, own, equal_nan=True):
                log = copy(self)
                log._turns = self._turns | {"tip": other}
                found[other.advice(form, turns)] = log
        return found

    def _turns_of(self, body: str) -> Turns | None:
        """Return the columns of a body's orientation, unless they are ignored."""
        if body not in self._turns:
            ignored = self._reading.orientation == "ignored"
            found = None if ignored else find_turns(self._columns, body, self._reading.angles)
            self._turns[body] = found
        return self._turns[body]

    def _require_order(self) -> None:
        """Raise if times go back but the tip's path does not: the table has two recordings."""
        if not self._columns.has("tip", POINT) or not np.any(np.diff(self._times) < 0.0):
            return
        path = self._columns.table("tip", POINT)
        known = np.isfinite(path).all(axis=1)
        path, times = path[known], self._times[known]
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


def _joints_of(text: str, names: Collection[str]) -> set[str]:
    """Return the joint of a robot's array that a column is, if one of the names ends with it."""
    array, index = array_element(text)
    joints = JOINT_ARRAYS.get(array, ())
    found = {name for name in names if index < len(joints) and name.endswith(joints[index])}
    return found if len(found) == 1 else set()


def _in_order(path: Path, times: FloatArray, title: str) -> FloatArray:
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
        units = units if title in TIME and title != "%time" else []  # no unit is stated
        advice = f"if they are {units[0]}, name the column time_{units[0]}" if units else ""
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
