"""Reconstructions by MeshLab: screened Poisson, and algebraic point set surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import igl
import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, needed_package
from lis_grasp.surfaces.queries import flat_points
from lis_grasp.typing import FloatArray, IntArray
from lis_grasp_studies.baselines._support import BaselineSurface, Support

# These filters look for neighbours of a contact: with fewer there is no surface.
_LEAST_CONTACTS = 6

# Distance from the mesh at which the direction to it is rounding, in extents of the contacts; and
# step of differences.
_ON_IT = 1e-6

# f in distances from the mesh that a closed one has: less is near a hole.
_CLOSED = 0.999


@dataclass(frozen=True, slots=True, eq=False)
class MeshLabSurface(BaselineSurface):
    """The mesh of a MeshLab reconstruction filter, as an implicit surface.

    f = (1 - 2 w) d

    with the distance d from the mesh and the generalized winding number w (Jacobson et al. 2013),
    which is 1 inside and 0 outside of a closed mesh. Where a mesh is open, as where contacts end,
    w = 1/2 closes it; sheets that enclose nothing have no inside.

    Made by `screened_poisson` or `algebraic`, which need the package pymeshlab. Contacts are
    centred and scaled to unit size first, because the filters' own tolerances have a unit.
    """

    error: ClassVar[float] = 0.26
    misfit: ClassVar[float] = 0.04
    support: Support
    vertices: FloatArray  # (V, 3) [m]
    faces: IntArray  # (T, 3)

    @classmethod
    def screened_poisson(
        cls,
        contacts: Contacts,
        *,
        depth: int = 8,
        fulldepth: int = 5,
        scale: float = 1.1,
        samples: float = 1.5,
        weight: float = 4.0,
        position_noise: float = 0.0,
    ) -> MeshLabSurface:
        """Reconstruct by screened Poisson (Kazhdan and Hoppe 2013).

        Parameters
        ----------
        contacts
            At least six at different places.
        depth, fulldepth
            Of the octree, and of the part of it that is complete.
        scale
            Side of its cube, in that of the contacts.
        samples
            Contacts of a node at least.
        weight
            Of the distances from contacts against the differences from normals.
        position_noise
            Standard deviation of positions [m]; it adds to the uncertainty alone.
        """
        return cls._filtered(
            contacts,
            "generate_surface_reconstruction_screened_poisson",
            position_noise,
            depth=depth,
            fulldepth=fulldepth,
            scale=scale,
            samplespernode=samples,
            pointweight=weight,
            threads=1,  # for the same bytes every time
        )

    @classmethod
    def algebraic(
        cls,
        contacts: Contacts,
        *,
        support: float = 2.0,
        cells: int = 200,
        position_noise: float = 0.0,
    ) -> MeshLabSurface:
        """Reconstruct by algebraic point set surfaces (Guennebaud and Gross 2007).

        Parameters
        ----------
        contacts
            At least six at different places.
        support
            Radius in which a contact counts, in MeshLab's estimate of the spacing about it.
        cells
            Of the grid of marching cubes, along the box.
        position_noise
            Standard deviation of positions [m]; it adds to the uncertainty alone.
        """
        name = "generate_marching_cubes_apss"
        return cls._filtered(contacts, name, position_noise, filterscale=support, resolution=cells)

    @classmethod
    def _filtered(
        cls, contacts: Contacts, name: str, position_noise: float, **options: Any
    ) -> MeshLabSurface:
        with needed_package("pymeshlab", "baselines"):
            import pymeshlab
        support = Support.of(contacts, position_noise)
        cloud = support.contacts
        if len(cloud) < _LEAST_CONTACTS:
            raise EstimationError(
                f"MeshLab needs at least {_LEAST_CONTACTS} contacts at different places; there are"
                f" {len(cloud)}: touch more"
            )
        scene, points = pymeshlab.MeshSet(verbose=False), support.scaled(cloud.points)
        scene.add_mesh(pymeshlab.Mesh(points, v_normals_matrix=cloud.normals))
        try:
            getattr(scene, name)(**options)
        except pymeshlab.PyMeshLabException as error:
            raise EstimationError(f"MeshLab's {name} failed: {error}: try more contacts") from None
        made = scene.current_mesh()
        places = support.center + support.scale * np.nan_to_num(made.vertex_matrix())
        mesh = trimesh.Trimesh(places, made.face_matrix(), process=False)
        sound = np.asarray(mesh.area_faces) > 0.0
        if not sound.any():
            raise EstimationError(
                f"MeshLab's {name} found no surface: contacts are too few or too far apart for it"
            )
        return cls(support, places, np.array(mesh.faces[sound], dtype=np.int64))

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = flat_points(points)
        return np.asarray(self._nearest(rows)[0]).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points (..., 3), same shape: exact but near holes."""
        rows, shape = flat_points(points)
        values, faces, nearest = self._nearest(rows)
        corners = self.vertices[self.faces[faces]]  # (P, 3, 3)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = rows - nearest
        distances = np.linalg.norm(away, axis=1)
        on_it = distances < _ON_IT * self.support.scale
        chosen = np.where(on_it[:, None], normals, np.sign(values)[:, None] * away)
        lengths = np.linalg.norm(chosen, axis=1, keepdims=True)
        chosen = np.divide(chosen, lengths, out=chosen, where=lengths > 0.0)
        near_hole = ~on_it & (np.abs(values) < _CLOSED * distances)
        chosen[near_hole] = self._differences(rows[near_hole])
        return np.asarray(chosen).reshape(*shape, 3)

    def _differences(self, rows: FloatArray) -> FloatArray:
        """Return the gradient of f at points (P, 3) by central differences."""
        step = _ON_IT * self.support.scale
        sides = [self.evaluate(rows + s) - self.evaluate(rows - s) for s in step * np.eye(3)]
        return np.stack(sides, axis=-1) / (2.0 * step)

    def _nearest(self, rows: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return f (P,), nearest triangles (P,) and nearest points (P, 3)."""
        if not len(rows):
            return np.empty(0), np.empty(0, dtype=np.int64), np.empty((0, 3))
        kind = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER
        values, faces, nearest, _ = igl.signed_distance(
            np.ascontiguousarray(rows), self.vertices, self.faces, sign_type=kind
        )
        return np.atleast_1d(values), np.atleast_1d(faces), np.atleast_2d(nearest)
