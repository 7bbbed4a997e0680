"""Hypothesis strategies of degenerate contacts and meshes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from hypothesis import strategies as st
from random_directions import random_directions

from lis_grasp import shapes

Generator = np.random.Generator
Pair = tuple[Any, Any]  # points and normals, or vertices and faces
Fault = Callable[[Generator, Any, Any], Pair]

_SPOILT = (np.nan, np.inf, -np.inf, 1e308, 1e38, 0.0, -0.0, 5e-324)
generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def _some(rng: Generator, rows: Any) -> Any:
    """Return some row numbers, at least one if there are rows."""
    count = max(1, int(len(rows) * rng.uniform(0, 0.5))) if len(rows) else 0
    return rng.integers(max(1, len(rows)), size=count)


def _with_faults(rng: Generator, pair: Pair, names: list[str], faults: dict[str, Fault]) -> Pair:
    """Apply faults in the order of the table: the last ones leave what the others cannot take."""
    for name in sorted(names, key=list(faults).index):
        with np.errstate(all="ignore"):
            pair = faults[name](rng, *pair)
    return pair


# ---------------------------------------------------------------- contacts


def _box(rng: Generator, count: int) -> Pair:
    normals = np.eye(3)[np.arange(count) % 3] * (1 - 2 * (np.arange(count) // 3 % 2))[:, None]
    return np.where(normals != 0.0, 0.5 * normals, rng.uniform(-0.5, 0.5, (count, 3))), normals


def _torus(rng: Generator, count: int) -> Pair:
    u, v = rng.uniform(0, 2 * np.pi, (2, count))
    ring = np.column_stack([np.cos(u), np.sin(u), np.zeros(count)])
    normals = np.cos(v)[:, None] * ring + np.sin(v)[:, None] * [0.0, 0.0, 1.0]
    return 0.35 * ring + 0.15 * normals, normals


def _plane(rng: Generator, count: int) -> Pair:
    normal = random_directions(1, rng)
    points = rng.standard_normal((count, 3))
    return points - (points @ normal.T) * normal, np.repeat(normal, count, axis=0)


def _line(rng: Generator, count: int) -> Pair:
    along = random_directions(1, rng)
    across = np.cross(along, random_directions(1, rng))
    across /= np.linalg.norm(across)
    return rng.standard_normal((count, 1)) * along, np.repeat(across, count, axis=0)


def _plate(rng: Generator, count: int) -> Pair:
    points, sides = rng.uniform(-0.5, 0.5, (count, 3)), rng.choice([-1.0, 1.0], count)
    points[:, 2] = 10.0 ** rng.uniform(-8, -1) * sides
    return points, np.column_stack([np.zeros((count, 2)), sides])


def _grid(rng: Generator, count: int) -> Pair:
    normals = np.eye(3)[rng.integers(3, size=count)] * rng.choice([-1.0, 1.0], (count, 1))
    return rng.integers(-2, 3, (count, 3)) / 4.0, normals


# About 1 across.
_SURFACES: dict[str, Callable[[Generator, int], Pair]] = {
    "sphere": lambda rng, count: (0.5 * (n := random_directions(count, rng)), n),
    "box": _box,
    "torus": _torus,
    "plane": _plane,
    "line": _line,
    "plate": _plate,
    "spot": lambda rng, count: (
        np.tile(rng.standard_normal(3), (count, 1)),
        random_directions(count, rng),
    ),
    "grid": _grid,
    "cloud": lambda rng, count: (rng.standard_normal((count, 3)), random_directions(count, rng)),
}


def _contradicted(rng: Generator, points: Any, normals: Any) -> Pair:
    """Add contacts close to some others, with another normal."""
    rows = _some(rng, points)
    hair = np.abs(points).max(initial=0.0) * 10.0 ** rng.uniform(-15, -2)
    other = -normals[rows] if rng.random() < 0.5 else random_directions(len(rows), rng)
    near = points[rows] + hair * rng.standard_normal((len(rows), 3))
    return np.vstack([points, near]), np.vstack([normals, other])


def _changed_rows(values: Any, rows: Any, factor: float) -> Any:
    factors = np.ones((len(values), 1))
    factors[rows] = factor
    return values * factors


def _random_normals(rng: Generator, points: Any, normals: Any) -> Pair:
    drawn = normals + rng.uniform(0, 2) * rng.standard_normal(normals.shape)
    return points, drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def _jitter(rng: Generator, points: Any, normals: Any) -> Pair:
    size = np.ptp(points, axis=0).max() if len(points) else 0.0
    return points + size * 10.0 ** rng.uniform(-12, 0) * rng.standard_normal(points.shape), normals


def _flattened(rng: Generator, points: Any, others: Any) -> Pair:
    factors = np.ones(3)
    factors[rng.choice(3, size=rng.integers(1, 3), replace=False)] = rng.choice(
        [0.0, 1e-12, 1e-6, 1e-3]
    )
    return points * factors, others


def _clustered(rng: Generator, points: Any, normals: Any) -> Pair:
    drawn = rng.random((len(points), 1)) < 0.8
    return np.where(drawn, points * 10.0 ** rng.uniform(-12, -1), points), normals


def _spoilt(rng: Generator, points: Any, normals: Any) -> Pair:
    spoilt = (points.copy(), normals.copy())
    spoilt[rng.integers(2)][_some(rng, points), rng.integers(3)] = rng.choice(_SPOILT)
    return spoilt


def _misshapen(rng: Generator, points: Any, normals: Any) -> Pair:
    """Change the shape or the type of the arrays."""
    forms = [
        (points[:, :2], normals),
        (points, normals[:-1]),
        (points.ravel(), normals.ravel()),
        (points[None], normals[None]),
        (points.astype(str), normals),
        (points.astype(complex) + 1j, normals),
        (points, normals.astype(object)),
    ]
    return forms[rng.integers(len(forms))]


_CONTACT_FAULTS: dict[str, Fault] = {
    "duplicated": lambda rng, p, n: (
        np.vstack([p, p[rows := _some(rng, p)]]),
        np.vstack([n, n[rows]]),
    ),
    "contradicted": _contradicted,
    "inward": lambda rng, p, n: (p, _changed_rows(n, _some(rng, p), -1.0)),
    "all inward": lambda rng, p, n: (p, -n),
    "random normals": _random_normals,
    "jitter": _jitter,
    "flattened": _flattened,
    "clustered": _clustered,
    "far": lambda rng, p, n: (p + 10.0 ** rng.uniform(-2, 8) * rng.standard_normal(3), n),
    "in millimetres": lambda rng, p, n: (1000.0 * p, n),
    "scaled": lambda rng, p, n: (p * 10.0 ** rng.uniform(*rng.choice([-300, -20, -6], 1), 6), n),
    "spoilt": _spoilt,
    "normals of other length": lambda rng, p, n: (
        p,
        _changed_rows(n, _some(rng, p), rng.choice([0.0, 1e-300, 0.995, 1.2, 2.0, 1e200])),
    ),
    "low precision": lambda rng, p, n: (p.astype(np.float32), n.astype(np.float32)),
    "misshapen": _misshapen,
}
_COUNTS = st.one_of(st.integers(0, 5), st.integers(6, 120), st.just(400))
_OPTIONS = st.fixed_dictionaries(
    {},
    optional={
        name: st.sampled_from(
            [usual, 0.1 * usual, 10 * usual, 0.0, 1e-300, 1.0, 1e3, 1e300, -1.0, np.nan, np.inf]
        )
        for name, usual in (("position_noise", 1e-3), ("normal_noise", 0.05))
    },
)


@st.composite
def contact_inputs(draw: Any) -> tuple[Any, Any, dict[str, float]]:
    """Draw points and normals with up to three faults, and an estimator's options."""
    rng, count = draw(generators), draw(_COUNTS)
    points, normals = _SURFACES[draw(st.sampled_from(sorted(_SURFACES)))](rng, count)
    names = draw(st.lists(st.sampled_from(sorted(_CONTACT_FAULTS)), max_size=3, unique=True))
    pair = _with_faults(rng, (0.1 * points, normals), names, _CONTACT_FAULTS)
    return (*pair, draw(_OPTIONS))


