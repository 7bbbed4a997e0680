"""Names of a log's columns: which quantity of tip, object or sensor each one is, and its unit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from scipy.constants import nano
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.csv_tables import (
    ANGLES,
    NEWTONS,
    SECONDS,
    column_numbers,
    factor_of,
    read_table,
    without_unit,
)
from lis_grasp.io.units import UNITS
from lis_grasp.typing import FloatArray

Orientation = Literal["xyzw", "wxyz", "rotvec", "rpy", "ignored"]
ORIENTATIONS: tuple[str, ...] = get_args(Orientation)

# Possible meanings of the columns of an orientation; of two, the user has to choose.
TURNS: Mapping[tuple[str, ...], tuple[Orientation, ...]] = {
    ("qx", "qy", "qz", "qw"): ("xyzw",),
    ("roll", "pitch", "yaw"): ("rpy",),
    ("rx", "ry", "rz"): ("rotvec", "rpy"),
    ("q0", "q1", "q2", "q3"): ("wxyz", "xyzw"),
    ("q1", "q2", "q3", "q4"): ("wxyz", "xyzw"),
}
FORCES = (("fx", "fy", "fz"), ("force",))
POINT = ("x", "y", "z")
TIME = ("time", "timestamp", "stamp", "__time", "t", "%time")
"""Names of the time; ``%time``, by ``rostopic echo -p``, is in nanoseconds."""

BODIES = {"tip": ["tip", "tcp", "ee", "eef", "tool", "fingertip"], "object": ["object", "obj", "o"]}
"""Words before a quantity that name its body; without one it is the tip's."""

KINDS = {
    "f": ["f", "force"],
    "": ["p", "pos", "position", "translation"],
    "q": ["q", "quat", "quaternion", "orientation", "rotation"],
    "r": ["r", "rotvec"],
}
"""Words of a quantity before its axis: force, position, quaternion, rotation vector."""

_BODY = {word: body for body, words in BODIES.items() for word in words}
_KIND = {word: kind for kind, words in KINDS.items() for word in words}


def _either(words: Mapping[str, str]) -> str:
    return "|".join(sorted(words, key=len, reverse=True))


_START = rf"(?:(?P<path>.*?)[./])??(?:(?P<body>{_either(_BODY)})[./_ ]?)??"
_AXIS = re.compile(rf"{_START}(?P<kind>{_either(_KIND)})?[./_ ]?(?P<axis>[xyzw])")
_TURN = re.compile(rf"{_START}(?P<turn>roll|pitch|yaw|q[0-9])")
_WHOLE = re.compile(r"(?:.*[./])?secs?")
_REST = re.compile(r"(?:.*[./])?(?:nsecs?|nanosecs?)")
_UNITS = {**dict.fromkeys("xyz", UNITS), **dict.fromkeys(("fx", "fy", "fz", "force"), NEWTONS)}
_TURNED = 2.0 * math.pi + 1e-6  # [rad] beyond which an angle is in degrees


@dataclass(frozen=True, slots=True, eq=False)
class LogColumns:
    """The understood columns of a table, in SI units, and the names of the others."""

    path: Path
    values: Mapping[tuple[str, str], FloatArray]  # by body and name; the body of time is empty
    titles: Mapping[tuple[str, str], str]  # as the file names them
    unused: tuple[str, ...]

    def has(self, body: str, names: tuple[str, ...]) -> bool:
        """Return whether all of some columns of a body are there."""
        return all((body, name) in self.values for name in names)

    def table(self, body: str, names: tuple[str, ...]) -> FloatArray:
        """Return columns beside each other, (T, names)."""
        return np.column_stack([self.values[body, name] for name in names])

    def turn_names(self, body: str) -> tuple[str, ...]:
        """Return the names of the columns of a body's orientation; empty if there are none."""
        return next((names for names in TURNS if self.has(body, names)), ())

    def quaternions(self, body: str, meaning: Orientation | None) -> FloatArray:
        """Return orientations (T, 4) of a body as x y z w, the identity without such columns.

        Raises `InvalidFileError` if the meaning of the columns is neither known nor given as
        `meaning`, a component is missing, or angles are in degrees.
        """
        count = len(self.values["", "time"])
        names = () if meaning == "ignored" else self.turn_names(body)
        if not names:
            if meaning != "ignored":
                self._require_whole(body)
            return np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
        titles = ", ".join(self.titles[body, name] for name in names)
        if meaning is None and len(TURNS[names]) > 1:
            raise InvalidFileError(
                f"the columns {titles} of {self.path} must be known as one of"
                f" {', '.join(TURNS[names])}: give `orientation`, or ignored if the {body} never"
                " turns",
                path=self.path,
            )
        form = TURNS[names][0] if meaning is None or len(TURNS[names]) == 1 else meaning
        if form not in TURNS[names]:
            raise InvalidFileError(
                f"the columns {titles} of {self.path} cannot be {form}: they may be"
                f" {', '.join(TURNS[names])}, or ignored (`orientation`)",
                path=self.path,
            )
        table = self.table(body, names)
        if form in ("xyzw", "wxyz"):
            return table if form == "xyzw" else np.roll(table, -1, axis=1)
        if np.nanmax(np.abs(table), initial=0.0) > _TURNED:
            raise InvalidFileError(
                f"angles of {titles} in {self.path} must be in rad; they reach"
                f" {np.nanmax(np.abs(table)):.4g}: if they are in degrees, name the columns"
                f" {', '.join(f'{name}_deg' for name in names)}",
                path=self.path,
            )
        known = np.isfinite(table).all(axis=1)
        turned = np.full((count, 4), np.nan)
        if form == "rotvec":
            turned[known] = Rotation.from_rotvec(table[known]).as_quat()
        else:
            turned[known] = Rotation.from_euler("xyz", table[known]).as_quat()
        return turned

    def _require_whole(self, body: str) -> None:
        """Raise `InvalidFileError` if only some columns of an orientation are there."""
        for names in TURNS:
            there = [name for name in names if (body, name) in self.values]
            if there:
                lacking = ", ".join(name for name in names if name not in there)
                titles = ", ".join(self.titles[body, name] for name in there)
                raise InvalidFileError(
                    f"{self.path} has {titles} of an orientation, and lacks {lacking}: add what is"
                    " missing, or give `orientation` ignored if the tip never turns",
                    path=self.path,
                )


