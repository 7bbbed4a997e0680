"""Streams of a robot's log: series of poses, forces and joint positions; those of CSV tables."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Literal

import networkx as nx
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from lis_grasp.contacts import FARTHEST
from lis_grasp.exceptions import InvalidFileError, InvalidInputError, note
from lis_grasp.geometry import inverse_pose, make_pose, unit
from lis_grasp.io.csv_tables import SECONDS, column_numbers, read_table, without_unit
from lis_grasp.io.units import UNITS
from lis_grasp.typing import FloatArray

Content = Literal["force", "pose", "transforms", "joints", "other"]


# A pose between two samples farther apart than this is unknown [s].
LONGEST_GAP = 0.25
_UNIT_TOLERANCE = 0.1

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


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a log: its name, type, number of messages, and what it contains."""

    name: str
    type: str
    messages: int
    content: Content


@dataclass(frozen=True, slots=True, eq=False)
class TimedForces:
    """Forces over time.

    Attributes
    ----------
    times
        Shape (T,) [s], not decreasing.
    forces
        Shape (T, 3) [N], or (T, 1) where only the magnitude is known.
    frame
        Name of the frame in which vectors are given; empty if unknown.
    """

    times: FloatArray
    forces: FloatArray
    frame: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class TimedPoses:
    """Poses X_PC of a child frame C in a parent frame P over time.

    Attributes
    ----------
    times
        Shape (T,) [s], strictly increasing.
    positions
        Shape (T, 3) [m].
    quaternions
        Shape (T, 4), unit, in the order x, y, z, w.
    parent, child
        Names of the frames; empty if unknown.
    """

    times: FloatArray
    positions: FloatArray
    quaternions: FloatArray
    parent: str = ""
    child: str = ""

    @classmethod
    def collect(
        cls,
        times: FloatArray,
        values: FloatArray,
        parent: str = "",
        child: str = "",
        name: str = "",
    ) -> TimedPoses:
        """Sort samples by time and drop repeated times; values (T, 7) are x y z qx qy qz qw.

        Samples that are not finite or farther than 10,000 km, or whose quaternion is not of unit
        length, are dropped; a note counts them by the name of the stream.
        """
        count = len(times)
        valid = np.isfinite(times) & np.all(np.abs(values) < FARTHEST, axis=1)
        times, values = times[valid], values[valid]
        lengths = np.linalg.norm(values[:, 3:], axis=1)
        valid = np.abs(lengths - 1.0) < _UNIT_TOLERANCE
        lost = count - int(valid.sum())
        if lost:
            note(
                f"{name}: {lost} of {count} poses are left out: nan, far away, or with a quaternion"
                " that is not of length 1, such as 0 0 0 0"
            )
        _, order = np.unique(times[valid], return_index=True)
        rows = values[valid][order]
        return cls(
            times[valid][order],
            rows[:, :3],
            unit(rows[:, 3:]),
            parent.lstrip("/"),
            child.lstrip("/"),
        )

    def at(self, times: FloatArray) -> FloatArray:
        """Return the interpolated poses at times (N,), shape (N, 4, 4); NaN where unknown.

        Positions linearly, orientations along great circles (Slerp). A single sample is a static
        transform. Unknown are times outside of the samples, or in a gap of more than 0.25 s.
        """
        if not len(self.times):
            return np.full((len(times), 4, 4), np.nan)
        if len(self.times) == 1:
            rotation = Rotation.from_quat(self.quaternions[0]).as_matrix()
            return np.tile(make_pose(rotation, self.positions[0]), (len(times), 1, 1))
        within = np.clip(times, self.times[0], self.times[-1])
        slerp = Slerp(self.times, Rotation.from_quat(self.quaternions))
        places = [np.interp(within, self.times, column) for column in self.positions.T]
        poses = make_pose(slerp(within).as_matrix(), np.stack(places, axis=1))
        after = np.clip(np.searchsorted(self.times, within), 1, len(self.times) - 1)
        gap = self.times[after] - self.times[after - 1]
        exact = (self.times[after] == within) | (self.times[after - 1] == within)
        poses[(times != within) | ((gap > LONGEST_GAP) & ~exact)] = np.nan
        return poses


@dataclass(frozen=True, slots=True, eq=False)
class FrameTree:
    """Transforms between named frames, by (parent, child)."""

    transforms: Mapping[tuple[str, str], TimedPoses]

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        return sorted({name for pair in self.transforms for name in pair})

    def pose(self, base: str, frame: str, times: FloatArray) -> FloatArray:
        """Return poses of a frame in a base frame at times (N,), shape (N, 4, 4); NaN if unknown.

        Raises `InvalidInputError` if no chain of transforms connects the two frames.
        """
        poses = np.tile(np.eye(4), (len(times), 1, 1))
        if base == frame:
            return poses
        graph = nx.Graph()
        graph.add_edges_from(self.transforms)
        if base not in graph or frame not in graph or not nx.has_path(graph, base, frame):
            names = ", ".join(self.frames) or "none"
            raise InvalidInputError(
                f"no chain of transforms connects the frames '{base}' and '{frame}'; the log has"
                f" transforms of {names}"
            )
        path = nx.shortest_path(graph, base, frame)
        for before, after in pairwise(path):
            forward = self.transforms.get((before, after))
            if forward is not None:
                step = forward.at(times)
            else:
                step = inverse_pose(self.transforms[(after, before)].at(times))
            poses = poses @ step
        return poses


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
                found[name] = (self._columns["time"], column_numbers(self._path, rows, k, title))
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
        columns[name] = column_numbers(path, rows, k, full) * {**UNITS, **SECONDS}.get(unit, 1.0)
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