# ---------------------------------------------------------------- meshes


def _bodies(rng: Generator) -> trimesh.Trimesh:
    """Return several bodies: apart, touching, or intersecting."""
    box = trimesh.creation.box(extents=(0.04, 0.05, 0.06))
    parts = [box, trimesh.creation.icosphere(subdivisions=2, radius=0.03), box.copy()]
    step = rng.choice([0.01, 0.04, 0.05, 0.1])
    for i, part in enumerate(parts):
        part.apply_translation([i * step, 0.0, 0.0])
    return trimesh.util.concatenate(parts)


def _soup(rng: Generator) -> trimesh.Trimesh:
    vertices = 0.05 * rng.standard_normal((int(rng.integers(3, 40)), 3))
    faces = rng.integers(len(vertices), size=(int(rng.integers(1, 120)), 3))
    return trimesh.Trimesh(vertices, faces, process=False, validate=False)


_MESHES: dict[str, Callable[[Generator], trimesh.Trimesh]] = {
    "ball": lambda rng: trimesh.creation.icosphere(int(rng.integers(0, 4)), 0.05),
    "box": lambda rng: trimesh.creation.box(extents=rng.uniform(0.02, 0.2, 3)),
    "ring": lambda _: trimesh.creation.annulus(r_min=0.03, r_max=0.06, height=0.05, sections=24),
    "built-in shape": lambda rng: shapes.build(str(rng.choice(shapes.NAMES))).mesh,
    "bodies": _bodies,
    "soup": _soup,
}


def _slivers(rng: Generator, vertices: Any, faces: Any) -> Pair:
    """Add faces with a repeated vertex, or with collinear vertices."""
    flat = faces[_some(rng, faces)].copy()
    if rng.random() < 0.5:
        flat[:, 2] = flat[:, 0]
        return vertices, np.vstack([faces, flat])
    middle = vertices[flat[:, :2]].mean(axis=1)
    flat[:, 2] = len(vertices) + np.arange(len(flat))
    return np.vstack([vertices, middle]), np.vstack([faces, flat])


