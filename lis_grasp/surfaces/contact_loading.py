"""Contacts from files with or without normals, of surface points or of fingertip centres.

Their size must be plausible, and their normals must point outward (`surfaces.contact_checks`).
"""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError
from lis_grasp.guesses import with_advice
from lis_grasp.io.contact_files import point_fields, read_point_file
from lis_grasp.io.units import in_metres, require_plausible_size
from lis_grasp.surfaces._contact_noise import filled
from lis_grasp.surfaces.contact_checks import (
    INWARD,
    NormalSide,
    fraction_in_front,
    note_table,
    turned_outward,
)
from lis_grasp.surfaces.contact_preparation import with_approach
from lis_grasp.surfaces.contact_verdicts import orient_normals
from lis_grasp.surfaces.normal_estimation import estimate_normals
from lis_grasp.surfaces.queries import require_range
from lis_grasp.typing import FloatArray

if TYPE_CHECKING:
    import pandas


ContactSource: TypeAlias = "Path | str | npt.ArrayLike | pandas.DataFrame"
"""What `load_contacts` reads: a file, an array of numbers or with names, or a table of pandas."""


@with_advice
def load_contacts(
    path: ContactSource,
    *,
    units: str | None = None,
    normals: NormalSide | None = None,
    viewpoint: npt.ArrayLike | None = None,
    fingertip_radius: float = 0.0,
    position_noise: float | None = None,
) -> Contacts:
    """Read contacts; estimate their normals if the file has none.

    Parameters
    ----------
    path
        A contact file (`Contacts.load`), or a file of points without normals
        (`io.contact_files.read_point_file`).
        Or such points in memory: an array of shape (N, 3), or (N, 6) with normals, or a table with
        the names of a file's columns.
    units
        Length unit of the file, a key of `shapes.UNITS`; None for what its columns state or else
        metres.
    normals
        Side that the file's normals point to; "inward" ones are flipped, "unsigned" ones get the
        likeliest signs (`orient_normals`). None requires outward ones.
    viewpoint
        Place of the sensor that the file's normals point to [m], shape (3,); None if unknown.
    fingertip_radius
        Radius of the spherical fingertip [m] if the points are its centres; 0 for surface points.
    position_noise
        One standard deviation of points along their normals [m] where the file has none; None if
        unknown.

    Raises
    ------
    InvalidFileError
        If the file is missing, of another format, damaged, or lacks points.
    InvalidContactsError
        If its numbers are not valid contacts, too few, fit no object of a hand (mistaken units,
        mostly), or the normals point inward.
    InvalidOptionError
        If there is no such unit or side, or the file states another unit.
    EstimationError
        If the points do not say which side of the surface is outside.

    Examples
    --------
    >>> contacts.save("contacts.csv")
    >>> len(load_contacts("contacts.csv", units="m"))
    6
    """
    if normals not in (None, *get_args(NormalSide)):
        raise InvalidOptionError.not_one_of("normals", normals, get_args(NormalSide))
    path, fields = _read(path)
    fields, units = in_metres(path, fields, units)
    approach, own_normals = fields.pop("approach"), fields.pop("normals")
    points = fields["points"]
    require_range("fingertip_radius", fingertip_radius, unit="m")
    try:
        require_plausible_size(points, units)
        if own_normals is None:
            note_table(path, points, None)
            own = fields.get("position_noise")
            known = own if position_noise is None else filled(own, position_noise, len(points))
            estimated = estimate_normals(
                points,
                approach=approach,
                free_points=fields.get("free_points"),
                free_radii=fields.get("free_radii"),
                fingertip_radius=fingertip_radius,
                position_noise=known,
            )
            _require_own_side(points, estimated, fingertip_radius)
            kept = {name: fields[name] for name in ("forces", "times", "fingers") if name in fields}
            return replace(estimated, **kept, position_noise=own)
        contacts = Contacts(**fields, normals=own_normals)
        note_table(path, points, own_normals)
        if approach is not None:
            contacts = with_approach(contacts, approach)
        if viewpoint is not None or normals == "unsigned":
            contacts = orient_normals(contacts, viewpoint=viewpoint, position_noise=position_noise)
        else:
            contacts = turned_outward(contacts, normals)
    except InvalidContactsError as error:
        message = f"{path}: {error}"
        raise InvalidContactsError(message, field=error.field, row=error.row) from None
    if not fingertip_radius:
        return contacts
    surface = contacts.points - fingertip_radius * contacts.normals
    centers, contacts = contacts.points, replace(contacts, points=np.asarray(surface))
    _require_own_side(centers, contacts, fingertip_radius)
    return contacts


def _read(source: ContactSource) -> tuple[Path, dict[str, Any]]:
    """Return the name of a source, and its fields as `read_point_file` does."""
    if isinstance(source, (str, PathLike)):
        return Path(source), read_point_file(Path(source))
    table = source.to_records(index=False) if hasattr(source, "to_records") else source
    kind = type(source).__name__
    try:
        array = np.asarray(table)
    except ValueError:  # rows of different lengths
        array = np.empty(0, dtype=object)
    if array.dtype.names is None and array.dtype.kind not in "fiu":
        raise TypeError(
            "contacts are read from a file, an array of shape (N, 3) or (N, 6), or a table with"
            f" columns x, y, z; this {kind} is none: write Contacts(points, normals)"
        )
    return Path(kind), point_fields(Path(kind), array)


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
