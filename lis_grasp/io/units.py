"""Length units of files, and the sizes that tell a mistaken one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from lis_grasp.exceptions import (
    InvalidContactsError,
    InvalidFileError,
    InvalidOptionError,
    note,
)
from lis_grasp.typing import FloatArray

UNITS: Mapping[str, float] = MappingProxyType({"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254})
"""Length units that a file may be in, in metres."""

SMALLEST, LARGEST = 0.005, 2.0
"""Range of the largest extent of an object [m]; beyond it the unit is mistaken."""

# Smallest largest extent of contacts on an object that a hand can grasp [m].
_LEAST_EXTENT = 1e-3
# Largest extent of an object that a unit is proposed for [m].
_GRASPABLE = 0.5
# Fields of contacts that are lengths.
_LENGTHS = ("points", "free_points", "free_radii", "position_noise")


def chosen_units(path: Path, stated: str | None, given: str | None) -> str:
    """Return the units of a file: those that it states, else those given, else metres.

    Raises
    ------
    InvalidOptionError
        If there are no such units, or the given ones contradict the file.
    InvalidFileError
        If the file states others than those in `UNITS`.
    """
    if given is not None and given not in UNITS:
        raise InvalidOptionError.not_one_of("units", given, UNITS)
    if stated is None:
        return given or "m"
    if stated not in UNITS:
        raise InvalidFileError(
            f"{path} is in {stated}; units that are read are {', '.join(UNITS)}", path=path
        )
    if given not in (None, stated):
        raise InvalidOptionError(
            f"units must be {stated}, as {path} states; they are {given}: leave out `units`, or"
            " correct the file",
            option="units",
            value=given,
        )
    return stated


def in_metres(path: Path, fields: dict[str, Any], units: str | None) -> tuple[dict[str, Any], str]:
    """Return the fields of contacts in a file, in metres, and the file's units.

    `fields["units"]` are those that the file states, or None. Errors are of `chosen_units`.
    """
    stated = fields.pop("units", None)
    units = chosen_units(path, stated, units)
    if stated not in (None, "m"):
        note(f"{path}: in {units}, as its columns state")
    if UNITS[units] == 1.0:
        return fields, units
    lengths = {name: fields[name] for name in _LENGTHS if fields.get(name) is not None}
    return fields | {name: UNITS[units] * values for name, values in lengths.items()}, units


def require_plausible_size(points: FloatArray, units: str, least: float = _LEAST_EXTENT) -> None:
    """Raise `InvalidContactsError` if points (N, 3) [m], read in `units`, fit no object of a hand.

    Their extent must be 0, or from `least` to `LARGEST` [m]. The message names the units that fit.
    Points that are not finite pass: `Contacts` names them.
    """
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if extent == 0.0 or not np.isfinite(extent) or least <= extent <= LARGEST:
        return
    fitting = [
        f"{name} (then {1e3 * extent * metres / UNITS[units]:.3g} mm)"
        for name, metres in UNITS.items()
        if SMALLEST <= extent * metres / UNITS[units] <= _GRASPABLE
    ]
    advice = f"`units` {' or '.join(fitting)} would fit" if fitting else "no unit would fit"
    raise InvalidContactsError(
        f"contacts must be within {_LEAST_EXTENT:g} to {LARGEST:g} m of each other; they are"
        f" {extent:.3g} m apart when read in {units}: {advice}",
        field="points",
    )
