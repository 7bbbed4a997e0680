"""Depth images and organised clouds, with the YAML file of their camera.

An image is a PNG of 16 bits in millimetres, or a NumPy array in metres, of depths along the optical
axis; a PCD file with rows and columns has points, and its viewpoint is the pose of the camera. A
bag is read by `logs.depth_images`. The YAML file of the camera has what the image does not say::

    intrinsics: {fx: 615.0, fy: 615.0, cx: 319.5, cy: 239.5}   # or K: three rows, or its 9 numbers
    pose: [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.6], [0, 0, 0, 1]]   # on the table
    pixel_center: 0        # of the first pixel: 0, or 0.5 as in Drake's RgbdSensor
    depth_unit: mm         # of the image: m, mm, or metres for a step of it
    mask: mask.png         # optional, beside the YAML file: not 0 where the object is
    hand_eye: {position: 0.002, rotation_degrees: 0.5}   # optional: error of the pose
    topic: /camera/depth/image_rect_raw    # of a bag, where it has several depth images
    frame: table           # of a bag: the pose is that of its transforms in this frame
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lis_grasp.exceptions import InvalidFileError, InvalidInputError, shown
from lis_grasp.io.limits import ReadError, reading
from lis_grasp.io.pcd_files import read_organised_pcd
from lis_grasp.io.yaml_files import read_yaml
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.views.camera import HandEye, Intrinsics
from lis_grasp.views.depth_view import DepthView
from lis_grasp.views.organised_clouds import depth_of_points

_UNITS = {"m": 1.0, "mm": 1e-3}
_OF_BAGS = ("topic", "frame")
_KEYS = ("intrinsics", "K", "pose", "pixel_center", "depth_unit", "mask", "hand_eye", *_OF_BAGS)
_INNER = {"intrinsics": ("fx", "fy", "cx", "cy"), "hand_eye": ("position", "rotation_degrees")}
# Pixels of an image at most.
_MOST_PIXELS = 50_000_000
# Depths of a table before a robot [m]: other ones are in another unit.
_NEAREST, _FARTHEST = 0.02, 30.0


@dataclass(frozen=True, slots=True, eq=False)
class RecordedDepth:
    """A depth image as recorded, and what its file says of the camera."""

    path: Path
    values: FloatArray  # (H, W), in units of the file
    unit: float  # the usual one of the format [m]
    intrinsics: Intrinsics | None = None
    X_WC: FloatArray | None = None


def load_image(image: Path | str, camera: Path | str | None = None) -> DepthView:
    """Read a depth view from an image, .png of 16 bits, .npy or .pcd, and the file of its camera.

    Raises
    ------
    InvalidFileError
        If a file is missing or damaged, or a value in it is wrong: `field` names it.
    """
    path = Path(image)
    camera = None if camera is None else Path(camera)
    return view_of(_read_image(path), camera, camera_facts(camera))


def _read_image(path: Path) -> RecordedDepth:
    ending = path.suffix.lower()
    if ending not in (".png", ".npy", ".pcd"):
        message = (
            "depth images are .png of 16 bits, .npy, organised .pcd, or bags of ROS; "
            f"{path} is {shown(ending)}"
        )
        raise InvalidFileError(message, path=path)
    with reading(path, "a depth image"):
        if ending == ".pcd":
            points, viewpoint = read_organised_pcd(path)
            try:
                depth, intrinsics, X_SC = depth_of_points(points)
            except InvalidInputError as error:
                raise ReadError(str(error)) from None
            pose = None if viewpoint is None else viewpoint @ X_SC
            return RecordedDepth(path, depth, 1.0, intrinsics, pose)
        if ending == ".npy":
            array = np.load(path, allow_pickle=False)
            unit = 1e-3 if array.dtype.kind in "ui" else 1.0
        else:
            array = _pixels(path)
            unit = 1e-3
            if array.dtype == np.uint8:
                raise ReadError("it has 8 bits: depth needs 16", "write the depth, not a picture")
        if array.ndim != 2 or array.dtype.kind not in "uif":
            raise ReadError(f"it must be numbers in rows and columns; its shape is {array.shape}")
        return RecordedDepth(path, np.asarray(array, dtype=np.float64), unit)


def _pixels(path: Path) -> Any:
    with Image.open(path) as picture:
        if picture.width * picture.height > _MOST_PIXELS:
            raise ReadError(f"it has more than {_MOST_PIXELS} pixels")
        return np.array(picture)


def camera_facts(camera: Path | None) -> Mapping[str, Any]:
    """Return the keys of a camera's file; without a file, none.

    Raises `InvalidFileError` if the file is damaged, or has an unknown key.
    """
    if camera is None:
        return {}
    facts = read_yaml(camera)
    if not isinstance(facts, Mapping):
        raise InvalidFileError(f"{camera} must have keys such as intrinsics", path=camera)
    unknown = sorted(str(key) for key in facts if key not in _KEYS)
    if unknown:
        key = unknown[0]
        outer = [name for name, inner in _INNER.items() if key in inner]
        cure = f"it belongs to {outer[0]}" if outer else f"it may have {', '.join(_KEYS)}"
        message = f"{camera} has the unknown key {key}: {cure}"
        raise InvalidFileError(message, path=camera, field=unknown[0])
    return facts


def view_of(recorded: RecordedDepth, file: Path | None, facts: Mapping[str, Any]) -> DepthView:
    """Return the view of a recorded image; the keys of its camera's file go before it."""
    camera = recorded.path if file is None else file
    scale = _unit(camera, facts.get("depth_unit"), recorded.unit)
    depth = scale * recorded.values
    _require_metres(recorded.path, camera, depth, scale)
    intrinsics, X_WC, shape = recorded.intrinsics, recorded.X_WC, recorded.values.shape
    if intrinsics is None or "K" in facts or "intrinsics" in facts:
        intrinsics = _intrinsics(camera, facts, (shape[0], shape[1]))
    if X_WC is None or "pose" in facts:
        X_WC = _numbers(camera, "pose", facts.get("pose"), (4, 4))
    mask = _mask(camera, facts.get("mask"), shape)
    try:
        hand_eye = _hand_eye(camera, facts.get("hand_eye"))
        return DepthView(depth, intrinsics, X_WC, mask, hand_eye=hand_eye)
    except InvalidInputError as error:
        field = {"X_WC": "pose"}.get(getattr(error, "option", ""), getattr(error, "field", ""))
        raise InvalidFileError(f"{camera}: {error}", path=camera, field=field) from None


