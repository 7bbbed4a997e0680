"""Columns of points as programs name them, and the rows that hold a point."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidFileError, named_rows, note
from lis_grasp.io.csv_tables import ANGLES, NEWTONS, SECONDS, factor_of, without_unit
from lis_grasp.io.units import UNITS

POINT = ("x", "y", "z")
NORMAL = ("nx", "ny", "nz")
DIRECTIONS: Mapping[str, Sequence[str]] = {"normals": NORMAL, "approach": ("ax", "ay", "az")}
NOISE = ("position_noise", "normal_noise")
_MEASURED: Mapping[str, str] = {"forces": "force", "times": "time"}
_LENGTHS = (*POINT, "radius", "position_noise")
_KNOWN = {*_LENGTHS, *NORMAL, *DIRECTIONS["approach"], *NOISE, "force", "time", "finger", "kind"}
_FACTORS = {"time": SECONDS, "force": NEWTONS, "normal_noise": ANGLES}
_UNITS = {"in": "inch", "metre": "m", "meter": "m", "millimetre": "mm", "millimeter": "mm"}
# x, pos_x, pose.position.x; nx, n_x, normal_x (PCL), normals:0 (ParaView); ax, approach_x
_AXIS = re.compile(
    r"(?:(?P<n>n|norm|normals?)|(?P<a>a|approach)"
    r"|(?:p|pos|position|pose\.position|points?|coords?|contact)?)"
    r"[ _.:/]*(?P<axis>[xyz]|(?<=[_:])[012])"
)
# Columns that do not describe a contact: indices, colours, texture.
_OTHER = re.compile(r"|index|unnamed.*|(diffuse_|ambient_|specular_)?(red|green|blue|alpha)|rgba?")


class Column(NamedTuple):
    """A column of a file: its name there, its unit if the name states one, and its factor."""

    name: str
    unit: str = ""
    factor: float = 1.0  #: to seconds, newtons or radians; 1 for lengths, which share a unit


def known_columns(path: Path, names: Iterable[str]) -> dict[str, Column]:
    """Return the columns of contacts among those of a file, by the names of this package.

    Raises `InvalidFileError` if two have one meaning. The names of others are noted.
    """
    found: dict[str, Column] = {}
    unused = []
    for name in names:
        text, unit = without_unit(name)
        text = text.removeprefix("scalar_")  # CloudCompare, of properties that it does not know
        if axis := _AXIS.fullmatch(text):
            letter = "xyz"[int(axis["axis"])] if axis["axis"].isdecimal() else axis["axis"]
            text = ("n" if axis["n"] else "a" if axis["a"] else "") + letter
        text = "time" if text == "timestamp" else text
        if text not in _KNOWN:
            unused += [] if _OTHER.fullmatch(text) else [name]
        elif text in found:
            raise InvalidFileError.of(
                path, f"has two columns for {text}: {found[text].name} and {name}: keep one"
            )
        else:
            units = _FACTORS.get(text, {})
            of_length = text in _LENGTHS and {unit, _UNITS.get(unit)} & UNITS.keys()
            factor = 1.0 if of_length else factor_of(path, name, unit, units or UNITS)
            found[text] = Column(name, unit, factor)
    if not {*POINT} & found.keys():
        raise InvalidFileError.of(
            path,
            "must have columns x,y,z, and nx,ny,nz of normals; it has"
            f" {', '.join(filter(None, unused)) or 'none of them'}",
        )
    if unused:
        note(f"{path}: columns that are not used: {', '.join(unused)}")
    return found


def stated_unit(path: Path, columns: Mapping[str, Column]) -> str | None:
    """Return the length unit that names of columns state; None if they do not."""
    units = {columns[name].unit for name in _LENGTHS if name in columns} - {""}
    if len(units) > 1:
        raise InvalidFileError.of(
            path, f"has columns in {' and '.join(sorted(units))}: write all in one unit"
        )
    return next((_UNITS.get(unit, unit) for unit in units), None)


def table(path: Path, columns: Mapping[str, Any], names: Sequence[str]) -> npt.NDArray[np.float64]:
    """Return columns beside each other, shape (N, names); raise if one is missing."""
    missing = [name for name in names if name not in columns]
    if missing:
        raise InvalidFileError(
            f"{path} lacks {', '.join(missing)}, and has {', '.join(columns)}: add what is missing",
            path=path,
        )
    return np.column_stack([np.asarray(columns[name], dtype=np.float64) for name in names])


def contact_fields(
    path: Path, columns: Mapping[str, Any], fingers: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the fields of `Contacts`, and `approach`, of columns by known names.

    Rows without a point, or without a normal (0 or not finite) in a file with normals, are left
    out, and so are forces and times that some rows lack; each is noted. Raises `InvalidFileError`
    if a component is missing, or no row has a point.
    """
    fields: dict[str, Any] = {"points": table(path, columns, POINT)}
    for field, names in DIRECTIONS.items():
        fields[field] = table(path, columns, names) if set(names) & set(columns) else None
    for field, name in (*_MEASURED.items(), *zip(NOISE, NOISE, strict=True)):
        if name in columns:
            fields[field] = np.asarray(columns[name], dtype=np.float64)
    if "radius" in columns:
        note(f"{path}: the column radius is not used: radii are of rows whose kind is free")
    kept = np.isfinite(fields["points"]).all(axis=1)
    count = len(kept)
    if count and not kept.any():
        raise InvalidFileError(
            f"{path} has no points: all {count} rows are nan or blank", path=path
        )
    if not kept.all():
        empty = named_rows(np.flatnonzero(~kept))
        note(f"{path}: left out {empty} of {count}, without a point (nan, inf or blank)")
    if fields["normals"] is not None and count:
        normals = fields["normals"]
        directed = np.isfinite(normals).all(axis=1) & normals.any(axis=1)
        bare = kept & ~directed
        if bare.sum() == kept.sum():
            note(f"{path}: all normals are 0 or nan: read as points without normals")
            fields["normals"] = None
        elif bare.any():
            empty = named_rows(np.flatnonzero(bare))
            note(f"{path}: left out {empty} of {count}, with a point and no normal (0 or nan)")
            kept &= directed
    if fields["approach"] is not None:  # 0 where it is unknown
        fields["approach"] = np.where(np.isfinite(fields["approach"]), fields["approach"], 0.0)
    rows = np.flatnonzero(kept)
    chosen = {name: None if value is None else value[rows] for name, value in fields.items()}
    for field in set(_MEASURED) & set(fields):
        known = np.isfinite(fields[field][rows])
        if not known.all():
            missing, name = int((~known).sum()), _MEASURED[field]
            note(f"{path}: {missing} of {len(rows)} contacts lack {name}, so it is not used")
            chosen[field] = None
    return chosen | {"fingers": tuple(fingers[int(row)] for row in rows) if fingers else ()}