def read_columns(path: Path) -> LogColumns:
    """Return the columns of a log.

    Raises `InvalidFileError` if two have one meaning, a unit is not known, or the object's place
    lacks a coordinate.
    """
    names, rows = read_table(path)
    values: dict[tuple[str, str], FloatArray] = {}
    titles: dict[tuple[str, str], str] = {}
    unused = []
    stamp = _stamp_columns(names)
    for k, title in enumerate(names):
        text, unit = without_unit(title)
        key = ("", "time") if text in TIME else _meaning(text)
        if key is None or (key == ("", "time") and (key in values or stamp)):
            unused += [] if k in stamp else [title]
            continue
        if key in values:
            raise InvalidFileError(
                f"{path} has two columns for {key[1]}: {titles[key]} and {title}: keep one",
                path=path,
            )
        units = SECONDS if key[1] == "time" else _UNITS.get(key[1], ANGLES)
        factor = nano if text == "%time" else factor_of(path, title, unit, units)
        values[key], titles[key] = column_numbers(path, rows, k, title) * factor, title
    if stamp:
        seconds, rest = (column_numbers(path, rows, k, names[k]) for k in stamp)
        values["", "time"] = seconds + nano * rest
        titles["", "time"] = " and ".join(names[k] for k in stamp)
    unused += _of_joints(values, titles)
    columns = LogColumns(path, values, titles, tuple(unused))
    there = [axis for axis in POINT if ("object", axis) in values]
    if 0 < len(there) < len(POINT):
        named = ", ".join(titles["object", axis] for axis in there)
        raise InvalidFileError(
            f"{path} has {named} of the object's place, and lacks a coordinate: add what is"
            " missing, or take these columns away if the object is fixed",
            path=path,
        )
    return columns


def _stamp_columns(names: list[str]) -> tuple[int, ...]:
    """Return the columns of whole seconds and nanoseconds, if no other column is a time."""
    texts = [without_unit(name)[0] for name in names]
    if any(text in TIME for text in texts):
        return ()
    whole = [k for k, text in enumerate(texts) if _WHOLE.fullmatch(text)]
    rest = [k for k, text in enumerate(texts) if _REST.fullmatch(text)]
    return (whole[0], rest[0]) if whole and rest else ()


def _meaning(text: str) -> tuple[str, str] | None:
    """Return the body and the quantity that a column's name means."""
    if text == "force":
        return "tip", "force"
    found = _AXIS.fullmatch(text)
    if found is None or (found["path"] is not None and found["kind"] is None):
        turn = _TURN.fullmatch(text)
        return None if turn is None else (_body(turn), turn["turn"])
    kind = _KIND[found["kind"]] if found["kind"] else ""
    if found["axis"] == "w" and kind != "q":
        return None
    body = "tip" if kind == "f" else _body(found)
    return body, kind + found["axis"]


def _of_joints(
    values: dict[tuple[str, str], FloatArray], titles: dict[tuple[str, str], str]
) -> list[str]:
    """Remove q0, q1, ... unless they are four numbers of an orientation; return their titles."""
    numbered = [key for key in values if key[1][:1] == "q" and key[1][1:].isdecimal()]
    for body in BODIES:
        mine = tuple(sorted(name for owner, name in numbered if owner == body))
        if mine in TURNS:
            numbered = [key for key in numbered if key[0] != body]
    for key in numbered:
        del values[key]
    return [titles.pop(key) for key in numbered]


def _body(found: re.Match[str]) -> str:
    words = [*re.split(r"[./]", found["path"] or ""), found["body"] or ""]
    return next((_BODY[word] for word in reversed(words) if word in _BODY), "tip")