def _unit(camera: Path, given: Any, usual: float) -> float:
    if given is None:
        return usual
    unit = _UNITS.get(given, given) if isinstance(given, str) else given
    if isinstance(unit, bool) or not isinstance(unit, int | float) or not 0.0 < unit <= 1.0:
        message = f"{camera}: depth_unit must be m, mm, or metres above 0; it is {shown(given)}"
        raise InvalidFileError(message, path=camera, field="depth_unit")
    return float(unit)


def _require_metres(path: Path, camera: Path, depth: FloatArray, scale: float) -> None:
    """Refuse depths that are plausible in another unit only."""
    known = depth[np.isfinite(depth) & (depth > 0.0)]
    if not len(known):
        raise InvalidFileError(f"{path} has no depth: all of its pixels are unknown", path=path)
    middle = float(np.median(known))
    if not _NEAREST <= middle <= _FARTHEST:
        cure = "mm" if middle > _FARTHEST else "m"
        raise InvalidFileError(
            f"{path}: half of its depths are beyond {middle:.4g} m, with {scale:g} m for a step of"
            f" the image: give depth_unit in {camera}, perhaps {cure}",
            path=camera,
            field="depth_unit",
        )


def _intrinsics(camera: Path, facts: Mapping[str, Any], shape: tuple[int, int]) -> Intrinsics:
    if ("K" in facts) == ("intrinsics" in facts):
        message = f"{camera} must have either intrinsics (fx, fy, cx, cy) or K, a matrix of 3 x 3"
        raise InvalidFileError(message, path=camera, field="intrinsics")
    if "K" in facts:
        given = facts["K"]
        if isinstance(given, list) and len(given) == 9:  # as ROS writes it
            given = [given[:3], given[3:6], given[6:]]
        matrix = _numbers(camera, "K", given, (3, 3))
        if matrix[2, 2] != 1.0 or matrix[2, :2].any() or matrix[0, 1] or matrix[1, 0]:
            swapped = not matrix[:2, 2].any() and matrix[2, :2].any()
            cure = "it is transposed" if swapped else "skew and scale are not supported"
            message = f"{camera}: K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: {cure}"
            raise InvalidFileError(message, path=camera, field="K")
        values = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
    else:
        values = _row(camera, "intrinsics", facts["intrinsics"])
    center = facts.get("pixel_center", 0)
    if center not in (0, 0.5):
        message = f"{camera}: pixel_center must be 0 or 0.5; it is {shown(center)}"
        raise InvalidFileError(message, path=camera, field="pixel_center")
    fx, fy, cx, cy = values.tolist()
    if not (0.0 < cx < shape[1] and 0.0 < cy < shape[0] and fx > 0.0 and fy > 0.0):
        message = (
            f"{camera}: the principal point ({cx:g}, {cy:g}) must be in the image of {shape[1]} x"
            f" {shape[0]} pixels, and focal lengths above 0: the intrinsics are of another image"
        )
        raise InvalidFileError(message, path=camera, field="intrinsics")
    return Intrinsics(fx, fy, cx - center, cy - center)


