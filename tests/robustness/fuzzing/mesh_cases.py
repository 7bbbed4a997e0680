"""Fuzzing cases of damaged meshes: `shapes.load` repairs or refuses them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from fuzzing.cases import Case, Kind, require
from lis_grasp import shapes
from lis_grasp.typing import FloatArray, IntArray

Generator = np.random.Generator
_Triangles = tuple[FloatArray, IntArray]


def make(group: str, index: int, rng: Generator, folder: Path) -> Case:
    """Return a mesh file of one format with up to three faults."""
    base = str(rng.choice(list(_BASES)))
    vertices, faces = _BASES[base](rng)
    vertices = vertices + rng.standard_normal(3) * rng.choice([0.0, 0.1, 10.0])
    described, sound = [base], base != "soup"
    faults = rng.choice(list(_FAULTS), size=rng.choice(4, p=[0.1, 0.4, 0.3, 0.2]))
    # Faces beyond the vertices come last, since the other faults look vertices up.
    for fault in sorted(faults, key=lambda fault: fault == "beyond"):
        vertices, faces = _FAULTS[fault](rng, vertices, faces)
        described.append(str(fault))
        sound = False
    units = "m"
    if rng.random() < 0.1:
        units = str(rng.choice([*shapes.UNITS, "furlong"]))
        described.append(f"in {units}")
        sound = False
    path = folder / f"mesh.{group}"
    path.write_bytes(_WRITERS[group](vertices, faces))
    if rng.random() < 0.04:
        other = str(rng.choice([".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".step", ""]))
        path = path.rename(path.with_suffix(other))
        described.append(f"named {other or 'without ending'}")
        sound = False

    def check() -> None:
        check_shape(shapes.load(path, units), vertices * shapes.UNITS[units])

    return Case(f"{group} of a " + ", ".join(described), check, sound)


def check_shape(shape: shapes.Shape, given: FloatArray | None = None) -> None:
    """Require a closed, outward mesh with a volume, no larger than the mesh in the file."""
    mesh = shape.mesh
    require(bool(np.isfinite(mesh.vertices).all()), "vertices are finite")
    require(bool(mesh.is_watertight), "mesh is closed")
    require(bool(mesh.is_winding_consistent), "mesh is oriented")
    about_middle = mesh.triangles - mesh.vertices.mean(axis=0)
    require(bool(np.linalg.det(about_middle).sum() > 0.0), "mesh has a volume")
    require(bool(np.isfinite(shape.edges).all()), "edges are finite")
    require(all(repair and "\n" not in repair for repair in shape.repairs), "repairs are sentences")
    if given is not None and np.isfinite(given).all():
        slack = 1e-4 * shape.size + 1e-6 * np.abs(given).max()
        within = (mesh.vertices >= given.min(axis=0) - slack) & (
            mesh.vertices <= given.max(axis=0) + slack
        )
        require(bool(within.all()), "the repair stays within the file's own bounds")


def _solid(mesh: trimesh.Trimesh) -> _Triangles:
    return np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)


def _ball(rng: Generator) -> _Triangles:
    mesh = trimesh.creation.icosphere(subdivisions=int(rng.integers(0, 4)), radius=0.05)
    return _solid(mesh)


def _box(rng: Generator) -> _Triangles:
    return _solid(trimesh.creation.box(extents=rng.uniform(0.02, 0.2, 3)))


def _ring(rng: Generator) -> _Triangles:
    return _solid(trimesh.creation.annulus(r_min=0.03, r_max=0.06, height=0.05, sections=24))


def _tube(rng: Generator) -> _Triangles:
    return _solid(trimesh.creation.cylinder(radius=0.04, height=0.1, sections=24))


def _built_in(rng: Generator) -> _Triangles:
    return _solid(shapes.build(str(rng.choice(shapes.NAMES))).mesh)


def _bodies(rng: Generator) -> _Triangles:
    """Place several bodies: apart, touching, or intersecting."""
    parts = [
        trimesh.creation.box(extents=(0.04, 0.05, 0.06)),
        trimesh.creation.icosphere(subdivisions=2, radius=0.03),
        trimesh.creation.box(extents=(0.04, 0.05, 0.06)),
    ]
    step = rng.choice([0.01, 0.04, 0.05, 0.1])
    for i, part in enumerate(parts):
        part.apply_translation([i * step, 0.0, 0.0])
    return _solid(trimesh.util.concatenate(parts))


def _soup(rng: Generator) -> _Triangles:
    vertices = 0.05 * rng.standard_normal((int(rng.integers(3, 40)), 3))
    return vertices, rng.integers(len(vertices), size=(int(rng.integers(1, 120)), 3))


_BASES: dict[str, Callable[[Generator], _Triangles]] = {
    "ball": _ball,
    "box": _box,
    "ring": _ring,
    "tube": _tube,
    "built-in shape": _built_in,
    "few bodies": _bodies,
    "soup": _soup,
}


def _some(rng: Generator, count: int) -> IntArray:
    return rng.integers(count, size=max(1, int(count * rng.uniform(0, 0.4)))) if count else _NONE


_NONE = np.empty(0, np.int64)


def _open(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    return vertices, np.delete(faces, _some(rng, len(faces)), axis=0)


def _cut(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    """Remove the faces on one side of a plane."""
    heights = vertices[faces].mean(axis=1) @ rng.standard_normal(3)
    return vertices, faces[heights > np.quantile(heights, rng.uniform(0, 0.9))] if len(
        faces
    ) else faces


def _turned(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    turned = faces.copy()
    rows = slice(None) if rng.random() < 0.5 else _some(rng, len(faces))
    turned[rows] = turned[rows][:, ::-1]
    return vertices, turned


def _doubled(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    again = faces[_some(rng, len(faces))]
    again = again[:, ::-1] if rng.random() < 0.5 else again
    return vertices, np.vstack([faces, again])


def _finned(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    """Add triangles between any vertices: edges with three faces, and self-intersections."""
    return vertices, np.vstack([faces, rng.integers(len(vertices), size=(rng.integers(1, 20), 3))])


def _slivers(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    """Add faces with a repeated vertex, or with collinear vertices."""
    flat = faces[_some(rng, len(faces))].copy()
    if rng.random() < 0.5:
        flat[:, 2] = flat[:, 0]
        return vertices, np.vstack([faces, flat])
    middle = vertices[flat[:, :2]].mean(axis=1)
    flat[:, 2] = len(vertices) + np.arange(len(flat))
    return np.vstack([vertices, middle]), np.vstack([faces, flat])


def _crumpled(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    """Move vertices at random, up to self-intersection."""
    size = float(np.nanmax(np.ptp(vertices, axis=0), initial=0.0))
    return vertices + size * 10.0 ** rng.uniform(-9, 0) * rng.standard_normal(vertices.shape), faces


def _flat(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    factors = np.ones(3)
    axes = rng.choice(3, size=rng.integers(1, 3), replace=False)
    factors[axes] = rng.choice([0.0, 1e-12, 1e-6, 1e-3])
    return vertices * factors, faces


def _scaled(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    exponent = 4.0 if rng.random() < 0.7 else 300.0
    with np.errstate(over="ignore"):
        return vertices * 10.0 ** rng.uniform(-exponent, exponent), faces


def _far(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    return vertices + 10.0 ** rng.uniform(0, 12) * rng.standard_normal(3), faces


def _welded(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    """Move some vertices to one place."""
    moved = vertices.copy()
    moved[_some(rng, len(vertices))] = vertices[_some(rng, len(vertices))[0]]
    return moved, faces


def _spoiled(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    spoiled = vertices.copy()
    value = rng.choice([np.nan, np.inf, -np.inf, 1e308, 1e38])
    spoiled[rng.integers(len(vertices)), rng.integers(3)] = value
    return spoiled, faces


def _beyond(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    """Give a face an index outside of the vertices."""
    wrong = faces.copy()
    if len(wrong):
        wrong[rng.integers(len(wrong)), 0] = rng.choice([-1, len(vertices), 2**31 - 1])
    return vertices, wrong


def _emptied(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    return vertices, faces[: int(rng.integers(3))]


def _quilted(rng: Generator, vertices: FloatArray, faces: IntArray) -> _Triangles:
    """Give every triangle its own vertices, slightly moved."""
    corners = vertices[faces.ravel()]
    hair = 10.0 ** rng.uniform(-12, -4) * rng.standard_normal(corners.shape)
    return corners + hair if len(corners) else vertices, np.arange(faces.size).reshape(-1, 3)


_FAULTS: dict[str, Callable[[Generator, FloatArray, IntArray], _Triangles]] = {
    "open": _open,
    "cut": _cut,
    "turned": _turned,
    "doubled": _doubled,
    "finned": _finned,
    "slivers": _slivers,
    "crumpled": _crumpled,
    "flat": _flat,
    "scaled": _scaled,
    "far": _far,
    "welded": _welded,
    "spoiled": _spoiled,
    "beyond": _beyond,
    "emptied": _emptied,
    "quilted": _quilted,
}


def _obj(vertices: FloatArray, faces: IntArray) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]
    return "\n".join(lines).encode() + b"\n"


def _off(vertices: FloatArray, faces: IntArray) -> bytes:
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return "\n".join(lines).encode() + b"\n"


def _ply(vertices: FloatArray, faces: IntArray) -> bytes:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    head += "property double x\nproperty double y\nproperty double z\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
    rows["count"], rows["corners"] = 3, faces
    return head.encode() + vertices.astype("<f8").tobytes() + rows.tobytes()


def _stl(vertices: FloatArray, faces: IntArray) -> bytes:
    """Return a binary STL; an invalid index becomes 0."""
    rows = np.zeros(len(faces), dtype=[("n", "<f4", (3,)), ("c", "<f4", (3, 3)), ("a", "<u2")])
    with np.errstate(over="ignore"):
        rows["c"] = vertices[np.where(faces < len(vertices), faces, 0)]
    return bytes(80) + np.array([len(faces)], "<u4").tobytes() + rows.tobytes()


_WRITERS = {"obj": _obj, "off": _off, "ply": _ply, "stl": _stl}

KIND = Kind(tuple(_WRITERS), make)
