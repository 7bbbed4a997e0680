"""Layers of a scene page, and its meshes, lines and motions as commands of meshcat's viewer.

The viewer reads MessagePack, with objects as three.js loads them. They are written here without
meshcat's own classes, which need its server and IPython, and name objects by time and machine.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
import umsgpack
from scipy.spatial.transform import Rotation

from lis_grasp.typing import FloatArray
from lis_grasp.visualization.colours import linear_rgb

# Nodes of the viewer's scene tree. A lift moves all nodes below the object's node.
ROOT = "lis_grasp"
OBJECT_NODE = f"{ROOT}/object"

# Neighbouring faces that meet at a larger angle are drawn with an edge between them.
_CREASE = np.deg2rad(35.0)


# Names are numbers, not uuids of time and machine: equal scenes give equal bytes.
_OBJECT, _GEOMETRY, _MATERIAL = (f"00000000-0000-4000-8000-{n:012x}" for n in range(3))
# MessagePack extension types of the viewer's arrays.
_ARRAYS = {"f": ("Float32Array", 0x17), "u": ("Uint32Array", 0x16)}


@dataclass(frozen=True, slots=True)
class Layer:
    """Part of the page that can be shown or hidden; all texts are plain."""

    identity: str  # in the page's address, for example "grasp-1"
    label: str
    on: bool  # whether it is visible at first
    colour: str  # #rrggbb
    note: str = ""  # a line below the label
    detail: str = ""  # a tooltip


@dataclass(slots=True)
class Canvas:
    """Drawing commands and layers of a scene page, collected in order."""

    commands: list[bytes] = field(default_factory=list)
    layers: list[Layer] = field(default_factory=list)


def material(
    colour: str = "#ffffff",
    *,
    roughness: float = 0.6,
    opacity: float = 1.0,
    vertex_colours: bool = False,
) -> dict[str, Any]:
    """Return a surface material of three.js; `colour` is ``#rrggbb``."""
    return {
        **_material("MeshStandardMaterial", colour),
        "transparent": opacity != 1.0,
        "opacity": opacity,
        "vertexColors": 2 if vertex_colours else 0,
        "roughness": roughness,
        "metalness": 0.0,
    }


def draw_mesh(
    path: str,
    mesh: trimesh.Trimesh,
    surface: dict[str, Any],
    colours: FloatArray | None = None,
) -> bytes:
    """Return the command that draws `mesh` at `path`, with sRGB `colours` (V, 3) if given."""
    attributes, faces = _shaded(mesh, colours)
    return set_object(path, "Mesh", attributes, surface, faces=faces)


def draw_copies(
    path: str, mesh: trimesh.Trimesh, surface: dict[str, Any], poses: FloatArray
) -> bytes:
    """Return the command that draws `mesh` at each of `poses` (N, 4, 4)."""
    attributes, faces = _shaded(mesh)
    return set_object(path, "InstancedMesh", attributes, surface, faces=faces, poses=poses)


def draw_segments(path: str, segments: FloatArray, colour: str) -> bytes:
    """Return the command that draws line `segments` (E, 2, 3) [m], one pixel wide."""
    lines = _material("LineBasicMaterial", colour)
    return set_object(path, "LineSegments", {"position": segments.reshape(-1, 3)}, lines)


def animate(times: FloatArray, poses: Sequence[tuple[str, FloatArray]]) -> bytes:
    """Return the command that loads an animation, paused.

    `times` (T,) [s] increase from 0. Each node path has its poses (T, 4, 4) in its parent's frame.
    """
    clips = []
    for path, X in poses:
        rotations = np.array(X[:, :3, :3])  # SciPy before 1.16 takes no read-only arrays
        quaternions = Rotation.from_matrix(rotations).as_quat()  # (T, 4) x, y, z, w
        properties = ("position", "vector3", X[:, :3, 3]), ("quaternion", "quaternion", quaternions)
        tracks = []
        for name, kind, values in properties:
            keep = _bends(times, values)
            tracks.append(packed_track(name, kind, times[keep], values[keep]))
        clips.append((path, tracks))
    return set_animation(clips)


