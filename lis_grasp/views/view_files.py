"""Files of depth views: .npz of the image, the camera, its pose and the object's pixels."""

from __future__ import annotations

from dataclasses import astuple
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidFileError, InvalidInputError
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.io.limits import read_arrays
from lis_grasp.views.camera import HandEye, Intrinsics
from lis_grasp.views.depth_noise import DepthNoise
from lis_grasp.views.depth_view import DepthView

_ARRAYS = ("depth", "intrinsics", "X_WC", "mask", "noise", "hand_eye")


def save_view(view: DepthView, path: Path | str) -> None:
    """Write an .npz file of plain arrays (no pickle); a view without a mask has an empty one.

    Examples
    --------
    >>> save_view(DepthView(np.ones((4, 4)), Intrinsics(1, 1, 1, 1), np.eye(4)), "view.npz")
    >>> load_view("view.npz").depth.shape
    (4, 4)
    """
    mask = np.zeros((0, 0), dtype=bool) if view.mask is None else view.mask
    records = (view.intrinsics, view.noise, view.hand_eye)
    intrinsics, noise, hand_eye = (np.array(astuple(record), dtype=float) for record in records)
    short = view.depth.astype(np.float32)  # as cameras have it, if nothing is lost
    depth = short if np.array_equal(short, view.depth, equal_nan=True) else view.depth
    values = (depth, intrinsics, view.X_WC, mask, noise, hand_eye)
    with whole_file(Path(path)) as whole, whole.open("wb") as stream:
        np.savez_compressed(stream, **dict(zip(_ARRAYS, values, strict=True)))  # type: ignore[arg-type]


def load_view(path: Path | str) -> DepthView:
    """Read a view that `save_view` has written.

    Raises `InvalidFileError` if the file is missing or has no valid view.
    """
    path = Path(path)
    arrays = read_arrays(path, _ARRAYS)
    depth, intrinsics, X_WC, mask, noise, hand_eye = (arrays[name] for name in _ARRAYS)
    try:
        return DepthView(
            depth,
            Intrinsics(*map(float, intrinsics)),
            X_WC,
            mask if mask.size else None,
            DepthNoise(*map(float, noise)),
            HandEye(*map(float, hand_eye)),
        )
    except (TypeError, ValueError, InvalidInputError) as error:
        raise InvalidFileError(f"{path} has no valid view: {error}", path=path) from None
