"""Checks of contacts: the side of their normals, points of a table among them, a table too high."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from scipy.spatial import ConvexHull

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError, note
from lis_grasp.geometry import tangent_frame
from lis_grasp.surfaces.contact_verdicts import orient_normals
from lis_grasp.typing import FloatArray

# Heights below this fraction of the extent do not count: the contact is beside the other.
_LEAST_HEIGHT = 0.01
# Pairs are of at most so many contacts.
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
    normals are in one half space, as of one camera view, do not show it either: a bowl and a ball
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


def require_outward_normals(
    contacts: Contacts,
    fault: str = "normals must point out of the object; these point inward",
    cure: str = "Change their sign (`normals` inward does), or keep them by `normals` outward",
) -> None:
    """Raise `InvalidContactsError` if nearly all contacts are in front of the others.

    `fault` and `cure` are the beginning and the end of its message.
    """
    fraction = fraction_in_front(contacts)
    if fraction > INWARD:
        raise InvalidContactsError(
            f"{fault}: seen from a contact, {100 * fraction:.0f} % of the others are in front of"
            f" it. {cure}",
            field="normals",
        )


def turned_outward(contacts: Contacts, side: NormalSide | None = None) -> Contacts:
    """Return contacts whose normals point out of the object, given the side that they point to.

    "inward" normals are flipped, "unsigned" ones get the likeliest signs (`orient_normals`), and
    "outward" ones are kept. None requires outward ones, as far as the contacts show it.

    Raises `InvalidContactsError` if normals of no given side point inward, or inward ones outward,
    `InvalidOptionError` if there is no such side.
    """
    if side not in (None, *get_args(NormalSide)):
        raise InvalidOptionError.not_one_of("normals", side, get_args(NormalSide))
    if side == "unsigned":
        return orient_normals(contacts)
    if side == "inward":
        turned = replace(contacts, normals=-contacts.normals)
        require_outward_normals(
            turned,
            "normals were given as inward, and turned round they point into the object",
            "Leave out `normals`, or turn them yourself and give `normals` outward",
        )
        return turned
    if side is None:
        require_outward_normals(contacts)
    return contacts


def doubt_of_side(contacts: Contacts) -> str:
    """Return why normals may point inward, in words; empty if little speaks for it."""
    fraction = fraction_in_front(contacts)
    if fraction <= DOUBTFUL:
        return ""
    return (
        f"{100 * fraction:.0f} % of the contacts are in front of another: if the estimate is inside"
        " out, normals point inward: change their sign (`normals` inward does)"
    )


def doubt_of_table(contacts: Contacts, height: float | None) -> str:
    """Return by how much contacts are below a table at a height [m], in words; empty if none is."""
    if height is None or not len(contacts):
        return ""
    below = round(1e3 * (height - float(contacts.bounds[0, 2])))
    if below <= 0:
        return ""
    number = int(np.sum(contacts.points[:, 2] < height))
    return (
        f"{number} of {len(contacts)} contacts are up to {below} mm below the table, z ="
        f" {height:.4g} m: the estimate ends there"
    )


def require_table_below(height: float | None, highest: float, what: str) -> None:
    """Raise `InvalidOptionError` for a table [m] above the highest point [m] of what is on it."""
    if height is None or height <= highest:
        return
    cure = f": {height:g} mm are {1e-3 * height:g} m" if 1e-3 * height <= highest else ""
    raise InvalidOptionError(
        f"support must be the table's height in metres; at {height:g} m it is above all {what}, up"
        f" to z = {highest:.4g} m{cure}",
        option="support",
        value=height,
    )


def doubt_of_low_table(contacts: Contacts, height: float | None) -> str:
    """Return that a table [m] is further below all contacts than these are apart; else nothing."""
    if height is None or not len(contacts):
        return ""
    gap = float(contacts.bounds[0, 2]) - height
    if gap <= contacts.extent:
        return ""
    return (
        f"the table, z = {height:.4g} m, is {1e3 * gap:.0f} mm below all contacts, which are"
        f" {1e3 * contacts.extent:.0f} mm apart at most: check its height in the contacts' frame"
    )


def _are_of_one_view(normals: FloatArray) -> bool:
    """Return whether nearly all normals (N, 3) are in the half space about their mean."""
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return length > _LEAST_MEAN and bool(np.mean(normals @ (mean / length) > _BORDER) >= _VIEW)


def note_table(path: Path | str, points: FloatArray, normals: FloatArray | None) -> None:
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
