"""Planes, spheres, cylinders and cones: signed distances, and minimal sets of oriented points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lis_grasp.typing import BoolArray, FloatArray, IndexArray

PrimitiveKind = Literal["plane", "sphere", "cylinder", "cone"]

PARAMETERS: dict[PrimitiveKind, int] = {"plane": 3, "sphere": 4, "cylinder": 5, "cone": 6}
"""Free parameters of each kind; an oriented point gives three equations."""

# Lines and planes that are closer to parallel than this do not intersect well.
_PARALLEL = 0.05
# Rounder than a plane is what has a radius below this many extents of the contacts.
_LARGEST_RADIUS = 1.5
# Half angles of cones [rad].
_ANGLES = (np.deg2rad(5.0), np.deg2rad(80.0))


@dataclass(frozen=True, slots=True, eq=False)
class Primitives:
    """M primitives of one kind. Signed distances are negative where the material is.

    plane: side (axis . (x - point)); sphere: side (|x - point| - size); cylinder:
    side (rho - size); cone: side (rho cos(size) - t sin(size)), with t along the axis from the
    apex, rho the distance from the axis.
    """

    kind: PrimitiveKind
    point: FloatArray  # (M, 3): on the plane, the centre, on the axis, the apex
    axis: FloatArray  # (M, 3), unit; of a plane the normal; of a sphere unused
    size: FloatArray  # (M,): radius, or half angle [rad]
    side: FloatArray  # (M,): 1 for a body, -1 for a hole

    def __len__(self) -> int:
        return len(self.size)

    def take(self, chosen: IndexArray | BoolArray) -> Primitives:
        """Return some of the primitives."""
        parts = (self.point, self.axis, self.size, self.side)
        return Primitives(self.kind, *(part[chosen] for part in parts))

    def value_and_gradient(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return signed distances (P, M) of points (P, 3) and their gradients (P, M, 3)."""
        from_point = x[:, None] - self.point  # (P, M, 3)
        side = self.side
        if self.kind == "plane":
            values = np.einsum("pmk,mk->pm", from_point, self.axis)
            gradients = np.broadcast_to(self.axis, from_point.shape)
            return side * values, side[:, None] * gradients
        if self.kind == "sphere":
            lengths = np.linalg.norm(from_point, axis=2)
            units = from_point / np.maximum(lengths, 1e-12)[:, :, None]
            return side * (lengths - self.size), side[:, None] * units
        along = np.einsum("pmk,mk->pm", from_point, self.axis)
        across = from_point - along[:, :, None] * self.axis
        radial = np.linalg.norm(across, axis=2)
        outward = across / np.maximum(radial, 1e-12)[:, :, None]
        if self.kind == "cylinder":
            return side * (radial - self.size), side[:, None] * outward
        c, s = np.cos(self.size), np.sin(self.size)
        gradients = c[:, None] * outward - s[:, None] * self.axis
        return side * (c * radial - s * along), side[:, None] * gradients


def planes_at(points: FloatArray, normals: FloatArray) -> Primitives:
    """Return the tangent planes of oriented points (N, 3)."""
    count = len(points)
    return Primitives("plane", points, normals, np.zeros(count), np.ones(count))


def planes_through(points: FloatArray, normals: FloatArray, triples: IndexArray) -> Primitives:
    """Return planes through triples (M, 3) of points, outward as their normals; fewer than M."""
    p, n = points[triples], normals[triples]  # (M, 3, 3)
    axis = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    lengths = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = axis / np.maximum(lengths, 1e-300)
    sides = np.sign(np.einsum("mik,mk->mi", n, axis)).sum(axis=1)
    usable = (lengths[:, 0] > 1e-4 * np.ptp(points, axis=0).max() ** 2) & (np.abs(sides) == 3.0)
    axis = axis * np.sign(sides)[:, None]
    zero, one = np.zeros(len(p)), np.ones(len(p))
    return Primitives("plane", p.mean(axis=1), axis, zero, one).take(usable)