def _turned(rng: Generator, vertices: Any, faces: Any) -> Pair:
    turned, rows = faces.copy(), slice(None) if rng.random() < 0.5 else _some(rng, faces)
    turned[rows] = turned[rows][:, ::-1]
    return vertices, turned


def _cut(rng: Generator, vertices: Any, faces: Any) -> Pair:
    """Remove the faces on one side of a plane."""
    heights = vertices[faces].mean(axis=1) @ rng.standard_normal(3)
    return vertices, faces[heights > np.quantile(heights, rng.uniform(0, 0.9))]


def _welded(rng: Generator, vertices: Any, faces: Any) -> Pair:
    moved = vertices.copy()
    moved[_some(rng, vertices)] = vertices[rng.integers(len(vertices))]
    return moved, faces


def _quilted(rng: Generator, vertices: Any, faces: Any) -> Pair:
    """Give every triangle its own vertices, slightly moved."""
    corners = vertices[faces.ravel()]
    corners = corners + 10.0 ** rng.uniform(-12, -4) * rng.standard_normal(corners.shape)
    return corners, np.arange(faces.size).reshape(-1, 3)


def _spoilt_vertex(rng: Generator, vertices: Any, faces: Any) -> Pair:
    spoilt = vertices.copy()
    spoilt[rng.integers(len(vertices)), rng.integers(3)] = rng.choice(_SPOILT)
    return spoilt, faces


def _beyond(rng: Generator, vertices: Any, faces: Any) -> Pair:
    """Give a face an index outside of the vertices."""
    wrong = faces.copy()
    wrong[rng.integers(len(wrong)), 0] = rng.choice([-1, len(vertices), 2**31 - 1])
    return vertices, wrong


_MESH_FAULTS: dict[str, Fault] = {
    "open": lambda rng, v, f: (v, np.delete(f, _some(rng, f), axis=0)),
    "cut": _cut,
    "turned": _turned,
    "doubled": lambda rng, v, f: (v, np.vstack([f, f[_some(rng, f)][:, :: rng.choice([-1, 1])]])),
    "finned": lambda rng, v, f: (v, np.vstack([f, rng.integers(len(v), size=(7, 3))])),
    "slivers": _slivers,
    "crumpled": lambda rng, v, f: (_jitter(rng, v, f)[0], f),
    "flat": _flattened,
    "welded": _welded,
    "quilted": _quilted,
    "scaled": lambda rng, v, f: (v * 10.0 ** rng.uniform(-300, 300), f),
    "far": lambda rng, v, f: (v + 10.0 ** rng.uniform(0, 12) * rng.standard_normal(3), f),
    "spoilt": _spoilt_vertex,
    "beyond": _beyond,
    "emptied": lambda rng, v, f: (v, f[: int(rng.integers(3))]),
}


def _text(vertices: Any, faces: Any, row: str, face: str, first: int) -> str:
    lines = [row.format(*vertex) for vertex in vertices.tolist()]
    return "\n".join([*lines, *(face.format(*(f + first)) for f in faces)]) + "\n"


def write_mesh(ending: str, vertices: Any, faces: Any) -> bytes:
    """Return the file of a mesh, whatever its numbers; in STL an invalid index becomes 0."""
    if ending == "obj":
        return _text(vertices, faces, "v {!r} {!r} {!r}", "f {} {} {}", 1).encode()
    if ending == "off":
        body = _text(vertices, faces, "{!r} {!r} {!r}", "3 {} {} {}", 0)
        return f"OFF\n{len(vertices)} {len(faces)} 0\n{body}".encode()
    if ending == "ply":
        numbers = "".join(f"property double {axis}\n" for axis in "xyz")
        head = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{numbers}"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        rows = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
        rows["count"], rows["corners"] = 3, faces
        return head.encode() + vertices.astype("<f8").tobytes() + rows.tobytes()
    rows = np.zeros(len(faces), dtype=[("n", "<f4", (3,)), ("c", "<f4", (3, 3)), ("a", "<u2")])
    with np.errstate(over="ignore"):
        rows["c"] = vertices[np.where((faces >= 0) & (faces < len(vertices)), faces, 0)]
    return bytes(80) + np.array([len(faces)], "<u4").tobytes() + rows.tobytes()


@st.composite
def mesh_inputs(draw: Any) -> Pair:
    """Draw vertices and faces with up to three faults."""
    rng = draw(generators)
    mesh = _MESHES[draw(st.sampled_from(sorted(_MESHES)))](rng)
    vertices = np.array(mesh.vertices, np.float64) + rng.choice([0.0, 0.1, 10.0])
    names = draw(st.lists(st.sampled_from(sorted(_MESH_FAULTS)), max_size=3, unique=True))
    return _with_faults(rng, (vertices, np.array(mesh.faces, np.int64)), names, _MESH_FAULTS)
