"""Layers of a scene page, and deterministic drawing commands of the meshcat viewer."""

from __future__ import annotations

import warnings
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

with warnings.catch_warnings():
    # meshcat imports deprecated modules of pyzmq, which are not used here.
    warnings.simplefilter("ignore", DeprecationWarning)
    from meshcat import animation, commands, geometry
    from meshcat.path import Path as ScenePath


# Nodes of the viewer's scene tree. A lift moves all nodes below that of the object.
ROOT = "lis_grasp"
OBJECT_NODE = f"{ROOT}/object"

# Neighbouring faces that meet at a larger angle are drawn with an edge between them.
_CREASE = np.deg2rad(35.0)


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


class _ShadedMesh(geometry.TriangularMeshGeometry):  # type: ignore[misc]
    """Triangles with a normal at each vertex, so that edges stay sharp and the rest smooth."""

    def __init__(self, mesh: trimesh.Trimesh, colours: FloatArray | None = None) -> None:
        vertices, faces, normals, source = shade(mesh)
        colours = None if colours is None else linear_rgb(colours)[source]
        super().__init__(vertices, faces, colours)
        self.normals = normals.astype(np.float32)

    def lower(self, object_data: dict[str, Any]) -> dict[str, Any]:
        lowered: dict[str, Any] = super().lower(object_data)
        packed = geometry.pack_numpy_array(self.normals.T)
        lowered["data"]["attributes"]["normal"] = packed
        return lowered


class _Copies(geometry.Object):  # type: ignore[misc]
    """One geometry drawn at many poses (three.js InstancedMesh)."""

    _type = "InstancedMesh"

    def __init__(self, shape: Any, material: Any, poses: FloatArray) -> None:
        super().__init__(shape, material)
        self.poses = poses  # (N, 4, 4)

    def lower(self) -> dict[str, Any]:
        lowered: dict[str, Any] = super().lower()
        columns = self.poses.astype(np.float32).swapaxes(1, 2).reshape(-1, 16)  # column-major
        matrix = geometry.pack_numpy_array(columns.T)
        lowered["object"] |= {"count": len(self.poses), "instanceMatrix": matrix}
        return lowered


class _Standard(geometry.GenericMaterial):  # type: ignore[misc]
    """three.js MeshStandardMaterial: roughness and metalness instead of a highlight's colour."""

    _type = "MeshStandardMaterial"


def material(
    colour: str = "#ffffff",
    *,
    roughness: float = 0.6,
    opacity: float = 1.0,
    vertex_colours: bool = False,
) -> Any:
    """Return a surface material; `colour` is ``#rrggbb``."""
    return _Standard(
        color=int(colour[1:], 16),
        roughness=roughness,
        metalness=0.0,
        opacity=opacity,
        vertexColors=vertex_colours,
    )


def draw_mesh(
    path: str, mesh: trimesh.Trimesh, surface: Any, colours: FloatArray | None = None
) -> bytes:
    """Return the command that draws `mesh` at `path`, with sRGB `colours` (V, 3) if given."""
    return _draw(path, geometry.Mesh(_ShadedMesh(mesh, colours), surface))


def draw_copies(path: str, mesh: trimesh.Trimesh, surface: Any, poses: FloatArray) -> bytes:
    """Return the command that draws `mesh` at each of `poses` (N, 4, 4)."""
    return _draw(path, _Copies(_ShadedMesh(mesh), surface, poses))


def draw_segments(path: str, segments: FloatArray, colour: str) -> bytes:
    """Return the command that draws line `segments` (E, 2, 3) [m], one pixel wide."""
    points = geometry.PointsGeometry(segments.reshape(-1, 3).T)
    material = geometry.LineBasicMaterial(color=int(colour[1:], 16))
    return _draw(path, geometry.LineSegments(points, material))


def animate(times: FloatArray, poses: Sequence[tuple[str, FloatArray]]) -> bytes:
    """Return the command that loads an animation, paused.

    `times` (T,) [s] increase from 0. Each node path has its poses (T, 4, 4) in its parent's frame.
    """
    clips = {}
    for path, X in poses:
        rotations = np.array(X[:, :3, :3])  # SciPy before 1.16 takes no read-only arrays
        quaternions = Rotation.from_matrix(rotations).as_quat()  # (T, 4) x, y, z, w
        clip = animation.AnimationClip(fps=1)  # keys are then in seconds
        tracks = ("position", "vector3", X[:, :3, 3]), ("quaternion", "quaternion", quaternions)
        for name, kind, values in tracks:
            keep = _bends(times, values)
            keys = times[keep].tolist(), values[keep].tolist()
            clip.tracks[name] = animation.AnimationTrack(name, kind, *keys)
        clips[ScenePath(tuple(path.split("/")))] = clip
    motion = animation.Animation(clips=clips)
    return _pack(commands.SetAnimation(motion, play=False, repetitions=1))


def _draw(path: str, drawn: Any) -> bytes:
    # meshcat names objects by time and machine (uuid1); numbers give equal bytes for equal scenes.
    for number, part in enumerate((drawn, drawn.geometry, drawn.material)):
        part.uuid = f"00000000-0000-4000-8000-{number:012x}"
    return _pack(commands.SetObject(drawn, path=ScenePath(tuple(path.split("/")))))


def _pack(command: Any) -> bytes:
    """Return a meshcat command as the message of a server to the viewer."""
    return bytes(umsgpack.packb(command.lower(), force_float_precision="single"))


def shade(
    mesh: trimesh.Trimesh,
) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray, npt.NDArray[np.int64]]:
    """Return vertices, faces, unit normals and source vertices of `mesh`, split at its edges.

    A corner's normal is the area-weighted mean over the faces round its vertex within 35 deg of
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
    key = np.column_stack([corners, np.round(normals * 200.0).astype(np.int64)])
    _, chosen, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
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
