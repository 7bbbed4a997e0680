"""Contacts from files with or without normals, of surface points or of fingertip centres."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError
from lis_grasp.io.point_files import read_point_file
from lis_grasp.shapes import UNITS
from lis_grasp.surfaces.contact_checks import (
    INWARD,
    fraction_in_front,
    require_outward_normals,
    require_plausible_size,
)
from lis_grasp.surfaces.contact_noise import filled
from lis_grasp.surfaces.normal_estimation import estimate_normals
from lis_grasp.surfaces.queries import require_range
from lis_grasp.typing import FloatArray

NormalSide = Literal["outward", "inward"]
"""Side of the surface that a file's normals point to."""

_LENGTHS = ("points", "free_points", "free_radii", "position_noise")


def load_contacts(
    path: Path | str,
    *,
    units: str = "m",
    normals: NormalSide | None = None,
    fingertip_radius: float = 0.0,
    position_noise: float | None = None,
) -> Contacts:
    """Read contacts; estimate their normals if the file has none.

    Size and normals are checked, for a surface would be estimated from millimetres or inward
    normals too.

    Parameters
    ----------
    path
        A contact file (`Contacts.load`), or a file of points without normals
        (`io.point_files.read_point_file`): .ply, .csv, .off or .xyz.
    units
        Length unit of the file, a key of `UNITS`; other arguments are in metres.
    normals
        Side that the file's normals point to; "inward" ones are flipped. None requires that they
        point outward as far as the contacts show it.
    fingertip_radius
        Radius of the spherical fingertip [m] if the points are its centres; 0 for surface points.
    position_noise
        One standard deviation of points along their normals [m], for estimating normals of points
        whose own is not in the file; None if unknown.

    Raises
    ------
    InvalidFileError
        If the file is missing, of another format, damaged, or lacks points.
    InvalidContactsError
        If its numbers are not valid contacts, are too few points, fit no object of a hand
        (mistaken units, mostly), or the normals point inward.
    InvalidOptionError
        If there is no such unit or side.
    EstimationError
        If the points do not say which side of the surface is outside.
    """
    if units not in UNITS:
        raise InvalidOptionError.not_one_of("units", units, UNITS)
    if normals not in (None, *get_args(NormalSide)):
        raise InvalidOptionError.not_one_of("normals", normals, get_args(NormalSide))
    fields = _in_metres(read_point_file(Path(path)), UNITS[units])
    approach, own_normals = fields.pop("approach"), fields.pop("normals")
    require_range("fingertip_radius", fingertip_radius, unit="m")
    try:
        require_plausible_size(fields["points"], units)
        if own_normals is None:
            own = fields.get("position_noise")
            known = own
            if position_noise is not None:
                known = filled(own, position_noise, len(fields["points"]))
            estimated = estimate_normals(
                fields["points"],
                approach=approach,
                free_points=fields.get("free_points"),
                free_radii=fields.get("free_radii"),
                fingertip_radius=fingertip_radius,
                position_noise=known,
            )
            _require_own_side(fields["points"], estimated, fingertip_radius)
            kept = {name: fields[name] for name in ("forces", "times", "fingers") if name in fields}
            return replace(estimated, **kept, position_noise=own)
        contacts = Contacts(**fields, normals=own_normals)
        if normals is None:
            require_outward_normals(contacts)
        elif normals == "inward":
            contacts = replace(contacts, normals=-contacts.normals)
    except InvalidContactsError as error:
        message = f"{path}: {error}"
        raise InvalidContactsError(message, field=error.field, row=error.row) from None
    if not fingertip_radius:
        return contacts
    surface = contacts.points - fingertip_radius * contacts.normals
    centers, contacts = contacts.points, replace(contacts, points=np.asarray(surface))
    _require_own_side(centers, contacts, fingertip_radius)
    return contacts


def _require_own_side(centers: FloatArray, contacts: Contacts, fingertip_radius: float) -> None:
    """Raise if a fingertip's radius moved its centres (N, 3) to contacts behind the object."""
    if not fingertip_radius or fraction_in_front(contacts) <= INWARD:
        return
    if fraction_in_front(replace(contacts, points=centers)) <= INWARD:
        raise InvalidOptionError(
            f"fingertip_radius must be that of the fingertip in metres; {fingertip_radius:g} moves"
            " the contacts to the other side of the object",
            option="fingertip_radius",
            value=fingertip_radius,
        )


def _in_metres(fields: dict[str, Any], metres: float) -> dict[str, Any]:
    """Return the fields of a file whose unit is `metres` long, in metres."""
    if metres == 1.0:
        return fields
    lengths = {name: fields[name] for name in _LENGTHS if fields.get(name) is not None}
    return fields | {name: metres * values for name, values in lengths.items()}
