"""Reconstructions by MeshLab: screened Poisson, and point set surfaces (RIMLS, APSS)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidContactsError, InvalidOptionError
from lis_grasp.surfaces.baselines.support import Support
from lis_grasp.surfaces.queries import flat_points

FloatArray = npt.NDArray[np.float64]

# Error for 70 % of the surface in units of d^2 / spacing, see `Support.uncertainty`.
_ERROR = 0.3

# Cells along the box, of the two that march cubes in it.
_RESOLUTION = 120
# Support of a point, in what MeshLab takes for its spacing: on the eight objects 1.5 is sharper at
# edges (RIMLS 1.9 mm, not 2.9) with larger phantom sheets, 3 loses faces.
_FILTER_SCALE = 2.0
# Interpolation against smoothness, of screened Poisson.
_POINT_WEIGHT = 10.0

# Fewer say nothing to methods that find neighbours of their own.
_LEAST_CONTACTS = 6


@dataclass(frozen=True, slots=True, eq=False)
class MeshLabSurface:
    """The mesh that a filter of MeshLab makes of contacts, as an implicit surface.

    f is the distance from the tangent plane of the nearest vertex (Hoppe et al. 1992): on meshes
    finer than the grid they are contoured with, as good as the distance from the mesh.

    Made by `poisson`, `rimls` or `apss`, which need the package pymeshlab.
    """

    support: Support
    vertices: FloatArray
    normals: FloatArray
    _tree: cKDTree

    @classmethod
    def poisson(cls, contacts: Contacts) -> MeshLabSurface:
        """Reconstruct by screened Poisson (Kazhdan and Hoppe 2013)."""
        return cls._filtered(
            contacts,
            "generate_surface_reconstruction_screened_poisson",
            depth=7,
            pointweight=_POINT_WEIGHT,
            samplespernode=1.0,
        )

    @classmethod
    def rimls(cls, contacts: Contacts) -> MeshLabSurface:
        """Reconstruct by robust implicit moving least squares (Oztireli et al. 2009)."""
        return cls._filtered(
            contacts,
            "generate_marching_cubes_rimls",
            filterscale=_FILTER_SCALE,
            resolution=_RESOLUTION,
        )

    @classmethod
    def apss(cls, contacts: Contacts) -> MeshLabSurface:
        """Reconstruct by algebraic point set surfaces (Guennebaud and Gross 2007)."""
        return cls._filtered(
            contacts,
            "generate_marching_cubes_apss",
            filterscale=_FILTER_SCALE,
            resolution=_RESOLUTION,
        )

    @classmethod
    def _filtered(cls, contacts: Contacts, name: str, **options: Any) -> MeshLabSurface:
        try:
            import pymeshlab
        except ImportError:
            raise InvalidOptionError(
                "this estimator needs pymeshlab, which is not installed: pip install"
                " 'lis-grasp[baselines]'"
            ) from None
        support = Support.of(contacts)
        if len(support.contacts) < _LEAST_CONTACTS:
            raise InvalidContactsError(
                f"this estimator needs at least {_LEAST_CONTACTS} contacts at different places;"
                f" {len(support.contacts)} came"
            )
        scene = pymeshlab.MeshSet(verbose=False)
        cloud = pymeshlab.Mesh(
            vertex_matrix=support.contacts.points, v_normals_matrix=support.contacts.normals
        )
        scene.add_mesh(cloud)
        try:
            getattr(scene, name)(**options)
        except pymeshlab.PyMeshLabException as error:
            raise EstimationError(f"MeshLab's {name} failed: {error}: try more contacts") from None
        made = scene.current_mesh()
        mesh = trimesh.Trimesh(made.vertex_matrix(), made.face_matrix(), process=False)
        sound = np.isfinite(mesh.vertices).all(axis=1) & (
            np.linalg.norm(mesh.vertex_normals, axis=1) > 0.5
        )
        if not len(mesh.faces) or not sound.any():
            raise EstimationError(
                f"MeshLab's {name} found no surface: contacts are too few or too far apart for it"
            )
        vertices = np.array(mesh.vertices)[sound]
        return cls(support, vertices, np.array(mesh.vertex_normals)[sound], cKDTree(vertices))

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is meant, shape (2, 3) [m]."""
        return self.support.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = flat_points(points)
        nearest = self._tree.query(rows)[1]
        heights = np.einsum("pk,pk->p", rows - self.vertices[nearest], self.normals[nearest])
        return np.asarray(heights).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points (..., 3), same shape: the nearest vertex' normal."""
        rows, shape = flat_points(points)
        return self.normals[self._tree.query(rows)[1]].reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface, shape (...) [m]: measured beforehand.

        It grows with the square of the distance to the nearest contact.
        """
        return self.support.uncertainty(points, _ERROR)
