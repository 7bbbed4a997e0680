"""The paper's objects (Ottenhaus et al. 2016, section IV.A), exact, of any size.

The paper gives the shapes and their diameter, 20 cm, but not their proportions. Ours make an
object of graspable size 4 to 10 cm wide where a hand closes on it from above, and high enough for
the fingertips to clear the table. Curved faces are inscribed polyhedra whose chords are within
0.1 mm of the true shape at the paper's size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidOptionError, shown
from lis_grasp.guesses import with_advice
from lis_grasp.io.units import LARGEST, SMALLEST
from lis_grasp.shapes.shape import Shape, sharp_edges
from lis_grasp.typing import FloatArray, IntArray

Patch = tuple[FloatArray, IntArray]
"""Vertices (V, 3) and faces (F, 3) of a part of a surface."""

PAPER_SIZE = 0.20
"""Largest extent of the paper's objects [m]."""


def circle(radius: float, count: int, *, start: float = 0.0) -> FloatArray:
    """Return `count` points of a circle about the origin, counterclockwise from `start` [rad]."""
    angles = start + 2.0 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def polygon(corners: npt.ArrayLike, per_side: int) -> FloatArray:
    """Return a polygon's boundary with each side cut in `per_side` equal pieces, shape (n, 2)."""
    ends = np.asarray(corners, dtype=np.float64)
    fraction = np.arange(per_side)[:, None] / per_side
    sides = [a + fraction * (b - a) for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True)]
    return np.concatenate(sides)


def at_height(outline: FloatArray, z: float) -> FloatArray:
    """Lift a plane outline (n, 2) to a ring (n, 3) at height z."""
    return np.column_stack([outline, np.full(len(outline), z)])


def stack(rings: list[FloatArray], pieces: list[int], *, closed: bool = False) -> Patch:
    """Join rings of equally many points by strips, each strip cut in `pieces` rows.

    Outward is right-handed: rings counterclockwise and going up face away from the axis. With
    `closed` the last ring is joined to the first again, as a tube's is.
    """
    ends = [*rings[1:], rings[0]] if closed else rings[1:]
    rows = [
        low + (high - low) * (i / count)
        for low, high, count in zip(rings, ends, pieces, strict=False)
        for i in range(count)
    ]
    if not closed:
        rows.append(rings[-1])
    n, m = len(rings[0]), len(rows)
    i = np.arange(n)
    j = np.arange(m if closed else m - 1)[:, None]
    here, there = j * n, (j + 1) % m * n
    a, b = here + i, here + (i + 1) % n  # (rows, n)
    c, d = there + (i + 1) % n, there + i
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=-2)
    return np.concatenate(rows), faces.reshape(-1, 3)


def cap(ring: FloatArray, sectors: int, *, up: bool) -> Patch:
    """Fill a flat ring that is star-shaped about its mean point, by ever smaller rings.

    The ring's n points are cut in `sectors` runs of k; the j-th ring from the centre has
    sectors * j points, so that triangles keep about one size.
    """
    n = len(ring)
    k = n // sectors
    center = ring.mean(axis=0)
    around = np.concatenate([ring, ring[:1]])
    vertices, faces = [center[None]], []
    first, inner = 1, 0  # index of the first vertex of this ring, and of the next inner one
    for j in range(1, k + 1):
        at = np.arange(sectors * j) * (k / j)  # position along the outer ring
        low = np.minimum(at.astype(int), n - 1)
        fraction = (at - low)[:, None]
        outline = around[low] + fraction * (around[low + 1] - around[low])
        vertices.append(outline if j == k else center + (outline - center) * (j / k))
        s, i = np.divmod(np.arange(sectors * j), j)
        out = first + s * j + i
        out_next = first + (s * j + i + 1) % (sectors * j)
        smaller = max(sectors * (j - 1), 1)
        within = inner + (s * (j - 1) + i) % smaller
        faces.append(np.stack([within, out, out_next], axis=-1))
        between = i < j - 1
        within_next = inner + (s * (j - 1) + i + 1) % smaller
        faces.append(np.stack([within, out_next, within_next], axis=-1)[between])
        first, inner = first + sectors * j, first
    joined = np.concatenate(faces)
    return np.concatenate(vertices), joined if up else joined[:, ::-1]


