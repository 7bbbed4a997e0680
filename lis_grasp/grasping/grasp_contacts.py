"""Contacts as they come from a caller, checked and with an origin and a length scale."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.grasping.contact_model import CONE_EDGES, ContactModel, contact_wrenches
from lis_grasp.typing import FloatArray


def checked_contacts(
    points: npt.ArrayLike, normals: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return contacts as arrays of shape (..., C, 3).

    Raises
    ------
    InvalidContactsError
        If they are no such arrays with C >= 1, or not finite, or not one normal for each point.
    """
    points, normals = (_rows(name, a) for name, a in (("points", points), ("normals", normals)))
    if points.shape != normals.shape:
        raise InvalidContactsError(
            f"each point needs one normal; points of shape {points.shape} and normals of shape"
            f" {normals.shape} came"
        )
    return points, normals


def frame_of(
    points: FloatArray, origin: npt.ArrayLike | None, length_scale: npt.ArrayLike | None
) -> tuple[FloatArray, FloatArray]:
    """Return the origin (..., 3) and the length scale (...) of contacts (..., C, 3).

    Where not given, the contacts' centroid, and their largest distance from the origin.
    """
    center = points.mean(axis=-2) if origin is None else np.asarray(origin, dtype=np.float64)
    if length_scale is not None:
        return center, np.asarray(length_scale, dtype=np.float64)
    reach = np.linalg.norm(points - center[..., None, :], axis=-1).max(axis=-1)
    return center, np.where(reach > 0.0, reach, 1.0)


def primitive_wrenches(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    origin: npt.ArrayLike | None = None,
    length_scale: float | None = None,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int = CONE_EDGES,
) -> FloatArray:
    """Return all primitive wrenches (K, 6) of one grasp's contacts (C, 3).

    Arguments and errors as of `contact_wrenches` and `frame_of`.
    """
    points, normals = one_grasp(points, normals)
    center, length = frame_of(points, origin, length_scale)
    return contact_wrenches(
        points,
        normals,
        friction=friction,
        origin=center,
        length_scale=length,
        model=model,
        torsion=torsion,
        edges=edges,
    ).reshape(-1, 6)


def one_grasp(points: npt.ArrayLike, normals: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the contacts of one grasp as arrays of shape (C, 3), or refuse them."""
    points, normals = checked_contacts(points, normals)
    if points.ndim != 2:
        raise InvalidContactsError(f"contacts must be of shape (C, 3); it is {points.shape}")
    return points, normals


def _rows(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        rows = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidContactsError(f"{name} must be numbers of shape (..., C, 3)") from None
    if rows.ndim < 2 or rows.shape[-1] != 3 or not rows.shape[-2] or not np.isfinite(rows).all():
        raise InvalidContactsError(
            f"{name} must be finite numbers of shape (..., C, 3) with C of at least 1; their shape"
            f" is {rows.shape}"
        )
    return rows
