"""Mesh repair: close and orient any triangle mesh, and list the changes.

A scan or an exported mesh may lack faces, have them twice, turned over, or more than two at an
edge. First, faces that cannot be part of a surface are dropped, and solids that touch are
separated. What is left has closed boundary loops, and each loop is filled. Last, solids that
overlap are united.
"""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidMeshError, counted
from lis_grasp.shapes._parts import boxes, each_part, unite_parts
from lis_grasp.shapes._topology import (
    boundary_loops,
    disagreeing_faces,
    drop_fins,
    edge_groups,
    fill_loop,
    is_bad_edge,
    signed_volume,
    split_at_shared_edges,
)
from lis_grasp.shapes.mesh_distance import winding_numbers
from lis_grasp.typing import BoolArray, FloatArray, IntArray

# Vertices closer than this part of the object's size are one vertex written twice.
_SAME_VERTEX = 1e-6
# A speck has less than this fraction of the largest part's volume; a sheet, of its own box's.
_SPECK = 1e-5
_SHEET = 1e-4
# Number of places, sampled on a part, that show whether it is inside another part.
_PLACES = 50
# A file with more holes is a heap of loose triangles.
_MOST_HOLES = 2000


def repair_mesh(vertices: FloatArray, faces: IntArray) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """Return a closed, outward mesh of the triangles, and the repairs, one sentence each.

    Raises `InvalidMeshError` if the triangles enclose no volume, or could not be closed.
    """
    repairs: list[str] = []
    mesh = _merged(vertices, faces)
    _drop_degenerate(mesh, repairs)
    _orient(mesh, repairs)
    mesh = _close(mesh, repairs)
    _turn_parts_outward(mesh, repairs)
    _flip_slivers(mesh, repairs)
    mesh = _drop_specks(mesh, repairs)
    # The volume of the bounding box, no side taken thinner than a thousandth.
    boxed = len(mesh.faces) and np.prod(np.maximum(mesh.extents, 1e-3 * mesh.extents.max()))
    if not boxed or signed_volume(mesh.triangles) < _SHEET * boxed:
        raise InvalidMeshError("encloses no volume, as a flat sheet does: a solid object is needed")
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        raise InvalidMeshError(
            "could not be closed: repair it by hand, for example with MeshLab or Blender"
        )
    return unite_parts(mesh, repairs), tuple(repairs)


def _merged(vertices: FloatArray, faces: IntArray) -> trimesh.Trimesh:
    """Join vertices written more than once (every STL; seams of textures elsewhere)."""
    used, numbers = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], numbers.reshape(-1, 3)
    size = np.ptp(vertices, axis=0).max()
    keys = np.round((vertices - vertices.min(axis=0)) / (_SAME_VERTEX * size))
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # keep the file's order
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    mesh = trimesh.Trimesh(
        vertices[first[order]], rank[inverse.reshape(-1)][faces], process=False, validate=False
    )
    mesh.remove_unreferenced_vertices()
    return mesh


