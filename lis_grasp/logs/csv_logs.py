"""Robot logs as CSV tables, one row for each moment.

Columns: ``time`` [s]; ``force`` [N] or ``fx,fy,fz``; the tip ``x,y,z`` [m], optionally
``qx,qy,qz,qw``; the object, optionally, ``ox,oy,oz`` and ``oqx,oqy,oqz,oqw``. Forces are in the
frame of the tip if that has an orientation, else in the frame of the poses.
"""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.csv_tables import read_csv_columns, read_table
from lis_grasp.logs.log_streams import TimedForces, Topic
from lis_grasp.logs.timed_poses import FrameTree, TimedPoses
from lis_grasp.typing import FloatArray

_FORCES = (("fx", "fy", "fz"), ("force",))
_POSES = {
    "tip": (("x", "y", "z"), ("qx", "qy", "qz", "qw")),
    "object": (("ox", "oy", "oz"), ("oqx", "oqy", "oqz", "oqw")),
}
_COLUMNS = {"time", *chain.from_iterable((*_FORCES, *chain.from_iterable(_POSES.values())))}


class CsvLog:
    """Forces and poses of a CSV table: the topics `force`, `tip` and, if it is there, `object`."""

    def __init__(self, path: Path) -> None:
        """Read a table; `InvalidFileError` if it is missing, damaged or lacks columns."""
        self._columns = read_csv_columns(path, _COLUMNS)
        present = set(self._columns)
        self._force = next((names for names in _FORCES if present >= set(names)), ())
        if "time" not in present or not self._force or not present >= set("xyz"):
            raise InvalidFileError(
                f"a log as CSV needs the columns time, fx,fy,fz or force, and x,y,z of the tip;"
                f" {path} has {', '.join(read_table(path)[0])}",
                path=path,
            )
        count = len(self._columns["time"])
        posed = [name for name, (point, _) in _POSES.items() if present >= set(point)]
        self.topics = (
            Topic("force", ",".join(self._force), count, "force"),
            *(Topic(name, ",".join(_POSES[name][0]), count, "pose") for name in posed),
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
        return TimedPoses.collect(self._columns["time"], values, child=topic)

    def frames(self) -> FrameTree:
        """Return no transforms: a table has none."""
        return FrameTree({})

    def _table(self, names: tuple[str, ...]) -> FloatArray:
        return np.column_stack([self._columns[name] for name in names])
