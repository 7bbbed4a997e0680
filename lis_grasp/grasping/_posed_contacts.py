"""Contact sets of a hand in postures of another planner: where its pads meet the surface."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import as_pose
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.robots.hand import Hand, thumb_of
from lis_grasp.shapes.mesh_distance import closest_points
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

_NEAR = 0.015
"""Largest distance of a pad of a given posture from its contact [m]: planners that close by force
stop short of the surface, or inside it."""


def require_postures(
    hand: Hand, poses: Any, joints: npt.ArrayLike | None
) -> tuple[FloatArray, FloatArray | None]:
    """Return palm poses (N, 4, 4), and joint positions (N, J) if there are any."""
    several = isinstance(poses, Sequence) or np.ndim(poses) == 3
    places = np.array([as_pose(X_OH) for X_OH in (poses if several else [poses])])
    if places.shape[1:] != (4, 4) or not np.isfinite(places).all():
        raise InvalidOptionError(
            "poses must be finite poses (N, 4, 4) of the palm in the object's frame;"
            f" they have the shape {places.shape}",
            option="poses",
        )
    if joints is None:
        return places, None
    postures, shape = np.array(joints, dtype=np.float64, ndmin=2), (len(places), len(hand.lower))
    if postures.shape != shape or not np.isfinite(postures).all():
        raise InvalidOptionError(
            f"joints must be {shape[1]} finite joint positions of '{hand.name}' for each of"
            f" {shape[0]} poses; they have the shape {postures.shape}",
            option="joints",
        )
    return places, postures


def contact_sets_at(
    hand: Hand, mesh: trimesh.Trimesh, poses: FloatArray, joints: FloatArray | None = None
) -> tuple[IndexArray, GraspBatch]:
    """Return the contacts of the thumb and some other pads at each palm pose (N, 4, 4) in O.

    At the joint positions (N, J) [rad or m], a pad's contact is the point of the mesh that is
    nearest to it. Without them, every pregrasp closes: the contact is where the line from the pad's
    centre along its axis first enters the mesh. Returned are the index (B,) of each set's pose, and
    the sets with these initial postures. A pose has no set if the thumb, or every other pad, meets
    nothing.
    """
    pregrasps = np.array(list(hand.pregrasps.values()))  # (G, J)
    thumb = thumb_of(hand.pad_axes(np.eye(4), pregrasps[0]))
    radii = np.array([pad.radius for pad in hand.pads])
    sets = []
    for number, X_OH in enumerate(poses):
        for q in pregrasps if joints is None else joints[number : number + 1]:
            centers, axes = hand.pad_centers(X_OH, q), hand.pad_axes(X_OH, q)
            if joints is None:
                points, normals, met = _entries(mesh, centers, axes)
            else:
                points, normals, met = _nearest(mesh, centers, axes, radii)
            for used in _choices(met, thumb):
                chosen = used[:, None]
                sets.append((number, points * chosen, normals * chosen, used, X_OH, q))
    if not sets:
        return np.zeros(0, dtype=np.intp), GraspBatch.empty(hand)
    numbers, points, normals, used, X_OH, q = (np.array(of) for of in zip(*sets, strict=True))
    return numbers, GraspBatch(points, normals, used, X_OH, q)


def _choices(met: BoolArray, thumb: int) -> list[BoolArray]:
    """Return each choice of pads (F,): the thumb, and at least one of the others that met."""
    others = [int(pad) for pad in np.flatnonzero(met) if pad != thumb]
    sizes = range(1, len(others) + 1 if met[thumb] else 1)
    chosen = chain.from_iterable(combinations(others, size) for size in sizes)
    return [np.isin(np.arange(len(met)), [thumb, *pads]) for pads in chosen]


def _nearest(
    mesh: trimesh.Trimesh, centers: FloatArray, axes: FloatArray, radii: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the points of the mesh nearest to pads, normals (F, 3), and which (F,) are met."""
    points, faces = closest_points(centers, mesh)
    normals = np.asarray(mesh.face_normals)[faces]
    near = np.linalg.norm(points - centers, axis=1) < _NEAR + radii
    return points, normals, near & ((normals * axes).sum(axis=1) < 0.0)


def _entries(
    mesh: trimesh.Trimesh, centers: FloatArray, axes: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return where lines from pads first enter the mesh, normals (F, 3), and which (F,) do."""
    points, normals = np.zeros_like(centers), np.zeros_like(centers)
    ways = np.full(len(centers), np.inf)
    hits, lines, faces = mesh.ray.intersects_location(centers, axes, multiple_hits=True)
    for hit, line, normal in zip(hits, lines, np.asarray(mesh.face_normals)[faces], strict=True):
        way = float((hit - centers[line]) @ axes[line])
        if normal @ axes[line] < 0.0 and way < ways[line]:
            ways[line], points[line], normals[line] = way, hit, normal
    return points, normals, np.isfinite(ways)
