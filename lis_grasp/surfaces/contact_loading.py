"""Contacts from files with or without normals, of surface points or of fingertip centres.

Their size must be plausible, and their normals must point outward.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError, note
from lis_grasp.geometry import tangent_frame
from lis_grasp.io.contact_files import read_point_file
from lis_grasp.io.units import in_metres, require_plausible_size
from lis_grasp.surfaces._contact_noise import filled
from lis_grasp.surfaces.contact_preparation import with_approach
from lis_grasp.surfaces.contact_verdicts import orient_normals
from lis_grasp.surfaces.normal_estimation import estimate_normals
from lis_grasp.surfaces.queries import require_range
from lis_grasp.typing import FloatArray

# Heights below this fraction of the extent do not count: the contact is beside the other.
_LEAST_HEIGHT = 0.01
# Largest number of contacts that are paired.
_MOST = 400
# Contacts of one view have all but 5 % of their normals in a half space, up to its border.
_VIEW, _BORDER = 0.95, -0.1
# Length of the mean of unit normals below which it has no direction: they are on all sides.
_LEAST_MEAN = 0.1
# Of 1560 sets of 5 to 400 contacts with outward normals on test objects, 2 have more in front.
INWARD = 0.75
"""Fraction in front above which normals point inward."""
DOUBTFUL = 0.55
"""Fraction in front above which normals may point inward."""

# A table: of the points, the least fraction and count in a plane; the distance from it, and the
# width of its border, as fractions of the extent.
_TABLE, _LEAST_ON_TABLE, _ON_PLANE, _WIDTH = 0.1, 12, 0.02, 0.1

NormalSide = Literal["outward", "inward", "unsigned"]
"""Side of the surface that a file's normals point to; unsigned: unknown for each."""


def fraction_in_front(contacts: Contacts) -> float:
    """Return the fraction of ordered pairs of contacts whose second is in front of the first.

    In front means above the first's tangent plane, on the side of its normal. It is 0 for a convex
    object with outward normals, 1 with inward ones, and 0 where no pair shows it. Contacts whose
    normals are in one half space, such as one camera view, do not show it either: a bowl and a ball
    differ by the sign of the normals alone.
    """
    chosen = contacts.subset(
        np.linspace(0, len(contacts) - 1, min(len(contacts), _MOST)).astype(int)
    )
    points, normals = chosen.points, chosen.normals
    if len(points) < 2 or _are_of_one_view(normals):
        return 0.0
    heights = np.einsum("ijk,ik->ij", points[None] - points[:, None], normals)  # (N, N)
    counted = np.abs(heights) > _LEAST_HEIGHT * chosen.extent
    return float(np.mean(heights[counted] > 0.0)) if counted.any() else 0.0


def require_outward_normals(contacts: Contacts) -> None:
    """Raise `InvalidContactsError` if nearly all contacts are in front of the others."""
    fraction = fraction_in_front(contacts)
    if fraction > INWARD:
        raise InvalidContactsError(
            "normals must point out of the object; these point inward: seen from a contact,"
            f" {100 * fraction:.0f} % of the others are in front of it. Change their sign"
            " (`normals` inward does), or keep them by `normals` outward",
            field="normals",
        )


def _are_of_one_view(normals: FloatArray) -> bool:
    """Return whether nearly all normals (N, 3) are in the half space about their mean."""
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return length > _LEAST_MEAN and bool(np.mean(normals @ (mean / length) > _BORDER) >= _VIEW)


def _note_table(path: Path | str, points: FloatArray, normals: FloatArray | None) -> None:
    """Note points (N, 3) in a plane of the convex hull that reach beyond the others, as a table's.

    The normals of a table, if they are known, point into the hull.
    """
    rows = np.flatnonzero(points.any(axis=1))  # a point at (0, 0, 0) is an empty row
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), 5 * _MOST)).astype(int)]
    chosen, first = np.unique(points[rows], axis=0, return_index=True)
    rows = rows[first]
    if len(rows) < _LEAST_ON_TABLE or np.linalg.matrix_rank(chosen - chosen.mean(axis=0)) < 3:
        return
    faces = ConvexHull(chosen).equations  # (H, 4), outward
    height = faces[:, :3] @ chosen.T + faces[:, 3:]  # (H, N), 0 or less
    near = _ON_PLANE * float(np.ptp(chosen, axis=0).max())
    best = int(np.argmax((height > -near).sum(axis=1)))
    on, others = height[best] > -near, height[best] < -2.0 * near
    if on.sum() < max(_TABLE * len(chosen), _LEAST_ON_TABLE) or not others.any():
        return
    if normals is not None and np.median(normals[rows][on] @ faces[best, :3]) > 0.0:
        return
    turns = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    around = np.column_stack([np.cos(turns), np.sin(turns)]) @ tangent_frame(faces[best, :3])
    border = (chosen[on] @ around.T).max(axis=0) - (chosen[others] @ around.T).max(axis=0)
    if np.median(border) > _WIDTH * np.ptp(chosen[others], axis=0).max():
        note(
            f"{path}: {100 * np.mean(on):.0f} % of the points are in a plane and reach"
            f" {1e3 * np.median(border):.0f} mm beyond the others, as those of a table do: if it is"
            " one, leave them out of the file, for they are taken as the object's"
        )


def load_contacts(
    path: Path | str,
    *,
    units: str | None = None,
    normals: NormalSide | None = None,
    viewpoint: npt.ArrayLike | None = None,
    fingertip_radius: float = 0.0,
    position_noise: float | None = None,
) -> Contacts:
    """Read contacts; estimate their normals if the file has none.

    Size and side of the normals are checked.

    Parameters
    ----------
    path
        A contact file (`Contacts.load`), or a file of points without normals
        (`io.contact_files.read_point_file`): PLY, CSV, PCD, NPY, NPZ, OFF or a text of numbers.
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
    fields, units = in_metres(Path(path), read_point_file(Path(path)), units)
    approach, own_normals = fields.pop("approach"), fields.pop("normals")
    points = fields["points"]
    require_range("fingertip_radius", fingertip_radius, unit="m")
    try:
        require_plausible_size(points, units)
        if own_normals is None:
            _note_table(path, points, None)
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
        _note_table(path, points, own_normals)
        if approach is not None:
            contacts = with_approach(contacts, approach)
        if viewpoint is not None or normals == "unsigned":
            contacts = orient_normals(contacts, viewpoint=viewpoint, position_noise=position_noise)
        elif normals is None:
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
