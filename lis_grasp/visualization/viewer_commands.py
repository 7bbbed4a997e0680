"""Packed commands of meshcat's viewer, from NumPy arrays.

The viewer reads MessagePack, with objects as three.js loads them. Written here without meshcat's
own classes: these need its server and IPython, and name objects by time and machine.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import umsgpack

from lis_grasp.typing import FloatArray

# Numbers, not uuids of time and machine: equal scenes give equal bytes.
_OBJECT, _GEOMETRY, _MATERIAL = (f"00000000-0000-4000-8000-{n:012x}" for n in range(3))
# MessagePack extension types of the viewer's arrays.
_ARRAYS = {"f": ("Float32Array", 0x17), "u": ("Uint32Array", 0x16)}


def packed_array(rows: npt.NDArray[Any]) -> dict[str, Any]:
    """Return an array (N, K) of single floats or unsigned integers as the viewer reads it."""
    name, code = _ARRAYS[rows.dtype.kind]
    data = umsgpack.Ext(code, rows.astype(f"<{rows.dtype.kind}4", copy=False).tobytes())
    return {"itemSize": rows.shape[1], "type": name, "array": data, "normalized": False}


def set_object(
    path: str,
    kind: str,
    attributes: dict[str, FloatArray],
    material: dict[str, Any],
    *,
    faces: npt.NDArray[np.integer[Any]] | None = None,
    poses: FloatArray | None = None,
) -> bytes:
    """Return the command that draws an object of a three.js `kind` at a path of the scene tree.

    `attributes` are those of its vertices, each (V, 3), `faces` (F, 3); `poses` (N, 4, 4) are those
    of an ``InstancedMesh``.
    """
    data: dict[str, Any] = {
        "attributes": {
            name: packed_array(rows.astype(np.float32)) for name, rows in attributes.items()
        }
    }
    if faces is not None:
        data["index"] = packed_array(faces.astype(np.uint32))
    drawn: dict[str, Any] = {
        "uuid": _OBJECT,
        "type": kind,
        "geometry": _GEOMETRY,
        "material": _MATERIAL,
        "matrix": np.eye(4).ravel().tolist(),
    }
    if poses is not None:
        columns = poses.astype(np.float32).swapaxes(1, 2).reshape(-1, 16)  # column-major
        drawn |= {"count": len(poses), "instanceMatrix": packed_array(columns)}
    lowered = {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [{"uuid": _GEOMETRY, "type": "BufferGeometry", "data": data}],
        "materials": [{"uuid": _MATERIAL, **material}],
        "object": drawn,
    }
    return _pack({"type": "set_object", "object": lowered, "path": f"/{path}"})


def set_animation(clips: Sequence[tuple[str, Sequence[bytes]]]) -> bytes:
    """Return the command that loads an animation, paused, from paths with their packed tracks."""
    animations = []
    for path, tracks in clips:
        head = {"fps": 1, "name": "default"}  # keys are in seconds
        clip = _with_list(head, "tracks", len(tracks), b"".join(tracks))
        animations.append(_pack({"path": f"/{path}", "clip": 0})[:-1] + clip)
    options = {"play": False, "repetitions": 1}
    command = {"type": "set_animation", "options": options, "path": ""}
    return _with_list(command, "animations", len(animations), b"".join(animations))


def packed_track(name: str, kind: str, times: FloatArray, values: FloatArray) -> bytes:
    """Return the keys of one property, times (T,) [s] and values (T, K), as a packed track."""
    single = [("float", "u1"), ("value", ">f4")]
    keys = np.empty(
        len(times),
        [("map", "u1"), ("time", "S5"), ("t", single), ("value", "S6"), ("list", "u1")]
        + [("v", single, (values.shape[1],))],
    )
    keys["map"], keys["time"], keys["value"] = 0x82, b"\xa4time", b"\xa5value"
    keys["list"], keys["t"]["float"], keys["v"]["float"] = 0x90 | values.shape[1], 0xCA, 0xCA
    keys["t"]["value"], keys["v"]["value"] = times, values
    head = {"name": f".{name}", "type": kind}
    return _with_list(head, "keys", len(keys), keys.tobytes())


def _with_list(head: dict[str, Any], name: str, count: int, items: bytes) -> bytes:
    """Return a packed map whose last value is a list of `count` packed items."""
    return _pack({**head, name: []})[:-1] + struct.pack(">BI", 0xDD, count) + items


def _pack(message: dict[str, Any]) -> bytes:
    return bytes(umsgpack.packb(message, force_float_precision="single"))
