"""Tessellation of solids by stacks of closed rings and flat caps.

A ring is a closed polyline, shape (n, 3), counterclockwise seen from above (+z). Every built-in
shape but the sphere is a stack of rings, so that its edge lines are rows of mesh edges exactly.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.typing import FloatArray, IntArray

Patch = tuple[FloatArray, IntArray]
"""Vertices (V, 3) and faces (F, 3) of a part of a surface."""


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
