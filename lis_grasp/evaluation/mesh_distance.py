"""Exact distances from points to a triangle mesh, many at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]

# Triangles in a leaf of the tree, at most.
_LEAF = 4

# Points searched at once.
_CHUNK = 4096


def distances_to_mesh(points: FloatArray, mesh: trimesh.Trimesh) -> tuple[FloatArray, IndexArray]:
    """Return the distance of each point to the nearest point of a mesh, and the triangle it is on.

    Exact: triangles are in a binary tree of boxes, and a box is opened if it comes nearer than the
    triangle whose centre is nearest, for all points together, level by level.

    Parameters
    ----------
    points
        Shape (P, 3) [m].
    mesh
        With at least one triangle.

    Returns
    -------
    distances
        Shape (P,) [m], at least 0.
    faces
        Shape (P,), a triangle of `mesh.faces` at that distance.
    """
    triangles = np.array(mesh.triangles)
    tree = _BoxTree.of(triangles)
    squares = np.empty(len(points))
    _, faces = cKDTree(triangles.mean(axis=1)).query(points)
    faces = np.asarray(faces, dtype=np.intp).reshape(len(points))
    for start in range(0, len(points), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        near = points[chunk]
        squares[chunk] = _squared_distances(near, triangles[faces[chunk]])
        row, face = tree.candidates(near, squares[chunk])
        measured = _squared_distances(near[row], triangles[face])
        # Rows ascend: the best of each, and where it replaces the first guess.
        best = np.lexsort((face, measured, row))
        best = best[np.unique(row[best], return_index=True)[1]]
        best = best[measured[best] < squares[chunk][row[best]]]
        squares[start + row[best]] = measured[best]
        faces[start + row[best]] = face[best]
    return np.sqrt(squares), faces


@dataclass(frozen=True, slots=True, eq=False)
class _BoxTree:
    """A balanced binary tree of boxes round triangles.

    Parameters
    ----------
    lows, highs
        A pair of arrays of shape (2^level, 3) for each level: corners of the boxes.
    leaves
        Shape (2^depth, L), the triangles in each box of the last level; some are named twice.
    """

    lows: list[FloatArray]
    highs: list[FloatArray]
    leaves: IndexArray

    @classmethod
    def of(cls, triangles: FloatArray) -> _BoxTree:
        """Halve triangles (F, 3, 3) at the median of their centres, along the widest axis."""
        depth = max(0, int(np.ceil(np.log2(len(triangles) / _LEAF))))
        size = -(-len(triangles) // 2**depth)
        centers = triangles.mean(axis=1)
        order = np.minimum(np.arange(size * 2**depth), len(triangles) - 1)[None]  # (boxes, members)
        for _ in range(depth):
            members = centers[order]  # (boxes, members, 3)
            axis = np.ptp(members, axis=1).argmax(axis=1)
            keys = np.take_along_axis(members, axis[:, None, None], axis=2)[..., 0]
            order = np.take_along_axis(order, keys.argsort(axis=1, kind="stable"), axis=1)
            order = order.reshape(2 * len(order), -1)
        corners = triangles[order].reshape(len(order), -1, 3)
        lows, highs = [corners.min(axis=1)], [corners.max(axis=1)]
        for _ in range(depth):
            lows.append(lows[-1].reshape(-1, 2, 3).min(axis=1))
            highs.append(highs[-1].reshape(-1, 2, 3).max(axis=1))
        return cls(lows[::-1], highs[::-1], order)

    def candidates(self, points: FloatArray, squares: FloatArray) -> tuple[IndexArray, IndexArray]:
        """Return pairs (point, triangle) that may be nearer than squared distances (P,).

        Points in ascending order.
        """
        row, box = np.arange(len(points)), np.zeros(len(points), dtype=np.intp)
        for level, (low, high) in enumerate(zip(self.lows, self.highs, strict=True)):
            if level > 0:
                row, box = np.repeat(row, 2), np.repeat(2 * box, 2)
                box[1::2] += 1
            p = points[row]
            gaps = np.maximum(np.maximum(low[box] - p, p - high[box]), 0.0)
            near = np.einsum("rk,rk->r", gaps, gaps) < squares[row]
            row, box = row[near], box[near]
        return np.repeat(row, self.leaves.shape[1]), self.leaves[box].reshape(-1)


def _squared_distances(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the squared distance of each point (P, 3) to its triangle (P, 3, 3)."""
    squares = np.full(len(points), np.inf)
    sides = np.roll(triangles, -1, axis=1) - triangles
    normals = np.cross(sides[:, 0], sides[:, 1])
    areas = np.einsum("pk,pk->p", normals, normals)
    above = areas > 0.0
    for k in range(3):
        side, offset = sides[:, k], points - triangles[:, k]
        length = np.einsum("pk,pk->p", side, side)
        along = np.einsum("pk,pk->p", side, offset) / np.where(length > 0.0, length, 1.0)
        to_side = offset - np.clip(along, 0.0, 1.0)[:, None] * side
        np.minimum(squares, np.einsum("pk,pk->p", to_side, to_side), out=squares)
        above &= np.einsum("pk,pk->p", np.cross(side, offset), normals) >= 0.0
    # Over its inside, a triangle is as far away as its plane.
    heights = np.einsum("pk,pk->p", points - triangles[:, 0], normals)[above]
    squares[above] = np.minimum(squares[above], heights**2 / areas[above])
    return squares
