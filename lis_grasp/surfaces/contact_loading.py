"""Contacts from files with or without normals, of surface points or of fingertip centres."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.io.point_files import read_point_file
from lis_grasp.surfaces.normal_estimation import estimate_normals
from lis_grasp.surfaces.queries import require_range


def load_contacts(
    path: Path | str, *, fingertip_radius: float = 0.0, position_noise: float | None = None
) -> Contacts:
    """Read contacts; estimate their normals if the file has none.

    Parameters
    ----------
    path
        A contact file (`Contacts.load`), or a file of points without normals
        (`io.point_files.read_point_file`): .ply, .csv, .off or .xyz.
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
        If its numbers are not valid contacts, or are too few points.
    EstimationError
        If the points do not say which side of the surface is outside.
    """
    fields = read_point_file(Path(path))
    approach, normals = fields.pop("approach"), fields.pop("normals")
    require_range("fingertip_radius", fingertip_radius, unit="m")
    try:
        if normals is None:
            own = fields.get("position_noise")
            estimated = estimate_normals(
                fields["points"],
                approach=approach,
                free_points=fields.get("free_points"),
                free_radii=fields.get("free_radii"),
                fingertip_radius=fingertip_radius,
                position_noise=position_noise if own is None else own,
            )
            kept = {name: fields[name] for name in ("forces", "times", "fingers") if name in fields}
            return replace(estimated, **kept, position_noise=own)
        contacts = Contacts(**fields, normals=normals)
    except InvalidContactsError as error:
        message = f"{path}: {error}"
        raise InvalidContactsError(message, field=error.field, row=error.row) from None
    if not fingertip_radius:
        return contacts
    surface = contacts.points - fingertip_radius * contacts.normals
    return replace(contacts, points=np.asarray(surface))