def prism(outline: FloatArray, height: float, *, sectors: int, rows: int) -> trimesh.Trimesh:
    """Return the upright prism on an outline (n, 2), from -height/2 to height/2."""
    low, high = at_height(outline, -height / 2), at_height(outline, height / 2)
    caps = [cap(low, sectors, up=False), cap(high, sectors, up=True)]
    return join([caps[0], stack([low, high], [rows]), caps[1]])


def geodesic_sphere(radius: float, frequency: int) -> trimesh.Trimesh:
    """Return an icosahedron with each edge cut in `frequency` pieces, blown up to a sphere.

    With an even frequency the sphere's six points on the axes are vertices.
    """
    solid = trimesh.creation.icosahedron()
    i, j = (a.ravel() for a in np.indices((frequency + 1, frequency + 1)))
    index = np.full((frequency + 1, frequency + 1), -1)
    index[i[i + j <= frequency], j[i + j <= frequency]] = np.arange(np.sum(i + j <= frequency))
    i, j = i[i + j <= frequency], j[i + j <= frequency]
    weights = np.column_stack([frequency - i - j, i, j]) / frequency  # (V, 3), barycentric
    a, b = i[i + j < frequency], j[i + j < frequency]
    c, d = i[i + j < frequency - 1], j[i + j < frequency - 1]
    upright = np.column_stack([index[a, b], index[a + 1, b], index[a, b + 1]])
    turned = np.column_stack([index[c + 1, d], index[c + 1, d + 1], index[c, d + 1]])
    patches = []
    for triangle in np.asarray(solid.triangles):
        flat = weights @ triangle
        round_ = radius * flat / np.linalg.norm(flat, axis=1, keepdims=True)
        patches.append((round_, np.concatenate([upright, turned])))
    return join(patches)


