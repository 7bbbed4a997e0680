"""Sampling of contacts on an uncertain estimated surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.geometry import cross, unit
from lis_grasp.grasping._contact_samples import SEARCH_RADIUS
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import Pad
from lis_grasp.shapes.mesh_distance import MeshTree
from lis_grasp.typing import BoolArray, FloatArray

PALM_ERROR, FINGERTIP_ERROR = 0.001, 0.0005
"""Standard deviations of a robot's errors of the palm's pose and of each fingertip's place [m]."""

_GAP = 0.004  # [m] before the plan, where closing starts
_FACE_POINTS = (-0.006, -0.002, 0.0, 0.002, 0.006)  # [m] off the middle, both ways
_FLUSH = 0.0003  # [m]: gaps to the pad that a squeeze closes
_TOUCHING = 1e-9  # [m]: no normal follows from a shorter distance
# Least cosine between a motion and a normal that it closes on.
_NEWTON_STEPS, _GRAZING = 4, 0.2

# Waves of a random field.
_WAVES = 64

# Correlation length of an estimate's errors, in largest extents: the usual spacing of touches.
_CORRELATION_FRACTION = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class UncertainSurface:
    """An estimated surface whose error along its normals is a Gaussian field.

    The field is ``s g``: the estimate's own standard deviation s, which grows with the distance
    from a touch, times a field g of unit deviation and squared-exponential correlation. Errors of
    normals are its slope, ``s grad g + g grad s``. The slope of g has the deviation 1 over the
    correlation length. Slopes of different contacts are drawn independently of each other and of
    the heights: an approximation for contacts that are nearer to each other than two of these
    lengths.
    """

    vertices: cKDTree  # of V points [m]
    deviations: FloatArray  # (V,) [m]: s, one standard deviation along the normal
    gradients: FloatArray  # (V, 3): of the deviations along the surface
    correlation_length: float  # [m]

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh) -> UncertainSurface:
        """Read the deviations from a mesh's vertex attribute ``"uncertainty"``, 0 without it."""
        known = mesh.vertex_attributes.get("uncertainty")
        deviations = np.zeros(len(mesh.vertices)) if known is None else np.asarray(known)
        length = _CORRELATION_FRACTION * float(mesh.extents.max())
        return cls(cKDTree(mesh.vertices), deviations, _gradients(mesh, deviations), length)

    def sample_contacts(
        self, points: FloatArray, normals: FloatArray, *, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return contacts on surfaces that the estimate allows: moved along normals, and tilted.

        Points (B, S, C, 3) [m] and normals (B, S, C, 3) of contacts on the estimate, S samples of
        each of B grasps. All grasps use the same random numbers, so that results are comparable.
        """
        samples, contacts = points.shape[1:3]
        heights = rng.normal(size=(samples, contacts))
        slopes = rng.normal(size=(samples, contacts, 3))
        if not self.deviations.any():
            return points, normals
        nearest = self.vertices.query(points)[1]  # (B, S, C)
        deviations, gradients = self.deviations[nearest], self.gradients[nearest]
        between = np.linalg.norm(points[..., :, None, :] - points[..., None, :, :], axis=-1)
        correlation = np.exp(-0.5 * (between / self.correlation_length) ** 2)  # (B, S, C, C)
        factor = np.linalg.cholesky(correlation + 1e-9 * np.eye(contacts))
        units = np.einsum("bscd,sd->bsc", factor, heights)  # g
        # Where the surface rises, its normal leans back.
        tilt = slopes * (deviations / self.correlation_length)[..., None]
        tilt -= units[..., None] * gradients
        tilt -= (tilt * normals).sum(axis=-1, keepdims=True) * normals
        return points + (units * deviations)[..., None] * normals, unit(
            normals + tilt, least=_TOUCHING
        )


def allowed_meshes(
    mesh: trimesh.Trimesh, count: int, *, rng: np.random.Generator
) -> Iterator[trimesh.Trimesh]:
    """Yield surfaces that an estimate allows: its mesh [m], moved along its normals.

    The field of errors is that of `UncertainSurface`, made of random waves (Rahimi and Recht 2007).
    """
    surface, normals = UncertainSurface.from_mesh(mesh), np.asarray(mesh.vertex_normals)
    for _ in range(count):
        waves = rng.normal(size=(3, _WAVES)) / surface.correlation_length
        phases = rng.uniform(0.0, 2.0 * np.pi, size=_WAVES)
        field = np.sqrt(2.0 / _WAVES) * np.cos(mesh.vertices @ waves + phases).sum(axis=1)
        moved = mesh.vertices + (surface.deviations * field)[:, None] * normals
        yield trimesh.Trimesh(moved, mesh.faces, process=False)


@dataclass(frozen=True, slots=True, eq=False)
class PadContacts:
    """Contacts that the pads of a displaced hand make on an uncertain surface.

    Palm and fingertips are off by a robot's errors, normal with `PALM_ERROR` and
    `FINGERTIP_ERROR` in each coordinate. Each pad closes along its planned normal until it touches
    the mesh; a pad that misses it makes no contact. A rounded pad is a ball: on an edge it gets the
    common normal of ball and edge. A flat pad touches with the nearest of its points; where the
    surface is steeper than its half angle, as on an edge, the normal is the pad's. Then the
    contacts move with the surface's uncertainty.
    """

    hand: Hand
    surface: UncertainSurface
    tree: MeshTree
    face_normals: FloatArray  # (triangles, 3)
    support_height: float  # [m]: height below which no pad gets, as the support stops it; or -inf

    @classmethod
    def on(
        cls, mesh: trimesh.Trimesh, hand: Hand, *, support_height: float = -np.inf
    ) -> PadContacts:
        """Return the contacts of a hand's pads on a mesh, see `UncertainSurface.from_mesh`."""
        surface, normals = UncertainSurface.from_mesh(mesh), np.asarray(mesh.face_normals)
        return cls(hand, surface, MeshTree(mesh), normals, support_height)

    def sample(
        self, batch: GraspBatch, *, samples: int, seed: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return points and normals (B, S, F, 3) of S samples of the contacts of B grasps.

        Pads that do not touch repeat a contact that does. All grasps use the same random numbers,
        so that results are comparable.
        """
        rng = np.random.default_rng(seed)
        off = PALM_ERROR * rng.normal(size=(samples, 1, 3))
        off = off + FINGERTIP_ERROR * rng.normal(size=(samples, len(self.hand.pads), 3))
        off[1::2] = -off[: samples // 2 * 2 : 2]  # in pairs, so that few samples have no mean
        return self.surface.sample_contacts(*self.close(batch, off)[:2], rng=rng)

    def close(self, batch: GraspBatch, off: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the contacts on the mesh of pads `off` (S, F, 3) [m] in H, and which touch."""
        points, normals = np.zeros((2, len(batch), *off.shape))
        touch = np.zeros(points.shape[:-1], dtype=bool)
        for f, pad in enumerate(self.hand.pads):
            used = np.flatnonzero(batch.used[:, f])
            R_OH = batch.X_OH[used, None, :3, :3]
            pad_at = batch.points[used, None, f] + (R_OH @ off[:, f, :, None])[..., 0]  # (b, S, 3)
            inward = np.broadcast_to(-batch.normals[used, None, f], pad_at.shape)
            across = unit(cross(inward, R_OH @ self.hand.approach_H), least=_TOUCHING)
            found = self._touch(pad, pad_at, inward, across)
            points[used, :, f], normals[used, :, f], touch[used, :, f] = found
        first = touch.argmax(axis=-1)[..., None, None]
        points, normals = (
            np.where(touch[..., None], a, np.take_along_axis(a, first, axis=-2))
            for a in (points, normals)
        )
        return points, normals, touch

    def _touch(
        self, pad: Pad, pad_at: FloatArray, inward: FloatArray, across: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the contact of a pad at each place (..., 3) that closes along `inward`."""
        beside = np.zeros_like(pad_at)[..., None, :]
        if pad.radius == 0.0:
            tangents = np.stack([across, cross(inward, across)], axis=-2)  # (..., 2, 3)
            beside = np.concatenate([along * tangents for along in _FACE_POINTS], axis=-2)
        inward = np.broadcast_to(inward[..., None, :], beside.shape)
        centers = pad_at[..., None, :] + beside - pad.radius * inward
        centers[..., 2] = np.maximum(centers[..., 2], self.support_height + pad.radius)
        points, normals, travel = self._advance(centers - _GAP * inward, inward, pad.radius)
        meets = (travel < travel.min(axis=-1, keepdims=True) + _FLUSH)[..., None]
        meets &= travel[..., None] < _GAP + SEARCH_RADIUS
        if pad.radius == 0.0:
            steep = -(normals * inward).sum(axis=-1, keepdims=True) < np.cos(pad.half_angle)
            normals = np.where(steep, -inward, normals)
        touches = meets.any(axis=(-1, -2))
        mean = np.where(meets, points, 0.0).sum(axis=-2) / np.maximum(meets.sum(axis=-2), 1)
        normal = np.where(meets, normals, 0.0).sum(axis=-2)
        return mean, unit(np.where(touches[..., None], normal, -inward[..., 0, :])), touches

    def _advance(
        self, centers: FloatArray, inward: FloatArray, radius: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Move balls (..., 3) until they touch; return points, normals, and how far they moved.

        Newton's method for distance less radius: outside of a convex surface it never overshoots.
        Balls that miss the surface move infinitely far.
        """
        balls, ways = centers.reshape(-1, 3), inward.reshape(-1, 3)
        moved, passes = np.zeros((len(balls), 1)), np.zeros((len(balls), 1), dtype=bool)
        for _ in range(_NEWTON_STEPS):
            _, faces, nearest = self.tree.nearest(balls + moved * ways)
            away = balls + moved * ways - nearest
            distance = np.linalg.norm(away, axis=1, keepdims=True)
            apart = distance > _TOUCHING
            normals = np.where(
                apart, away / np.where(apart, distance, 1.0), self.face_normals[faces]
            )
            closing = -(normals * ways).sum(axis=1, keepdims=True)
            passes |= closing < _GRAZING
            moved += np.where(passes, 0.0, distance - radius) / np.maximum(closing, _GRAZING)
        moved[passes] = np.inf
        shape = centers.shape
        return nearest.reshape(shape), normals.reshape(shape), moved.reshape(shape[:-1])


def _gradients(mesh: trimesh.Trimesh, values: FloatArray) -> FloatArray:
    """Return the gradient (V, 3) along a mesh of piecewise linear values (V,), averaged by area."""
    first, second, third = np.moveaxis(mesh.triangles, 1, 0)
    opposite = np.stack([third - second, first - third, second - first], axis=1)  # (F, 3, 3)
    turned = cross(mesh.face_normals[:, None], opposite)
    by_face = 0.5 * (values[mesh.faces][..., None] * turned).sum(axis=1)  # gradient times area
    members = mesh.faces_sparse  # (V, F)
    areas = members @ mesh.area_faces
    return np.asarray((members @ by_face) / np.where(areas > 0.0, areas, np.inf)[:, None])
