"""Columns of a log as a table: numbers of each quantity in SI units, and columns left over."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.constants import nano

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
from lis_grasp.logs._column_names import (
    IN_BASE,
    LOOSE,
    POINT,
    TIME,
    TURNS,
    array_element,
    meaning_of,
)
from lis_grasp.typing import FloatArray

_WHOLE = re.compile(r"(?:.*[./])?secs?")
_REST = re.compile(r"(?:.*[./])?(?:nsecs?|nanosecs?)")
_UNITS = {**dict.fromkeys("xyz", UNITS), **dict.fromkeys(("fx", "fy", "fz", "force"), NEWTONS)}


@dataclass(frozen=True, slots=True, eq=False)
class LogColumns:
    """The understood columns of a table, in SI units, and the names of the others."""

    path: Path
    values: Mapping[tuple[str, str], FloatArray]  # by body and name; the body of time is empty
    titles: Mapping[tuple[str, str], str]  # as the file names them
    unused: tuple[str, ...]
    names: Sequence[str]  # of all columns
    rows: Sequence[Sequence[str]]  # of cells

    def has(self, body: str, names: tuple[str, ...]) -> bool:
        """Return whether all of some columns of a body are there."""
        return all((body, name) in self.values for name in names)

    def table(self, body: str, names: tuple[str, ...]) -> FloatArray:
        """Return columns beside each other, (T, names)."""
        return np.column_stack([self.values[body, name] for name in names])

    def named(self, body: str, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the titles of columns of a body."""
        return tuple(self.titles[body, name] for name in names)

    @property
    def force_frame(self) -> str:
        """Frame of the force, as its columns' names state; empty if they do not."""
        title = self.titles.get(("tip", "fx"), "")
        return "base" if array_element(without_unit(title)[0])[0] in IN_BASE else ""


def read_columns(path: Path) -> LogColumns:
    """Return the columns of a log.

    Raises `InvalidFileError` if two have one meaning, a unit is not known, or the object's place
    lacks a coordinate.
    """
    names, rows = read_table(path)
    values: dict[tuple[str, str], FloatArray] = {}
    titles: dict[tuple[str, str], str] = {}
    stamp = _stamp_columns(names)
    meanings = _meanings(names, stamp)
    for k, (title, key) in enumerate(zip(names, meanings, strict=True)):
        if key is None:
            continue
        if key in values:
            raise InvalidFileError(
                f"{path} has two columns for {key[1]}: {titles[key]} and {title}: keep one",
                path=path,
            )
        text, unit = without_unit(title)
        units = SECONDS if key[1] == "time" else _UNITS.get(key[1], ANGLES)
        factor = nano if text == "%time" else factor_of(path, title, unit, units)
        values[key], titles[key] = column_numbers(path, rows, k, title) * factor, title
    if stamp:
        seconds, rest = (column_numbers(path, rows, k, names[k]) for k in stamp)
        values["", "time"] = seconds + nano * rest
        titles["", "time"] = " and ".join(names[k] for k in stamp)
    unused = (n for k, n in enumerate(names) if meanings[k] is None and k not in stamp)
    columns = LogColumns(path, values, titles, tuple(unused), names, rows)
    there = [axis for axis in POINT if ("object", axis) in values]
    if 0 < len(there) < len(POINT):
        named = ", ".join(titles["object", axis] for axis in there)
        raise InvalidFileError(
            f"{path} has {named} of the object's place, and lacks a coordinate: add what is"
            " missing, or take these columns away if the object is fixed",
            path=path,
        )
    return columns


def _meanings(names: list[str], stamp: tuple[int, ...]) -> list[tuple[str, str] | None]:
    """Return body and quantity of each column; None where it has none, or no time is needed."""
    texts = [without_unit(name) for name in names]
    found: list[tuple[str, str] | None] = []
    for text, unit in texts:
        key = ("", "time") if text in TIME else meaning_of(text)
        if key == ("", "time") and (key in found or stamp):
            key = None
        if key is not None and key[1] in LOOSE and unit and unit not in ANGLES:
            key = None  # a letter that is another quantity
        found.append(key)
    counts = Counter(found)
    whole = {key for key in counts if key is not None and _is_whole(key, counts)}
    return [key if key is None or key[1] not in LOOSE or key in whole else None for key in found]


def _is_whole(key: tuple[str, str], counts: Mapping[tuple[str, str] | None, int]) -> bool:
    """Return whether a loose name has the others of its orientation; q0 to q6 are joints."""
    body, name = key
    numbered = {of for owner, of in filter(None, counts) if owner == body and _is_numbered(of)}
    return any(
        name in names
        and all(counts.get((body, each)) == 1 for each in names)
        and (not _is_numbered(name) or numbered == set(names))
        for names in TURNS
    )


def _is_numbered(name: str) -> bool:
    return name[:1] == "q" and name[1:].isdecimal()


def _stamp_columns(names: list[str]) -> tuple[int, ...]:
    """Return the columns of whole seconds and nanoseconds, if no other column is a time."""
    texts = [without_unit(name)[0] for name in names]
    if any(text in TIME for text in texts):
        return ()
    whole = [k for k, text in enumerate(texts) if _WHOLE.fullmatch(text)]
    rest = [k for k, text in enumerate(texts) if _REST.fullmatch(text)]
    return (whole[0], rest[0]) if whole and rest else ()
