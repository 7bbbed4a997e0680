"""A contact patch as contacts: one for each connected, flat part of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydrake.geometry import GeometryId, PolygonSurfaceMesh, TriangleSurfaceMesh
from pydrake.multibody.plant import HydroelasticContactInfo
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from lis_grasp.typing import FloatArray

# A fingertip of 12 mm pressed in by 0.3 mm spans 13 deg to either side of its mean normal on a ball
# of its own size; faces that differ by more than this belong to different sides of an edge.
_SPLIT_ANGLE = np.deg2rad(35.0)
# A part smaller than this share of the patch says too little of where its face is.
_LEAST_SHARE = 0.2
# Corners of neighbouring faces coincide but for rounding.
_SAME_CORNER = 1e-7  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """One flat part of a contact patch.

    Parameters
    ----------
    link
        The hand's link that touches.
    point
        Shape (3,) [m]: area-weighted centroid.
    normal
        Shape (3,), unit: area-weighted, out of the object.
    force
        [N] The part's share, by area, of the patch's normal force.
    """

    link: str
    point: FloatArray
    normal: FloatArray
    force: float


def normal_force(info: HydroelasticContactInfo) -> float:
    """Return the patch's force along its mean normal [N]: friction does not count as touch."""
    surface = info.contact_surface()
    normal = sum(surface.area(i) * surface.face_normal(i) for i in range(surface.num_faces()))
    length = np.linalg.norm(normal)
    return float(abs(info.F_Ac_W().translational() @ normal) / length) if length else 0.0


def contact_patches(
    info: HydroelasticContactInfo,
    *,
    object_geometry: GeometryId,
    link_of_geometry: Mapping[GeometryId, str],
) -> list[Patch]:
    """Return a contact between object and hand as flat parts, in W; none unless one is the object.

    Parameters
    ----------
    info
        Drake's contact.
    object_geometry
        The object's shape.
    link_of_geometry
        The hand's shapes, and the links that carry them.
    """
    surface = info.contact_surface()
    first, second = surface.id_M(), surface.id_N()
    object_is_m = first == object_geometry
    link = link_of_geometry.get(second if object_is_m else first)
    if link is None or object_geometry not in (first, second):
        return []
    mesh = surface.tri_mesh_W() if surface.is_triangle() else surface.poly_mesh_W()
    faces = range(surface.num_faces())
    areas = np.array([surface.area(i) for i in faces])
    # A face's normal points out of N into M: it is the object's outward one when N is the object.
    outward = -1.0 if object_is_m else 1.0
    normals = outward * np.array([surface.face_normal(i) for i in faces])
    centroids = np.array([mesh.element_centroid(i) for i in faces])
    pieces = _connected_pieces(mesh)
    return split_patch(link, areas, centroids, normals, pieces, force=normal_force(info))


def split_patch(
    link: str,
    areas: FloatArray,
    centroids: FloatArray,
    normals: FloatArray,
    pieces: npt.NDArray[np.int32],
    *,
    force: float,
) -> list[Patch]:
    """Split a contact patch at gaps, and at the edges that it lies across, convex or concave.

    A tip in a corner touches two faces at once, and the mean of their normals is the normal of
    neither; a tip across a groove touches on both sides, and the mean of the two is in the air.
    Faces of one piece, within 35 degrees of a part's area-weighted mean normal, form that part, the
    largest first.

    Parameters
    ----------
    link
        The hand's link that touches.
    areas, centroids, normals
        Of the patch's faces: (F,) [m^2], (F, 3) [m], (F, 3) unit and out of the object.
    pieces
        Shape (F,): the connected piece that each face belongs to.
    force
        Normal force of the whole patch [N].

    Returns
    -------
    list of Patch
        At least one for a patch with area; points and normals in the frame of the arguments.
    """
    total = float(areas.sum())
    remaining = areas > 0.0
    parts: list[Patch] = []
    while remaining.any():
        largest = int(np.argmax(np.where(remaining, areas, -1.0)))
        normal = normals[largest]
        for _ in range(3):  # the mean settles in two or three rounds
            alike = (pieces == pieces[largest]) & (normals @ normal > np.cos(_SPLIT_ANGLE))
            members = remaining & alike
            members[largest] = True
            normal = areas[members] @ normals[members]
            normal /= np.linalg.norm(normal)
        share = float(areas[members].sum()) / total
        if share >= _LEAST_SHARE or not parts:
            point = areas[members] @ centroids[members] / areas[members].sum()
            parts.append(Patch(link, point, normal, force * share))
        remaining &= ~members
    return parts


def _connected_pieces(mesh: PolygonSurfaceMesh | TriangleSurfaceMesh) -> npt.NDArray[np.int32]:
    """Return the connected piece that each face belongs to, shape (F,); faces share corners."""
    faces = [mesh.element(i) for i in range(mesh.num_elements())]
    owners = np.repeat(np.arange(len(faces)), [face.num_vertices() for face in faces])
    corners = np.array(
        [mesh.vertex(face.vertex(k)) for face in faces for k in range(face.num_vertices())]
    )
    pairs = owners[cKDTree(corners).query_pairs(_SAME_CORNER, output_type="ndarray")]  # (K, 2)
    shape = (len(faces), len(faces))
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=shape)
    _, pieces = connected_components(graph, directed=False)
    return np.asarray(pieces, dtype=np.int32)
