"""How likely a grasp is to hold, given how well the surface is known that it was planned on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[np.float64]

# Over which share of the object's largest extent errors of an estimate go together: the distance of
# contacts from each other when an object of that size is explored.
_CORRELATION_SHARE = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class UncertainSurface:
    """An estimated surface whose error along its normals is a Gaussian field.

    The field has the estimate's own standard deviation and a squared-exponential correlation, so
    its slope, by which normals err, is the deviation over the correlation length.

    Parameters
    ----------
    vertices
        Shape (V, 3) [m].
    deviations
        Shape (V,) [m]: one standard deviation of the surface along its normal.
    correlation_length
        [m].
    """

    vertices: cKDTree
    deviations: FloatArray
    correlation_length: float

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh) -> UncertainSurface:
        """Take the deviations from a mesh's vertex attribute ``"uncertainty"``, 0 without it."""
        known = mesh.vertex_attributes.get("uncertainty")
        deviations = np.zeros(len(mesh.vertices)) if known is None else np.asarray(known)
        length = _CORRELATION_SHARE * float(mesh.extents.max())
        return cls(cKDTree(mesh.vertices), deviations, length)

    def deviations_at(self, points: FloatArray) -> FloatArray:
        """Return the standard deviation at the vertices nearest to points (..., 3), shape (...)."""
        _, nearest = self.vertices.query(points)
        return self.deviations[nearest]

    def sample_contacts(
        self,
        points: FloatArray,
        normals: FloatArray,
        *,
        samples: int,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """Draw where fingers would meet the surface that the estimate may stand for.

        Fingers close along the planned normals until they touch: contacts move along them, and
        normals tilt. Draws are the same numbers for all grasps, so that their order says more.

        Parameters
        ----------
        points, normals
            Shape (B, C, 3): planned contacts of B grasps [m], and unit, outward.
        samples
            S, draws.
        rng
            For the draws.

        Returns
        -------
        tuple of FloatArray
            Points and normals, each of shape (B, S, C, 3).
        """
        contacts = points.shape[1]
        heights, slopes = (
            rng.normal(size=(samples, contacts)),
            rng.normal(size=(samples, contacts, 3)),
        )
        deviations = self.deviations_at(points)  # (B, C)
        between = np.linalg.norm(points[:, :, None] - points[:, None], axis=-1)  # (B, C, C)
        correlation = np.exp(-0.5 * (between / self.correlation_length) ** 2)
        factor = np.linalg.cholesky(correlation + 1e-9 * np.eye(contacts))
        moved = np.einsum("bcd,sd->bsc", factor, heights) * deviations[:, None]
        tilt = slopes * (deviations / self.correlation_length)[:, None, :, None]  # (B, S, C, 3)
        along = (tilt * normals[:, None]).sum(axis=-1, keepdims=True)
        tilted = normals[:, None] + tilt - along * normals[:, None]
        tilted /= np.linalg.norm(tilted, axis=-1, keepdims=True)
        return points[:, None] + moved[..., None] * normals[:, None], tilted