def _material(kind: str, colour: str) -> dict[str, Any]:
    """Return the properties of an opaque material that every kind has."""
    return {
        "type": kind,
        "color": int(colour[1:], 16),
        "reflectivity": 0.5,
        "side": 2,  # both
        "transparent": False,
        "opacity": 1.0,
        "linewidth": 1.0,
        "wireframe": False,
        "wireframeLinewidth": 1.0,
        "vertexColors": 0,
    }


def _shaded(
    mesh: trimesh.Trimesh, colours: FloatArray | None = None
) -> tuple[dict[str, FloatArray], npt.NDArray[np.int64]]:
    """Return attributes (V, 3) of vertices with normals, so that edges stay sharp, and faces."""
    vertices, faces, normals, source = shade(mesh)
    coloured = {} if colours is None else {"color": linear_rgb(colours)[source]}
    return {"position": vertices, **coloured, "normal": normals}, faces


def shade(
    mesh: trimesh.Trimesh,
) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray, npt.NDArray[np.int64]]:
    """Return vertices, faces, unit normals and source vertices of `mesh`, split at its edges.

    A corner's normal is the area-weighted mean over the faces around its vertex within 35 deg of
    its own face. Corners of one vertex with equal normals become one drawn vertex. Shapes are
    (K, 3) [m], (F, 3), (K, 3) and (K,): `source` is the vertex of `mesh` that each is drawn for.
    """
    faces = np.asarray(mesh.faces, dtype=np.int64)
    cross = np.cross(*(np.diff(mesh.triangles, axis=1).transpose(1, 0, 2)))  # (F, 3), 2 area
    double_area = np.linalg.norm(cross, axis=1)
    unit = cross / np.maximum(double_area, 1e-300)[:, None]
    corners = faces.ravel()  # (3F,) the vertex of each corner
    order = np.argsort(corners, kind="stable")
    valence = np.bincount(corners, minlength=len(mesh.vertices))
    first = np.cumsum(valence) - valence
    # All pairs (corner, corner of the same vertex): a corner meets `valence` of them.
    many = valence[corners]
    left = np.repeat(np.arange(len(corners)), many)
    within = np.arange(len(left)) - np.repeat(np.cumsum(many) - many, many)
    right = order[first[corners[left]] + within]
    close = np.einsum("ij,ij->i", unit[left // 3], unit[right // 3]) > np.cos(_CREASE)
    normals, terms = np.zeros((len(corners), 3)), cross[right[close] // 3]
    for k in range(3):
        normals[:, k] = np.bincount(left[close], terms[:, k], len(corners))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(lengths > 0.0, normals / np.maximum(lengths, 1e-300), [0.0, 0.0, 1.0])
    key = corners  # and the normal's coordinates in steps of 1/200
    for coordinate in np.round(normals * 200.0).astype(np.int64).T:
        key = 401 * key + coordinate
    _, chosen, index = np.unique(key, return_index=True, return_inverse=True)
    source = corners[chosen]
    return np.asarray(mesh.vertices)[source], index.reshape(-1, 3), normals[chosen], source


def _bends(times: FloatArray, values: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which keys are not on a straight line between their neighbours."""
    keep = np.ones(len(times), dtype=bool)
    if len(times) > 2:
        fraction = ((times[1:-1] - times[:-2]) / (times[2:] - times[:-2]))[:, None]
        straight = values[:-2] + fraction * (values[2:] - values[:-2])
        keep[1:-1] = np.abs(values[1:-1] - straight).max(axis=1) > 1e-9
    return keep


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

    `attributes` belong to its vertices, each (V, 3), `faces` (F, 3); `poses` (N, 4, 4) belong to
    an ``InstancedMesh``.
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
