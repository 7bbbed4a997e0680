"""Orientations in the columns of a log: their form and unit, asked for if names leave it open."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.csv_tables import ANGLES, numeric_column, without_unit
from lis_grasp.logs._column_names import COUNTS, IN_DEGREES, TURNS, Orientation, group_of
from lis_grasp.logs._columns import LogColumns
from lis_grasp.typing import FloatArray

_TURNED = 2.0 * math.pi + 1e-6  # [rad] beyond which an angle is in degrees
_CIRCLE = 360.0 + 1e-6  # [deg]
_NEAR = 0.01  # deviation from the length or products of unit vectors
_SMOOTH = 0.05  # largest median step of an angle, as a fraction of its range

Unit = Literal["rad", "deg"]


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """Columns that are the orientation of a body.

    Attributes
    ----------
    body, titles
        The body, and the columns' names in the file.
    table
        Shape (T, 3), (T, 4) or (T, 9): angles [rad, or the stated unit], quaternions or matrices.
    forms
        Likely meanings.
    is_certain
        Whether names state the meaning, which is the first.
    unit
        Unit of angles, as the columns or the user state it; None if it is not known.
    states_unit
        Whether the columns state it.
    asks_unit
        Whether an unknown unit is asked for.
    """

    body: str
    titles: tuple[str, ...]
    table: FloatArray
    forms: tuple[Orientation, ...]
    is_certain: bool
    unit: Unit | None
    states_unit: bool
    asks_unit: bool = False

    def others(self) -> list[Turns]:
        """Return other meanings of the columns: of their forms and units, and w last or first."""
        forms = self.forms
        if len(forms) == 1 and forms[0] in ("xyzw", "wxyz"):
            forms = ("xyzw", "wxyz")
        units: tuple[Unit | None, ...] = ("rad", "deg")
        if self.states_unit or self.table.shape[1] != 3:
            units = (self.unit,)
        elif float(np.nanmax(np.abs(self.table), initial=0.0)) > _TURNED:
            units = ("deg",)
        return [
            replace(self, forms=(form,), is_certain=True, unit=unit, asks_unit=False)
            for form in forms
            for unit in units
        ]

    def advice(self, form: Orientation, given: Turns) -> str:
        """Return how to take the given columns, taken as a form, as these instead."""
        words = []
        if form == "ignored" and given.is_certain:
            words.append("leave out `orientation`")
        elif self.forms[0] != form:
            names = "q0,q1,q2,q3" if len(self.titles) == 4 else "rx,ry,rz"
            renamed = f"name {','.join(self.titles)} {names} and " if given.is_certain else ""
            words.append(f"{renamed}give `orientation` {self.forms[0]}")
        if not self.states_unit and self.unit not in (None, given.unit or "rad"):
            words.append(f"give `angles` {self.unit}")
        return " and ".join(words)


def find_turns(columns: LogColumns, body: str, angles: Unit | None) -> Turns | None:
    """Return the columns that are a body's orientation, by their names, or else by their data.

    Raises `InvalidFileError` if only some columns of it are there, or it may be in several places.
    """
    names = next((names for names in TURNS if columns.has(body, names)), ())
    if names:
        titles = columns.named(body, names)
        forms = TURNS[names]
        stated = forms == ("rotvec",) or any(without_unit(title)[1] in ANGLES for title in titles)
        return Turns(
            body,
            titles,
            columns.table(body, names),
            forms,
            is_certain=len(forms) == 1,
            unit="rad" if stated else angles,
            states_unit=stated,
            asks_unit=names in IN_DEGREES,
        )
    _require_whole(columns, body)
    found = [turns for turns in _by_data(columns, angles) if turns.body == body]
    if len(found) > 1:
        groups = " or ".join(f"{turns.titles[0]} to {turns.titles[-1]}" for turns in found)
        raise InvalidFileError(
            f"the orientation of the {body} may be {groups} of {columns.path}: name the columns"
            " that are it rx,ry,rz or q0,q1,q2,q3, or give `orientation` ignored if it never turns",
            path=columns.path,
        )
    return found[0] if found else None


def quaternions_of(turns: Turns, given: Orientation | None, columns: LogColumns) -> FloatArray:
    """Return orientations (T, 4) as x y z w; NaN where they are unknown.

    Raises `InvalidFileError` if the form or unit of the columns is neither known nor given.
    """
    form = form_of(turns, given, columns)
    table, path = turns.table, columns.path
    if form in ("xyzw", "wxyz"):
        return table if form == "xyzw" else np.roll(table, -1, axis=1)
    known = np.asarray(np.isfinite(table).all(axis=1), dtype=np.bool_)
    quaternions = np.full((len(table), 4), np.nan)
    if form == "matrix":
        matrices = table.reshape(-1, 3, 3)
        volumes = np.linalg.det(np.where(known[:, None, None], matrices, 0.0))  # 1 of a rotation
        known &= np.isclose(volumes, 1.0, rtol=0.0, atol=_NEAR)
        quaternions[known] = Rotation.from_matrix(matrices[known]).as_quat()
        return quaternions
    farthest = float(np.nanmax(np.abs(table), initial=0.0))
    if turns.unit is None and (turns.asks_unit or farthest > _TURNED):
        raise InvalidFileError(
            f"the unit of the angles {', '.join(turns.titles)} of {path} must be known; they reach"
            f" {farthest:.4g}: give `angles` deg or rad, or name the columns as"
            f" {turns.titles[0]}_deg",
            path=path,
        )
    table = table[known] * ANGLES[turns.unit or "rad"]
    if form == "rotvec":
        quaternions[known] = Rotation.from_rotvec(table).as_quat()
    else:
        quaternions[known] = Rotation.from_euler("xyz" if form == "rpy" else form, table).as_quat()
    return quaternions


def form_of(turns: Turns, given: Orientation | None, columns: LogColumns) -> Orientation:
    """Return what the columns are; raise `InvalidFileError` if that is neither known nor given."""
    if turns.is_certain:
        return turns.forms[0]
    titles = ", ".join(turns.titles)
    likely = ", ".join(turns.forms)
    if given is None:
        partial = ""
        longest = float(np.nanmax(np.linalg.norm(turns.table, axis=1), initial=0.0))
        if len(turns.titles) == 3 and longest <= 1.0 + _NEAR:
            partial = ", add the fourth if they are three numbers of a quaternion"
        raise InvalidFileError(
            f"the columns {titles} of {columns.path} must be known as one of {likely}: give"
            f" `orientation`{partial}, or ignored if the {turns.body} never turns or they are no"
            " orientation",
            path=columns.path,
        )
    if COUNTS.get(given) != len(turns.titles):
        raise InvalidFileError(
            f"the columns {titles} of {columns.path} cannot be {given}: they may be"
            f" {likely}, or ignored (`orientation`)",
            path=columns.path,
        )
    return given


def _require_whole(columns: LogColumns, body: str) -> None:
    """Raise `InvalidFileError` if only some columns of an orientation are there."""
    for names in TURNS:
        there = [name for name in names if (body, name) in columns.values]
        if there:
            lacking = ", ".join(name for name in names if name not in there)
            titles = ", ".join(columns.named(body, tuple(there)))
            raise InvalidFileError(
                f"{columns.path} has {titles} of an orientation, and lacks {lacking}: add what is"
                f" missing, or give `orientation` ignored if the {body} never turns",
                path=columns.path,
            )


def _by_data(columns: LogColumns, angles: Unit | None) -> list[Turns]:
    """Return unused columns that have the numbers of an orientation: 3, 4 or 9 beside each other.

    They share a name but for its end, or are in a row in the table.
    """
    found = []
    for titles, table in _unused_groups(columns):
        forms = _forms_of(table)
        if len(titles) == 4 and [without_unit(title)[0][-1] for title in titles] == [*"xyzw"]:
            forms = forms[1:]
        units = {without_unit(title)[1] for title in titles} - {""}
        if forms and units <= ANGLES.keys():
            body = group_of(without_unit(titles[0])[0])[0]
            unit: Unit | None = "deg" if "deg" in units else "rad" if units else angles
            found.append(Turns(body, titles, table, forms, False, unit, states_unit=bool(units)))
    return found


def _unused_groups(columns: LogColumns) -> Iterator[tuple[tuple[str, ...], FloatArray]]:
    """Yield the names and numbers (T, 3), (T, 4) or (T, 9) of unused columns, each at most once."""
    names, rows = columns.names, columns.rows
    numbers, stems = {}, defaultdict(list)
    for title in columns.unused:
        body, stem, place = group_of(without_unit(title)[0])
        if body and (column := numeric_column(rows, names.index(title))) is not None:
            numbers[title] = column
            stems[stem].append((place, title))
    groups = [
        [title for _, title in sorted(titles)]
        for stem, titles in stems.items()
        if stem and len(titles) > 1
    ]
    grouped = {title for titles in groups for title in titles}
    for free, run in groupby(names, lambda name: name in numbers and name not in grouped):
        groups += [list(run)] if free else []
    for titles in groups:
        whole = len(titles) in COUNTS.values()
        for size in (len(titles),) if whole else (9, 4):
            for start in range(len(titles) - size + 1):
                part = tuple(titles[start : start + size])
                yield part, np.column_stack([numbers[title] for title in part])


def _forms_of(table: FloatArray) -> tuple[Orientation, ...]:
    """Return what numbers (T, 3), (T, 4) or (T, 9) may be of an orientation; none if nothing."""
    table = table[np.isfinite(table).all(axis=1)]
    if not len(table):
        return ()
    if table.shape[1] == 4:
        near = np.abs(np.linalg.norm(table, axis=1) - 1.0) < _NEAR
        return ("wxyz", "xyzw") if near.all() else ()
    if table.shape[1] == 9:
        matrices = table.reshape(-1, 3, 3)
        apart = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max()
        # Both a matrix and its transpose pass: the user says that it is by rows.
        return ("matrix",) if apart < _NEAR else ()
    ranges = np.ptp(table, axis=0)
    steps = np.median(np.abs(np.diff(table, axis=0)), axis=0) if len(table) > 1 else ranges
    turns = np.abs(table).max() <= _CIRCLE and (ranges > 0.0).any()
    smooth = (steps <= _SMOOTH * ranges).all()
    return ("rotvec", "rpy", "ZYX", "XYZ") if turns and smooth else ()
