"""Sampling of contacts on an uncertain estimated surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.geometry import cross, unit
from lis_grasp.typing import FloatArray

# Correlation length of an estimate's errors, in largest extents: the usual spacing of touches.
_CORRELATION_FRACTION = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class UncertainSurface:
    """An estimated surface whose error along its normals is a Gaussian field.

    The field is ``s g``: the estimate's own standard deviation s, which grows with the distance
    from a touch, times a field g of unit deviation and squared-exponential correlation. Errors of
    normals are its slope, ``s grad g + g grad s``. The slope of g has the deviation 1 over the
    correlation length. Slopes of different contacts are drawn independently, and so of heights at
    others: an approximation for contacts that are nearer to each other than two of these lengths.
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
        self, points: FloatArray, normals: FloatArray, *, samples: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the contacts of planned grasps on surfaces that the estimate allows.

        Fingers close along the planned normals until they touch: contacts move along them, and
        normals tilt. All grasps use the same random numbers, which makes their results comparable.

        Points (B, C, 3) [m] and normals (B, C, 3) of planned contacts give S samples of each, of
        shape (B, S, C, 3).
        """
        contacts = points.shape[1]
        heights = rng.normal(size=(samples, contacts))
        slopes = rng.normal(size=(samples, contacts, 3))
        nearest = self.vertices.query(points)[1]  # (B, C)
        deviations, gradients = self.deviations[nearest], self.gradients[nearest]
        between = np.linalg.norm(points[:, :, None] - points[:, None], axis=-1)  # (B, C, C)
        correlation = np.exp(-0.5 * (between / self.correlation_length) ** 2)
        factor = np.linalg.cholesky(correlation + 1e-9 * np.eye(contacts))
        units = np.einsum("bcd,sd->bsc", factor, heights)  # g
        moved = units * deviations[:, None]
        # (B, S, C, 3): where the surface rises, its normal leans back.
        tilt = slopes * (deviations / self.correlation_length)[:, None, :, None]
        tilt -= units[..., None] * gradients[:, None]
        along = (tilt * normals[:, None]).sum(axis=-1, keepdims=True)
        tilted = normals[:, None] + tilt - along * normals[:, None]
        return points[:, None] + moved[..., None] * normals[:, None], unit(tilted)


def _gradients(mesh: trimesh.Trimesh, values: FloatArray) -> FloatArray:
    """Return the gradient (V, 3) along a mesh of piecewise linear values (V,), averaged by area."""
    first, second, third = np.moveaxis(mesh.triangles, 1, 0)
    opposite = np.stack([third - second, first - third, second - first], axis=1)  # (F, 3, 3)
    turned = cross(mesh.face_normals[:, None], opposite)
    by_face = 0.5 * (values[mesh.faces][..., None] * turned).sum(axis=1)  # gradient times area
    members = mesh.faces_sparse  # (V, F)
    areas = members @ mesh.area_faces
    return np.asarray((members @ by_face) / np.where(areas > 0.0, areas, np.inf)[:, None])