def join(patches: list[Patch]) -> trimesh.Trimesh:
    """Join patches whose borders coincide into one closed mesh."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in patches[:-1]])
    mesh = trimesh.Trimesh(
        np.concatenate([vertices for vertices, _ in patches]),
        np.concatenate([faces + s for (_, faces), s in zip(patches, starts, strict=True)]),
        process=False,
    )
    mesh.merge_vertices()
    return mesh


@with_advice
def box(size: float = PAPER_SIZE) -> Shape:
    """Return an upright box, `size` high, 0.7 by 0.5 `size` wide; its faces look along the axes."""
    _require_size(size)
    outline = polygon(_rectangle(0.35 * size, 0.25 * size), 14)
    return _shape("box", prism(outline, size, sectors=4, rows=22))


@with_advice
def cylinder(size: float = PAPER_SIZE) -> Shape:
    """Return an upright cylinder, `size` high and 0.6 `size` in diameter."""
    _require_size(size)
    return _shape("cylinder", prism(circle(0.3 * size, 96), size, sectors=6, rows=32))


@with_advice
def half_cylinder(size: float = PAPER_SIZE) -> Shape:
    """Return half of a cylinder cut along its axis: `size` high, 0.8 `size` in diameter.

    It rests on its half disc; the flat face looks to -y, the round one to +y.
    """
    _require_size(size)
    radius = 0.4 * size
    arc = circle(radius, 128)[:65]  # both ends included
    flat = np.linspace(arc[-1], arc[0], 33)[1:-1]
    outline = np.concatenate([arc, flat]) - [0.0, radius / 2.0]
    return _shape("half_cylinder", prism(outline, size, sectors=6, rows=32))


@with_advice
def hollow_cylinder(size: float = PAPER_SIZE) -> Shape:
    """Return an upright tube open at both ends, `size` high, 0.7 `size` wide, bore 0.45 `size`."""
    _require_size(size)
    outer, inner = circle(0.35 * size, 96), circle(0.225 * size, 96)
    low, high = -size / 2.0, size / 2.0
    places = ((outer, low), (outer, high), (inner, high), (inner, low))
    rings = [at_height(ring, z) for ring, z in places]
    mesh = join([stack(rings, [32, 6, 32, 6], closed=True)])
    return _shape("hollow_cylinder", mesh)


@with_advice
def sphere(size: float = PAPER_SIZE) -> Shape:
    """Return a sphere of diameter `size`."""
    _require_size(size)
    return _shape("sphere", geodesic_sphere(size / 2.0, 22))


@with_advice
def torus(size: float = PAPER_SIZE) -> Shape:
    """Return a horizontal torus, `size` across; its tube and its hole are `size` / 3 wide."""
    _require_size(size)
    tube = circle(size / 6.0, 60)  # (radial, z) about the tube's centre
    rings = [at_height(circle(size / 3.0 + r, 128), z) for r, z in tube]
    return _shape("torus", join([stack(rings, [1] * len(rings), closed=True)]))


@with_advice
def pentagon(size: float = PAPER_SIZE) -> Shape:
    """Return an upright regular pentagonal prism, `size` high, its corners on a circle.

    The circle is 0.75 `size` in diameter; one corner is in the direction +y.
    """
    _require_size(size)
    radius = 0.375 * size
    corners = circle(radius, 5, start=np.pi / 2.0)
    corners[:, 1] -= radius * (1.0 - np.cos(np.pi / 5.0)) / 2.0  # bounding box about the origin
    return _shape("pentagon", prism(polygon(corners, 12), size, sectors=5, rows=24))


@with_advice
def mallet(size: float = PAPER_SIZE) -> Shape:
    """Return a mallet upright on its head: a box with a round handle upwards, `size` in all.

    The head is 0.7 by 0.4 `size` wide and 0.4 `size` high, the handle 0.28 `size` thick. Where the
    handle meets the head, the surface has a concave circular edge.
    """
    _require_size(size)
    head = polygon(_rectangle(0.35 * size, 0.2 * size), 18)
    handle = circle(0.14 * size, len(head), start=-np.pi / 4.0)
    low, neck, high = -size / 2.0, -0.1 * size, size / 2.0
    places = ((head, low), (head, neck), (handle, neck), (handle, high))
    rings = [at_height(ring, z) for ring, z in places]
    caps = [cap(rings[0], 4, up=False), cap(rings[-1], 4, up=True)]
    return _shape("mallet", join([caps[0], stack(rings, [12, 8, 40]), caps[1]]))


_ALL = (box, cylinder, half_cylinder, hollow_cylinder, sphere, torus, pentagon, mallet)

BUILDERS: Mapping[str, Callable[[float], Shape]] = MappingProxyType(
    {builder.__name__: builder for builder in _ALL}
)
"""The function that builds each built-in shape of a given size [m]."""

NAMES = tuple(BUILDERS)
"""Names of the built-in shapes."""

GRASPABLE_SIZES: Mapping[str, float] = MappingProxyType(
    {name: {"sphere": 0.10, "mallet": 0.14}.get(name, 0.12) for name in NAMES}
)
"""Largest extent at which a hand of human size grasps each shape from above [m]."""


@with_advice
def build(name: str, size: float | None = None) -> Shape:
    """Return a built-in shape.

    Parameters
    ----------
    name
        One of `NAMES`.
    size
        Largest extent [m]; None for the size that a hand can grasp, `PAPER_SIZE` for the paper's.

    Raises
    ------
    InvalidOptionError
        If there is no such shape, or the size is no plausible length in metres.
    """
    if name not in BUILDERS:
        raise InvalidOptionError.not_one_of("shape", name, NAMES)
    return BUILDERS[name](GRASPABLE_SIZES[name] if size is None else size)


def _shape(name: str, mesh: trimesh.Trimesh) -> Shape:
    return Shape(name, mesh, sharp_edges(mesh))


def _rectangle(a: float, b: float) -> list[tuple[float, float]]:
    return [(a, -b), (a, b), (-a, b), (-a, -b)]


def _require_size(size: float) -> None:
    if not SMALLEST <= size <= LARGEST:
        metres = 1e-3 * size
        advice = f": {size:g} mm are {metres:g} m" if SMALLEST <= metres <= LARGEST else ""
        raise InvalidOptionError(
            f"size must be a largest extent from {SMALLEST} to {LARGEST} m; it is"
            f" {shown(size)}{advice}",
            option="size",
            value=size,
        )
