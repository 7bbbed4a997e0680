"""Reconstructions by MeshLab: screened Poisson, and point set surfaces (RIMLS, APSS)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import igl
import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidContactsError
from lis_grasp.io.optional_packages import needed_package
from lis_grasp.surfaces.queries import flat_points
from lis_grasp.typing import FloatArray
from lis_grasp_studies.baselines._support import BaselineSurface, Support

# Cells along the box, and support of a point in MeshLab's estimate of the spacing: on the eight
# objects 1.5 is sharper at edges (RIMLS 1.9 mm instead of 2.9) but has larger phantom sheets, 3
# loses faces.
_MARCHING_CUBES = {"resolution": 120, "filterscale": 2.0}
# The point weight favours interpolation over smoothness.
_POISSON: dict[str, float] = {"depth": 7, "pointweight": 10.0, "samplespernode": 1.0}

# These methods search neighbours of their own and need this many.
_LEAST_CONTACTS = 6


@dataclass(frozen=True, slots=True, eq=False)
class MeshLabSurface(BaselineSurface):
    """The mesh of a MeshLab reconstruction filter, as an implicit surface.

    f is the distance from the mesh, negative where the generalized winding number exceeds one half
    (Jacobson et al. 2013): these meshes are open where contacts end, and have sheets that enclose
    nothing, which the winding number ignores.

    Made by `poisson`, `rimls` or `apss`, which need the package pymeshlab.
    """

    error: ClassVar[float] = 0.3
    support: Support
    vertices: FloatArray
    faces: npt.NDArray[np.int64]

    @classmethod
    def poisson(cls, contacts: Contacts, **options: float) -> MeshLabSurface:
        """Reconstruct by screened Poisson (Kazhdan and Hoppe 2013).

        Options of MeshLab's filter replace the defaults: depth, pointweight, samplespernode.
        """
        name = "generate_surface_reconstruction_screened_poisson"
        return cls._filtered(contacts, name, **(_POISSON | options))

    @classmethod
    def rimls(cls, contacts: Contacts) -> MeshLabSurface:
        """Reconstruct by robust implicit moving least squares (Oztireli et al. 2009)."""
        return cls._filtered(contacts, "generate_marching_cubes_rimls", **_MARCHING_CUBES)

    @classmethod
    def apss(cls, contacts: Contacts) -> MeshLabSurface:
        """Reconstruct by algebraic point set surfaces (Guennebaud and Gross 2007)."""
        return cls._filtered(contacts, "generate_marching_cubes_apss", **_MARCHING_CUBES)

    @classmethod
    def _filtered(cls, contacts: Contacts, name: str, **options: Any) -> MeshLabSurface:
        with needed_package("pymeshlab", "baselines"):
            import pymeshlab
        support = Support.of(contacts)
        if len(support.contacts) < _LEAST_CONTACTS:
            raise InvalidContactsError(
                f"this estimator needs at least {_LEAST_CONTACTS} contacts at different places;"
                f" there are {len(support.contacts)}"
            )
        scene, cloud = pymeshlab.MeshSet(verbose=False), support.contacts
        scene.add_mesh(pymeshlab.Mesh(cloud.points, v_normals_matrix=cloud.normals))
        try:
            getattr(scene, name)(**options)
        except pymeshlab.PyMeshLabException as error:
            raise EstimationError(f"MeshLab's {name} failed: {error}: try more contacts") from None
        made = scene.current_mesh()
        mesh = trimesh.Trimesh(made.vertex_matrix(), made.face_matrix(), process=False)
        sound = np.isfinite(mesh.triangles).all(axis=(1, 2)) & (mesh.area_faces > 0.0)
        if not sound.any():
            raise EstimationError(
                f"MeshLab's {name} found no surface: contacts are too few or too far apart for it"
            )
        faces = np.array(mesh.faces[sound], dtype=np.int64)
        return cls(support, np.nan_to_num(np.array(mesh.vertices)), faces)

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = flat_points(points)
        return np.asarray(self._nearest(rows)[0]).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points (..., 3), same shape: from or to the nearest point."""
        rows, shape = flat_points(points)
        distances, faces, nearest = self._nearest(rows)
        corners = self.vertices[self.faces[faces]]  # (P, 3, 3)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = np.sign(distances)[:, None] * (rows - nearest)
        # On the mesh itself that direction is rounding: take the triangle's normal.
        on_it = np.abs(distances) < 1e-6 * float(np.ptp(self.bounds, axis=0).max())
        chosen = np.where(on_it[:, None], normals, away)
        chosen /= np.linalg.norm(chosen, axis=1, keepdims=True)
        return np.asarray(chosen).reshape(*shape, 3)

    def _nearest(self, rows: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray]:
        """Return signed distances (P,), nearest triangles (P,) and nearest points (P, 3)."""
        if not len(rows):
            return np.empty(0), np.empty(0, dtype=np.int64), np.empty((0, 3))
        kind = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER
        distances, faces, nearest, _ = igl.signed_distance(
            np.ascontiguousarray(rows), self.vertices, self.faces, sign_type=kind
        )
        return np.atleast_1d(distances), np.atleast_1d(faces), np.atleast_2d(nearest)
