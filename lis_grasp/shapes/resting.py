"""Resting poses of a body on a plane: where it rolls to, how likely, and how surely it stays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.geometry import cross, unit
from lis_grasp.records import FrozenArrays, Record
from lis_grasp.typing import FloatArray, Seed

# Faces whose directions agree within this cosine are one.
_SAME_FACE = 1.0 - 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class RestingPose(FrozenArrays, Record):
    """A pose in which a body rests on a plane below it, up to a turn about the vertical.

    Examples
    --------
    >>> [round(pose.probability, 2) for pose in resting_poses(shapes.find("box").mesh)][:2]
    [0.31, 0.31]
    """

    rotation: FloatArray  #: (3, 3), of the body; its last row is the direction that becomes up
    probability: float  #: of a body dropped in a random orientation, without a bounce


def resting_poses(mesh: trimesh.Trimesh, *, merged: float = 0.0) -> tuple[RestingPose, ...]:
    """Return the poses in which a body of uniform density rests on a plane, the likeliest first.

    A random orientation lands on the face of the convex hull that its centre of mass is above, with
    the probability of the face's solid angle about it, and rolls on as in `roll_to_rest`. (Goldberg
    et al. 1999; solid angle of a triangle: Van Oosterom and Strackee 1983.) Poses within an angle
    `merged` [rad] of a likelier one are part of it: an estimate's flat faces are a little uneven.
    """
    normals, heights, corners = _hull_of(mesh)
    shares = _solid_angles(corners) / (4.0 * np.pi)
    following = [_face_below(normals, heights, normal) for normal in normals]
    totals = np.zeros(len(normals))
    for face, share in enumerate(shares):
        while normals[following[face]] @ normals[face] <= _SAME_FACE:
            face = following[face]
        totals[following[face]] += share
    nearest = min(np.cos(merged), _SAME_FACE)
    ends: list[int] = []
    for face in np.argsort(-totals, kind="stable")[: np.count_nonzero(totals)]:
        same = [end for end in ends if normals[end] @ normals[face] > nearest]
        if same:
            totals[same[0]] += totals[face]
        else:
            ends.append(int(face))
    ends.sort(key=lambda end: -totals[end])
    return tuple(RestingPose(_downward(normals[end]), float(totals[end])) for end in ends)


def roll_to_rest(mesh: trimesh.Trimesh, *, rng: Seed = 0) -> FloatArray:
    """Return a rotation (3, 3) in which a body of uniform density rests on a plane below it.

    A random orientation lands on the face of the convex hull that its centre of mass is above. The
    body rolls on over this face, until the centre of mass is above the face that it rests on. Each
    face is nearer to the centre of mass than the one before, so this ends. (Quasi-static stable
    poses: Goldberg et al. 1999.)
    """
    down = unit(np.random.default_rng(rng).normal(size=3))
    return _downward(rest_from(mesh, down))


def rest_from(mesh: trimesh.Trimesh, down: FloatArray) -> FloatArray:
    """Return the direction (3,) of the body that is below once it has rolled to rest.

    It is released with a direction `down` (3,) of its frame below; see `roll_to_rest`.
    """
    normals, heights, _ = _hull_of(mesh)
    while True:
        face = _face_below(normals, heights, down)
        if normals[face] @ down > _SAME_FACE:
            return down
        down = normals[face]


def _hull_of(mesh: trimesh.Trimesh) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the hull's normals (F, 3), heights (F,) and corners (F, 3, 3) about the mass."""
    hull = mesh.convex_hull
    normals = np.asarray(hull.face_normals)
    corners = np.asarray(hull.triangles - mesh.center_mass)
    return normals, np.einsum("fk,fk->f", normals, corners[:, 0]), corners


def _face_below(normals: FloatArray, heights: FloatArray, down: FloatArray) -> int:
    """Return the face that a ray from the centre of mass along `down` (3,) meets."""
    along = normals @ down
    ahead = np.where(along > 0.0, along, 1.0)
    return int(np.argmin(np.where(along > 0.0, heights / ahead, np.inf)))


def _solid_angles(corners: FloatArray) -> FloatArray:
    """Return the solid angles (F,) of triangles (F, 3, 3) at the origin."""
    a, b, c = np.moveaxis(corners, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("fk,fk->f", a, cross(b, c))
    ab, bc, ca = (np.einsum("fk,fk->f", x, y) for x, y in ((a, b), (b, c), (c, a)))
    return np.asarray(2.0 * np.arctan2(np.abs(volume), la * lb * lc + ab * lc + bc * la + ca * lb))


def _downward(down: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) that turns a direction (3,) down.

    Its last row is the direction that becomes +z.
    """
    turn = trimesh.geometry.align_vectors(down, [0.0, 0.0, -1.0])
    return np.asarray(turn[:3, :3])