def _row(camera: Path, field: str, value: Any) -> FloatArray:
    """Return the numbers of a mapping, in the order of its keys in `_INNER`, or of a list."""
    names = _INNER[field]
    if isinstance(value, Mapping):
        absent = [name for name in names if value.get(name) is None]
        if absent:
            message = f"{camera}: {field} must have {', '.join(names)}; it lacks {absent[0]}"
            raise InvalidFileError(message, path=camera, field=field)
        value = [value[name] for name in names]
    return _numbers(camera, field, value, (len(names),))


def _numbers(camera: Path, field: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape or not np.isfinite(array).all():
        size = " x ".join(map(str, shape))
        what = "missing" if value is None else shown(value)
        message = f"{camera}: {field} must be {size} finite numbers; it is {what}"
        raise InvalidFileError(message, path=camera, field=field)
    return array


def _hand_eye(camera: Path, value: Any) -> HandEye:
    if value is None:
        return HandEye(0.0, 0.0)
    position, degrees = _row(camera, "hand_eye", value).tolist()
    return HandEye(position, float(np.deg2rad(degrees)))


def _mask(camera: Path, name: Any, shape: tuple[int, ...]) -> BoolArray | None:
    if name is None:
        return None
    if not isinstance(name, str):
        message = f"{camera}: mask must be the name of an image; it is {shown(name)}"
        raise InvalidFileError(message, path=camera, field="mask")
    return read_mask(camera.parent / name, shape)


def read_mask(path: Path, shape: tuple[int, ...]) -> BoolArray:
    """Return the pixels of an image or array that are not 0, (H, W).

    Raises `InvalidFileError` if it has another shape than `shape`.
    """
    with reading(path, "a mask"):
        array = np.load(path, allow_pickle=False) if path.suffix == ".npy" else _pixels(path)
    if array.ndim == 3:
        array = array[..., :3].max(axis=2)
    if array.shape != shape:
        message = f"{path} must have the depth image's shape {shape}; it has {array.shape}"
        raise InvalidFileError(message, path=path, field="mask")
    return np.asarray(array != 0)