def _drop_degenerate(mesh: trimesh.Trimesh, repairs: list[str]) -> None:
    """Drop faces that name a vertex twice, and faces that are there twice."""
    faces = np.asarray(mesh.faces)
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not proper.all():
        repairs.append(f"dropped {counted(int((~proper).sum()), 'face')} without area")
        mesh.update_faces(proper)
    faces = np.asarray(mesh.faces)
    ordered = np.sort(faces, axis=1)
    _, inverse = np.unique(ordered, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    # Faces on the same vertices: one of each orientation is enough; opposite ones cancel.
    even = _is_even(faces, ordered)
    turns = np.where(even, 1, -1)
    net = np.zeros(inverse.max(initial=-1) + 1, dtype=np.int64)
    np.add.at(net, inverse, turns)
    wanted = np.sign(net)[inverse] == turns
    rows = np.flatnonzero(wanted)
    kept = np.zeros(len(faces), dtype=bool)
    kept[rows[np.unique(inverse[rows], return_index=True)[1]]] = True
    if not kept.all():
        double = int((~kept).sum())
        was = "was" if double == 1 else "were"
        repairs.append(f"dropped {counted(double, 'face')} that {was} there twice")
        mesh.update_faces(kept)
    mesh.remove_unreferenced_vertices()


def _is_even(faces: IntArray, ordered: IntArray) -> BoolArray:
    """Return which faces are an even permutation of their ordered vertices."""
    start = np.argmin(faces, axis=1)
    following = faces[np.arange(len(faces)), (start + 1) % 3]
    return following == ordered[:, 1]


def _orient(mesh: trimesh.Trimesh, repairs: list[str]) -> None:
    """Turn faces so that neighbours agree, and the whole outward."""
    if not len(mesh.faces):
        return
    before = np.asarray(mesh.faces).copy()
    if not mesh.is_winding_consistent:
        wrong = disagreeing_faces(before)
        mesh.faces[wrong] = mesh.faces[wrong][:, ::-1]
        for label in each_part(mesh):
            if signed_volume(mesh.triangles[label]) < 0.0:
                mesh.faces[label] = mesh.faces[label][:, ::-1]
    else:
        # An open sheet has no volume of its own, and must not decide for closed parts.
        closed = _is_closed_part(mesh)
        for part in (np.flatnonzero(closed), np.flatnonzero(~closed)):
            if len(part) and signed_volume(mesh.triangles[part]) < 0.0:
                mesh.faces[part] = mesh.faces[part][:, ::-1]
    after = np.asarray(mesh.faces)
    same = _is_even(before, np.sort(before, axis=1)) == _is_even(after, np.sort(after, axis=1))
    turned = int(np.sum(~same))
    if turned:
        repairs.append(f"turned {counted(turned, 'face')} outward")


def _is_closed_part(mesh: trimesh.Trimesh) -> BoolArray:
    """Return which faces, shape (F,), belong to a part without an open edge."""
    edge, _, count = edge_groups(np.asarray(mesh.faces))
    open_faces = (count[edge] == 1).any(axis=1)
    closed = np.ones(len(mesh.faces), dtype=bool)
    for body in each_part(mesh):
        closed[body] = not open_faces[body].any()
    return closed


def _close(mesh: trimesh.Trimesh, repairs: list[str]) -> trimesh.Trimesh:
    """Separate solids that touch, drop faces at non-manifold edges, fill holes."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    kept = drop_fins(faces)
    dropped, faces = int((~kept).sum()), faces[kept]
    loops: list[IntArray] = []
    longest = 0.0
    if is_bad_edge(*edge_groups(faces)).any() or boundary_loops(faces):
        vertices, faces = split_at_shared_edges(vertices, faces)
        edge, forward, count = edge_groups(faces)
        bad = is_bad_edge(edge, forward, count)[edge].any(axis=1)
        dropped, faces = dropped + int(bad.sum()), faces[~bad]
        loops = boundary_loops(faces)
    if len(loops) > _MOST_HOLES:
        raise InvalidMeshError(
            f"has {len(loops)} holes, as loose triangles do: merge vertices that belong"
            " together, for example with MeshLab or Blender"
        )
    for loop in loops:
        closing, added = fill_loop(vertices, faces, loop)
        ring = vertices[loop]
        around = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum()
        longest = max(longest, float(around))
        vertices, faces = np.concatenate([vertices, added]), np.concatenate([faces, closing])
    if dropped:
        repairs.append(f"took away {counted(dropped, 'face')} at edges with more than two faces")
    if loops:
        holes = counted(len(loops), "hole")
        repairs.append(f"closed {holes}, the largest {1e3 * longest:.0f} mm around")
    closed = trimesh.Trimesh(vertices, faces, process=False, validate=False)
    closed.remove_unreferenced_vertices()
    return closed


def _turn_parts_outward(mesh: trimesh.Trimesh, repairs: list[str]) -> None:
    """Turn closed parts that are inside out, except cavities, which are inside a solid."""
    bodies = each_part(mesh)
    inward = [body for body in bodies if signed_volume(mesh.triangles[body]) < 0.0]
    triangles = np.array(mesh.triangles)
    outward = [body for body in bodies if signed_volume(triangles[body]) > 0.0]
    if not inward or not outward:
        return
    lows, highs = boxes(mesh, outward)
    turned = 0
    for body in inward:
        places = triangles[body[:: max(1, len(body) // _PLACES)]].mean(axis=1)
        around = np.all((lows <= places.min(axis=0)) & (highs >= places.max(axis=0)), axis=1)
        solid = [mesh.faces[outward[i]] for i in np.flatnonzero(around)]
        inside = bool(solid) and bool(
            (winding_numbers(places, mesh.vertices, np.concatenate(solid)) > 0.5).all()
        )
        if not inside:
            mesh.faces[body] = mesh.faces[body][:, ::-1]
            turned += 1
    if turned:
        repairs.append(f"turned {counted(turned, 'part')} outward")


def _flip_slivers(mesh: trimesh.Trimesh, repairs: list[str]) -> None:
    """Give the area of faces without a certain normal to their neighbours."""
    height = _SAME_VERTEX * float(mesh.extents.max()) if len(mesh.faces) else 0.0
    faces, flips = flip_slivers(np.asarray(mesh.vertices), np.asarray(mesh.faces), height=height)
    if flips:
        mesh.faces = faces
        repairs.append(f"flipped {counted(flips, 'edge')} of triangles with vertices on a line")


def _drop_specks(mesh: trimesh.Trimesh, repairs: list[str]) -> trimesh.Trimesh:
    """Drop parts so small that they are dirt of a scan."""
    bodies = each_part(mesh)
    if len(bodies) < 2:
        return mesh
    # Bodies that are all flat are kept: `repair_mesh` refuses them.
    volumes = np.array([abs(signed_volume(mesh.triangles[body])) for body in bodies])
    kept = volumes >= _SPECK * volumes.max()
    if kept.all():
        return mesh
    repairs.append(f"dropped {counted(int((~kept).sum()), 'loose speck')}")
    mesh.update_faces(np.sort(np.concatenate([b for b, k in zip(bodies, kept, strict=True) if k])))
    mesh.remove_unreferenced_vertices()
    return mesh


def flip_slivers(vertices: FloatArray, faces: IntArray, *, height: float) -> tuple[IntArray, int]:
    """Flip the longest edge of each triangle lower than `height` [m] over that edge.

    A sliver has an edge as long as its two others together, and its normal is rounding. The flip
    gives its area to the neighbour across that edge: the surface stays, closed as it was, and no
    vertex is added or removed. A flip that would not make the lower of both triangles higher, or
    would repeat an edge, is not made.

    Returns the faces (F, 3) in their order, and how many flips were made.
    """
    faces = np.array(faces)
    slivers = np.flatnonzero(_heights(vertices, faces) < height)
    # The face on the left of each directed edge; an edge with two such is not manifold.
    left = {}
    for number, face in enumerate(faces.tolist() if len(slivers) else []):
        for k in range(3):
            left[face[k], face[(k + 1) % 3]] = number
    return faces, sum(_flip(vertices, faces, left, int(sliver)) for sliver in slivers)


def _flip(
    vertices: FloatArray, faces: IntArray, left: dict[tuple[int, int], int], sliver: int
) -> bool:
    """Flip the longest edge of a face if that improves both triangles; return whether it did."""
    face = faces[sliver]
    k = int(np.argmax(_edge_lengths(vertices, face[None])[0]))
    a, c, b = (int(face[(k + i) % 3]) for i in range(3))  # the longest edge is from a to c
    neighbour = left.get((c, a))
    if neighbour is None or neighbour == sliver:
        return False
    d = int(next(v for v in faces[neighbour] if v not in (a, c)))
    if d == b or (b, d) in left or (d, b) in left:
        return False
    pair = np.array([face, faces[neighbour]])
    flipped = np.array([[b, a, d], [d, c, b]])
    if _heights(vertices, flipped).min() <= _heights(vertices, pair).min():
        return False
    for edge in ((a, c), (c, a)):
        del left[edge]
    faces[sliver], faces[neighbour] = flipped
    for number, corners in ((sliver, (b, a, d)), (neighbour, (d, c, b))):
        for i in range(3):
            left[corners[i], corners[(i + 1) % 3]] = number
    return True


def _edge_lengths(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the lengths of the edges from each corner to the next, shape (F, 3) [m]."""
    corners = vertices[faces]
    return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1))


def _heights(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the height of each triangle over its longest edge, shape (F,) [m]."""
    corners = vertices[faces]
    doubled = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    longest = _edge_lengths(vertices, faces).max(axis=1)
    return np.asarray(doubled / np.maximum(longest, np.finfo(np.float64).tiny))