def spheres_through(points: FloatArray, normals: FloatArray, pairs: IndexArray) -> Primitives:
    """Return spheres through pairs (M, 2) of oriented points; fewer than M, some are impossible.

    The centre is midway between the two lines of normals, where they are nearest (Schnabel, Wahl
    and Klein 2007, section 4.1).
    """
    (p, q), (n, m) = points[pairs.T], normals[pairs.T]
    s, t, usable = _nearest_on_lines(p, n, q, m)
    center = 0.5 * (p + s[:, None] * n + q + t[:, None] * m)
    radius = 0.5 * (np.linalg.norm(p - center, axis=1) + np.linalg.norm(q - center, axis=1))
    usable &= (np.sign(s) == np.sign(t)) & _plausible(radius, points)
    axis = np.broadcast_to([0.0, 0.0, 1.0], p.shape)
    return Primitives("sphere", center, axis, radius, -np.sign(s)).take(usable)


def cylinders_through(points: FloatArray, normals: FloatArray, pairs: IndexArray) -> Primitives:
    """Return cylinders through pairs (M, 2) of oriented points; fewer than M.

    The axis is across both normals; in the plane across it the normals meet at the centre
    (Schnabel et al. 2007, section 4.1).
    """
    (p, q), (n, m) = points[pairs.T], normals[pairs.T]
    axis = np.cross(n, m)
    lengths = np.linalg.norm(axis, axis=1)
    axis = axis / np.maximum(lengths, 1e-12)[:, None]
    q_flat = q - np.einsum("mk,mk->m", q - p, axis)[:, None] * axis
    s, t, usable = _nearest_on_lines(p, n, q_flat, m)
    center = 0.5 * (p + s[:, None] * n + q_flat + t[:, None] * m)
    radius = 0.5 * (np.linalg.norm(p - center, axis=1) + np.linalg.norm(q_flat - center, axis=1))
    usable &= (lengths > _PARALLEL) & (np.sign(s) == np.sign(t)) & _plausible(radius, points)
    return Primitives("cylinder", center, axis, radius, -np.sign(s)).take(usable)


def cones_through(points: FloatArray, normals: FloatArray, triples: IndexArray) -> Primitives:
    """Return cones through triples (M, 3) of oriented points; fewer than M.

    The apex is where the three tangent planes meet; the axis is the normal of the plane through the
    unit vectors from there to the points (Schnabel et al. 2007, section 4.1).
    """
    p, n = points[triples], normals[triples]  # (M, 3, 3)
    usable = np.abs(np.linalg.det(n)) > _PARALLEL
    p, n = p[usable], n[usable]
    apex = np.linalg.solve(n, np.einsum("mik,mik->mi", n, p)[:, :, None])[:, :, 0]
    rays = p - apex[:, None]
    rays /= np.maximum(np.linalg.norm(rays, axis=2, keepdims=True), 1e-12)
    axis = np.cross(rays[:, 1] - rays[:, 0], rays[:, 2] - rays[:, 0])
    lengths = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = axis / np.maximum(lengths, 1e-12)
    cosines = np.einsum("mik,mk->mi", rays, axis)
    axis = axis * np.sign(cosines.mean(axis=1))[:, None]
    angle = np.arccos(np.clip(np.abs(cosines).mean(axis=1), -1.0, 1.0))
    radial = np.einsum("mik,mk->mi", n, axis)  # outward normals of a body look back from the axis
    good = (lengths[:, 0] > 1e-6) & (angle > _ANGLES[0]) & (angle < _ANGLES[1])
    good &= np.abs(np.sign(radial).sum(axis=1)) == 3.0
    near = np.linalg.norm(apex - points.mean(axis=0), axis=1) < 3.0 * np.ptp(points, axis=0).max()
    found = Primitives("cone", apex, axis, angle, -np.sign(radial[:, 0]))
    return found.take(good & near)


def _nearest_on_lines(
    p: FloatArray, n: FloatArray, q: FloatArray, m: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return where the lines p + s n and q + t m are nearest: s (M,), t (M,), and if they cross."""
    cosine = np.einsum("mk,mk->m", n, m)
    sine = 1.0 - cosine**2
    usable = sine > _PARALLEL**2
    between = q - p
    on_n, on_m = np.einsum("mk,mk->m", between, n), np.einsum("mk,mk->m", between, m)
    denominator = np.where(usable, sine, 1.0)
    s = (on_n - cosine * on_m) / denominator
    t = (cosine * on_n - on_m) / denominator
    return s, t, usable


def _plausible(radius: FloatArray, points: FloatArray) -> BoolArray:
    extent = float(np.ptp(points, axis=0).max())
    return np.asarray((radius > 1e-3 * extent) & (radius < _LARGEST_RADIUS * extent))
