"""Connected parts of a mesh, their bounding boxes, and the union of those that touch."""

from __future__ import annotations

import fcl
import numpy as np
import trimesh
from trimesh.collision import mesh_to_BVH
from trimesh.graph import connected_component_labels

from lis_grasp.exceptions import InvalidMeshError, counted
from lis_grasp.shapes._topology import signed_volume
from lis_grasp.shapes.mesh_distance import winding_numbers
from lis_grasp.typing import FloatArray, IntArray

# Crossings a face: up to five where solids meet or coincide. With more than this, solids are torn
# and their union may take minutes; the second number of crossings is always permitted.
_MOST_CROSSINGS = 10
_FEW_CROSSINGS = 1000


def each_part(mesh: trimesh.Trimesh) -> list[IntArray]:
    """Return the face indices of every connected part of a mesh."""
    return _rows_by_label(connected_component_labels(mesh.face_adjacency, len(mesh.faces)))


def unite_parts(mesh: trimesh.Trimesh, repairs: list[str]) -> trimesh.Trimesh:
    """Unite solid parts that touch, and leave out those inside others; list it in `repairs`.

    Parts that touch nothing keep the file's own triangles.
    """
    bodies = [b for b in each_part(mesh) if signed_volume(mesh.triangles[b]) > 0.0]
    if len(bodies) < 2:
        return mesh
    low, high = boxes(mesh, bodies)
    joined: list[trimesh.Trimesh] = []
    replaced: list[IntArray] = []
    count = inner = 0
    for group in overlapping_groups(low, high):
        if len(group) < 2:
            continue
        parts = [mesh.submesh([bodies[i]], append=True, repair=False) for i in group]
        united = unite(parts)
        area = sum(float(part.area) for part in parts)
        if not united.is_watertight or united.area > (1.0 - 1e-6) * area:
            continue
        joined.append(united)
        replaced += [bodies[i] for i in group]
        inside = _inner_parts(parts)
        inner += inside
        count += len(group) - inside if len(group) - inside > 1 else 0
    if not joined:
        return mesh
    if count:
        repairs.append(f"united {count} parts that touch")
    if inner:
        repairs.append(f"left out {counted(inner, 'part')} inside of another")
    kept = np.ones(len(mesh.faces), dtype=bool)
    kept[np.concatenate(replaced)] = False
    if not kept.any():
        return joined[0] if len(joined) == 1 else trimesh.util.concatenate(joined)
    mesh.update_faces(kept)
    mesh.remove_unreferenced_vertices()
    return trimesh.util.concatenate([mesh, *joined])


def _inner_parts(parts: list[trimesh.Trimesh]) -> int:
    """Count the solids that are inside of another one, which their union does not show."""
    bounds = np.array([part.bounds for part in parts])
    within = (bounds[:, None, 0] > bounds[None, :, 0]) & (bounds[:, None, 1] < bounds[None, :, 1])
    pairs = np.argwhere(within.all(axis=2))  # the first in the box of the second
    return len({int(i) for i, k in pairs if _is_inside(parts[i], parts[k])})


def _is_inside(part: trimesh.Trimesh, solid: trimesh.Trimesh) -> bool:
    turns = winding_numbers(np.asarray(part.vertices), solid.vertices, solid.faces)
    return bool((turns > 0.5).all())


def boxes(mesh: trimesh.Trimesh, bodies: list[IntArray]) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest corners of parts, shapes (B, 3) [m]."""
    corners = np.array(mesh.triangles)
    rows, starts = np.concatenate(bodies), np.cumsum([0, *map(len, bodies[:-1])])
    low = np.minimum.reduceat(corners.min(axis=1)[rows], starts)
    return low, np.maximum.reduceat(corners.max(axis=1)[rows], starts)


def overlapping_groups(low: FloatArray, high: FloatArray) -> list[IntArray]:
    """Return groups of boxes that overlap, directly or through others; each box is in one group.

    `low` and `high`, shapes (B, 3), are the boxes' corners; boxes that touch overlap. The time
    grows with the boxes that overlap along the axis of the largest extent, not with all pairs.
    """
    axis = int(np.argmax(high.max(axis=0) - low.min(axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    low, high = low[order], high[order]
    last = np.searchsorted(low[:, axis], high[:, axis], side="right")
    first, second = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for i, end in enumerate(last):
        ahead = slice(i + 1, int(end))
        meet = np.all((low[ahead] <= high[i]) & (high[ahead] >= low[i]), axis=1)
        others = i + 1 + np.flatnonzero(meet)
        first.append(np.full(len(others), i))
        second.append(others)
    pairs = np.column_stack([np.concatenate(first), np.concatenate(second)])
    return _rows_by_label(connected_component_labels(pairs, len(low))[np.argsort(order)])


def _rows_by_label(labels: IntArray) -> list[IntArray]:
    """Return the rows of each label from 0, in order."""
    if not len(labels):
        return []
    rows = np.argsort(labels, kind="stable")
    return np.split(rows, np.cumsum(np.bincount(labels))[:-1])


def unite(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Return the union of solids, pair by pair.

    They are moved to the origin first, because Manifold computes in single precision. Raises
    `InvalidMeshError` if their faces cross each other nearly everywhere.
    """
    middle = np.mean([part.bounds.mean(axis=0) for part in parts], axis=0)
    parts = [part.copy().apply_translation(-middle) for part in parts]
    most = _FEW_CROSSINGS + _MOST_CROSSINGS * sum(len(part.faces) for part in parts)
    while len(parts) > 1:
        pairs = [parts[i : i + 2] for i in range(0, len(parts), 2)]
        left = most
        for pair in pairs:
            left -= _crossings(pair[0], pair[-1], left + 1) if len(pair) == 2 else 0
            if left < 0:
                raise InvalidMeshError(
                    "has parts that cross each other everywhere, as a torn mesh does: repair it by"
                    " hand, for example with MeshLab or Blender"
                )
        parts = [
            trimesh.boolean.union(pair, engine="manifold", check_volume=False) for pair in pairs
        ]
    return parts[0].apply_translation(middle)


def _crossings(a: trimesh.Trimesh, b: trimesh.Trimesh, most: int) -> int:
    """Count the pairs of faces of two meshes that meet, at most `most`."""
    if not (len(a.faces) and len(b.faces)):  # Manifold drops tiny parts; FCL would crash on them
        return 0
    request = fcl.CollisionRequest(num_max_contacts=most, enable_contact=False)
    objects = [fcl.CollisionObject(mesh_to_BVH(mesh)) for mesh in (a, b)]
    return int(fcl.collide(*objects, request, fcl.CollisionResult()))
