"""PCD files of the Point Cloud Library: columns of points, and clouds with rows and columns."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import make_pose
from lis_grasp.io._point_columns import POINT
from lis_grasp.io.limits import ReadError, require_small
from lis_grasp.typing import FloatArray

_NO_VIEWPOINT = ["0", "0", "0", "1", "0", "0", "0"]


def read_pcd(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Return the fields of a PCD file of PCL: text, binary, or binary with LZF compression.

    Raises ValueError or LookupError if it is damaged, or has less than it announces.
    """
    return _pcd(path)[1]


def read_organised_pcd(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Return the points (H, W, 3) of a PCD file that has the rows and columns of an image.

    Missing points are NaN. Returns its viewpoint, too: the pose (4, 4) of the sensor; None if it
    has none, or the identity, which writers put there that know no pose. Raises as `read_pcd` does.
    """
    head, columns = _pcd(path)
    width, height = (int(head[name][0]) for name in ("WIDTH", "HEIGHT"))
    if height < 2 or width * height != len(columns["x"]):
        raise ReadError(
            f"its points are in no rows and columns: HEIGHT is {height}",
            "write the organised cloud of a camera, before points are removed or joined",
        )
    points = np.stack([columns[name].astype(np.float64) for name in POINT], axis=-1)
    seven = np.array(head.get("VIEWPOINT", _NO_VIEWPOINT), dtype=np.float64)
    turn = Rotation.from_quat(seven[[4, 5, 6, 3]])  # PCL has w first
    pose = make_pose(turn.as_matrix(), seven[:3])
    return points.reshape(height, width, 3), None if np.array_equal(pose, np.eye(4)) else pose


def _pcd(path: Path) -> tuple[dict[str, list[str]], dict[str, npt.NDArray[Any]]]:
    """Return the lines of a PCD file's head by their first words, and its fields."""
    content = path.read_bytes()
    start = re.search(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", content, re.MULTILINE)
    if start is None:
        raise ReadError("it has no line DATA")
    lines = content[: start.start()].decode("ascii", "replace").splitlines()
    head = {words[0]: words[1:] for line in lines if (words := line.split())}
    names, sizes, kinds = head["FIELDS"], map(int, head["SIZE"]), head["TYPE"]
    counts = [int(count) for count in head.get("COUNT", ["1"] * len(names))]
    if not len(names) == len(head["SIZE"]) == len(kinds) == len(counts):
        raise ReadError("its FIELDS, SIZE, TYPE and COUNT are not equally many")
    formats = [f"<{kind.lower()}{size}" for kind, size in zip(kinds, sizes, strict=True)]
    unique = [f"{name}.{number}" for number, name in enumerate(names)]
    row = np.dtype([(n, f, (c,)) for n, f, c in zip(unique, formats, counts, strict=True)])
    points = int(head["POINTS"][0] if "POINTS" in head else head["WIDTH"][0])
    body = content[start.end() :]
    match start[1]:
        case b"ascii":
            lines = body.decode("ascii", "replace").splitlines()
            cells = [words for line in lines if (words := line.split())]
            _require_points(points, len(cells))
            if ragged := [words for words in cells[:points] if len(words) != sum(counts)]:
                raise ReadError(f"a row has {len(ragged[0])} numbers, its fields {sum(counts)}")
            table = np.array(cells[:points], dtype=np.float64).reshape(points, sum(counts))
            starts = np.cumsum([0, *counts[:-1]])
            columns = [table[:, start : start + 1] for start in starts]
        case b"binary":
            _require_points(points, len(body) // row.itemsize)
            data = np.frombuffer(body, row, points)
            columns = [data[name] for name in unique]
        case b"binary_compressed":
            packed, size = (int(n) for n in np.frombuffer(body, "<u4", 2))
            _require_points(points, size // row.itemsize)
            body, at, columns = _unpack_lzf(body[8 : 8 + packed], size), 0, []
            for form, count in zip(formats, counts, strict=True):
                columns.append(np.frombuffer(body, form, points * count, at).reshape(points, -1))
                at += columns[-1].nbytes
        case other:
            raise ReadError(
                "its DATA must be ascii, binary or binary_compressed; they are"
                f" {other.decode('ascii', 'replace')}"
            )
    # Fields of several numbers are descriptors, and _ is padding.
    scalars = zip(names, columns, counts, strict=True)
    return head, {n: values[:, 0] for n, values, count in scalars if count == 1 and n != "_"}


def _require_points(announced: int, held: int) -> None:
    if not 0 <= announced <= held:
        raise ReadError(f"it announces {announced} points, and has {held}")


def _unpack_lzf(packed: bytes, size: int) -> bytes:
    """Unpack LZF (Marc Lehmann's liblzf): literal runs and references backwards."""
    require_small(size)
    out, at = bytearray(), 0
    while at < len(packed) and len(out) <= size:
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        back = ((control & 31) << 8) + packed[at] + 1
        at, start = at + 1, len(out) - back
        if start < 0:
            raise ReadError("its compressed data are damaged")
        for k in range(start, start + length + 2):  # it may overlap its own output
            out.append(out[k])
    if len(out) != size:
        raise ReadError(f"its data unpack to {len(out)} bytes, and {size} are announced")
    return bytes(out)
