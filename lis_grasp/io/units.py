"""Length units of files, and the sizes that show a mistaken unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from lis_grasp.exceptions import (
    InvalidContactsError,
    InvalidFileError,
    InvalidMeshError,
    InvalidOptionError,
    note,
)
from lis_grasp.typing import FloatArray

UNITS: Mapping[str, float] = MappingProxyType({"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254})
"""Length units that a file may be in, in metres."""

SMALLEST, LARGEST = 0.005, 2.0
"""Range of the largest extent of an object [m]; beyond it the unit is mistaken."""

# Least value of the largest extent of contacts on a graspable object [m].
_LEAST_EXTENT = 1e-3
# Largest extents of objects that hands hold [m]: units that give such an extent are proposed first.
_HANDY = (0.02, 0.5)
# Spacing of single-precision numbers that distorts a shape, as a fraction of the extent, and a
# number that single precision can still hold.
_COARSEST, _FARTHEST_SINGLE = 0.005, 1e30
# Fields of contacts that are lengths.
_LENGTHS = ("points", "free_points", "free_radii", "position_noise")


def unit_name(metres: float) -> str:
    """Return the name of a unit of this length [m], such as mm, or the length itself."""
    found = [name for name, length in UNITS.items() if math.isclose(length, metres)]
    return found[0] if found else f"units of {metres:g} m"


def chosen_unit(path: Path, stated: float | None, given: str | None) -> float:
    """Return the length of a file's unit [m]: as the file states, else as given, else 1 m.

    Raises `InvalidOptionError` if the given units do not exist, or contradict the file.
    """
    if given is not None and given not in UNITS:
        raise InvalidOptionError.not_one_of("units", given, UNITS)
    if stated is None:
        return UNITS[given or "m"]
    if given is not None and not math.isclose(stated, UNITS[given]):
        raise InvalidOptionError(
            f"units must be {unit_name(stated)}, as {path} or its format states; they are {given}:"
            " leave out `units`, or correct the file",
            option="units",
            value=given,
        )
    return stated


def in_metres(path: Path, fields: dict[str, Any], units: str | None) -> tuple[dict[str, Any], str]:
    """Return the fields of contacts in a file, in metres, and the name of the file's units.

    `fields["units"]` is the name that the file states, or None. Raises `InvalidFileError` if it is
    not in `UNITS`; for other errors see `chosen_unit`.
    """
    stated = fields.pop("units", None)
    if stated is not None and stated not in UNITS:
        raise InvalidFileError.of(
            path, f"is in {stated}; units that are read are {', '.join(UNITS)}"
        )
    metres = chosen_unit(path, None if stated is None else UNITS[stated], units)
    if stated is not None and metres != 1.0:
        note(f"{path}: in {stated}, as its columns state")
    lengths = [name for name in _LENGTHS if metres != 1.0 and fields.get(name) is not None]
    return fields | {name: metres * fields[name] for name in lengths}, unit_name(metres)


def require_resolved(path: Path, points: FloatArray) -> None:
    """Raise `InvalidFileError` if single-precision points (N, 3) are too far off for their size.

    At 10 km from the origin, the vertices of a 50 mm box are rounded to 1 mm.
    """
    farthest = float(np.abs(points).max(initial=0.0))
    if not 0.0 < farthest < _FARTHEST_SINGLE:
        return
    extent = float(np.ptp(points, axis=0).max())
    step = float(np.spacing(np.float32(farthest)))
    if step > _COARSEST * extent > 0.0 and (points == points.astype(np.float32)).all():
        raise InvalidFileError(
            f"{path} is {farthest:.3g} from the origin, where its numbers of single precision are"
            f" {step:.2g} apart, too far for an extent of {extent:.2g}: move it to the origin"
            " in the program that made it",
            path=path,
        )


def require_object_size(
    what: str,
    extent: float,
    metres: float = 1.0,
    *,
    stated: bool = False,
    in_memory: bool = False,
) -> None:
    """Raise `InvalidMeshError` if an extent fits no graspable object; the message names units.

    The extent is in a unit of length `metres`, which its file may have `stated`. A mesh in memory
    has no file whose unit could be given.
    """
    if SMALLEST <= extent * metres <= LARGEST:
        return
    advice = _fitting(extent, in_memory=in_memory)
    if stated:
        advice = "the file states this unit: scale it in the program that made it"
    raise InvalidMeshError(
        f"{what} is {extent * metres:.3g} m large when read in {unit_name(metres)}, an object must"
        f" be {SMALLEST} to {LARGEST} m: {advice}"
    )


def fitting_units(extent: float, low: float, high: float) -> dict[str, float]:
    """Return the units in which an extent is from `low` to `high` [m], with its value in metres."""
    sizes = {name: extent * length for name, length in UNITS.items()}
    return {name: size for name, size in sizes.items() if low <= size <= high}


def _fitting(extent: float, *, in_memory: bool = False) -> str:
    """Return in words the units in which an extent fits an object, or scales of a mesh to them."""
    for low, high in (_HANDY, (SMALLEST, LARGEST)):
        fit = fitting_units(extent, low, high)
        if fit and in_memory:
            scales = [f"{UNITS[name]:g}) if it is in {name}" for name in fit]
            return f"mesh.apply_scale({', or ('.join(scales)}"
        if fit:
            ways = [f"{name} (then {size:.3g} m)" for name, size in fit.items()]
            return f"`units` {' or '.join(ways)} would fit"
    return "no unit would fit"


def require_plausible_size(points: FloatArray, units: str, least: float = _LEAST_EXTENT) -> None:
    """Raise `InvalidContactsError` if points (N, 3) [m], read in `units`, fit no object of a hand.

    Their extent must be 0, or from `least` to `LARGEST` [m]. The message names the units that fit.
    Points that are not finite pass: `Contacts` names them.
    """
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if extent == 0.0 or not np.isfinite(extent) or least <= extent <= LARGEST:
        return
    raise InvalidContactsError(
        f"contacts must be within {_LEAST_EXTENT:g} to {LARGEST:g} m of each other; they are"
        f" {extent:.3g} m apart when read in {units}: {_fitting(extent / UNITS[units])}",
        field="points",
    )
