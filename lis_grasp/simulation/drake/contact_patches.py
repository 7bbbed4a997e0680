"""Contacts of the hand's links, and their flat parts, from Drake's contact results."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import ContactSurface, GeometryId, PolygonSurfaceMesh, TriangleSurfaceMesh
from pydrake.multibody.plant import ContactResults
from scipy.spatial import cKDTree
from trimesh.graph import connected_component_labels

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import unit
from lis_grasp.lifting.scene import HandContact
from lis_grasp.typing import FloatArray, IntArray

# Normals farther apart than this are on two sides of an edge: a 12 mm fingertip pressed 0.3 mm into
# a ball of its own size spans 13 deg to either side.
_SPLIT_ANGLE = np.deg2rad(35.0)
# Parts smaller than this fraction of the patch are dropped: they do not locate their face.
_LEAST_FRACTION = 0.2
# Vertices of neighbouring faces coincide up to rounding.
_SAME_VERTEX = 1e-7  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class LinkContact(HandContact):
    """Contact of a link of the hand, in W: a patch's area-weighted centroid and mean normal."""

    normal_force: float  # size of the force along the normal [N], without friction
    surface: ContactSurface | None  # the patch; None for point contact
    outward: float  # 1 if the patch's face normals point out of the object, else -1
    link_geometry: GeometryId
    felt_geometry: GeometryId

    def flat_parts(self) -> list[FlatPart]:
        """Return the flat parts of the patch; see `split_patch`."""
        surface = self.surface
        if surface is None:
            return [FlatPart(self.link, self.point, self.normal, self.normal_force)]
        mesh = surface.tri_mesh_W() if surface.is_triangle() else surface.poly_mesh_W()
        faces = range(surface.num_faces())
        return split_patch(
            self.link,
            np.array([surface.area(i) for i in faces]),
            np.array([mesh.element_centroid(i) for i in faces]),
            self.outward * np.array([surface.face_normal(i) for i in faces]),
            _connected_pieces(mesh),
            force=self.normal_force,
        )


@dataclass(frozen=True, slots=True, eq=False)
class FlatPart:
    """One flat part of a contact patch."""

    link: str
    point: FloatArray  # (3,) [m]: area-weighted centroid
    normal: FloatArray  # (3,), unit, out of the object: area-weighted mean
    force: float  # fraction, by area, of the patch's normal force [N]


def patch_forces(
    results: ContactResults, of: Container[GeometryId] | None = None
) -> Iterator[tuple[GeometryId, GeometryId, float]]:
    """Yield the geometries and the force [N] of each hydroelastic contact, of some or of all."""
    for i in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(i)
        surface = info.contact_surface()
        first, second = surface.id_M(), surface.id_N()
        if of is None or first in of or second in of:
            yield first, second, float(np.linalg.norm(info.F_Ac_W().translational()))


def point_forces(
    results: ContactResults, of: Container[GeometryId] | None = None
) -> Iterator[tuple[GeometryId, GeometryId, float]]:
    """Yield the geometries and the force [N] of each contact of points, of some or of all."""
    for i in range(results.num_point_pair_contacts()):
        info = results.point_pair_contact_info(i)
        points = info.point_pair()
        if of is None or points.id_A in of or points.id_B in of:
            yield points.id_A, points.id_B, float(np.linalg.norm(info.contact_force()))


def link_contacts(
    results: ContactResults, felt: Container[GeometryId], link_of_geometry: Mapping[GeometryId, str]
) -> list[LinkContact]:
    """Return the contacts between a hand's links and geometries that are felt, in Drake's order.

    Hydroelastic ones come first, then pairs of points. A pair of points is at the object's witness
    point, with Drake's normal.
    """
    contacts = []
    for i in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(i)
        surface = info.contact_surface()
        # Drake's force acts on the body of M; the face normals point out of N, into M.
        object_is_m = surface.id_M() in felt
        if not object_is_m and surface.id_N() not in felt:
            continue
        pair = surface.id_M(), surface.id_N()
        felt_id, link_id = pair if object_is_m else pair[::-1]
        link = link_of_geometry.get(link_id)
        if link is None:
            continue
        outward = -1.0 if object_is_m else 1.0
        normal = sum(surface.area(f) * surface.face_normal(f) for f in range(surface.num_faces()))
        length = np.linalg.norm(normal)
        if length == 0.0:
            continue
        force = -outward * info.F_Ac_W().translational()
        normal_force = float(abs(force @ normal) / length)
        normal = outward * normal / length
        contacts.append(
            LinkContact(
                link,
                surface.centroid(),
                normal,
                force,
                normal_force,
                surface,
                outward,
                link_id,
                felt_id,
            )
        )
    for i in range(results.num_point_pair_contacts()):
        pair_info = results.point_pair_contact_info(i)
        points = pair_info.point_pair()
        # Drake's force acts on the body of B; the normal points out of B, into A.
        object_is_b = points.id_B in felt
        if not object_is_b and points.id_A not in felt:
            continue
        pair = points.id_A, points.id_B
        link_id, felt_id = pair if object_is_b else pair[::-1]
        link = link_of_geometry.get(link_id)
        if link is None:
            continue
        outward = 1.0 if object_is_b else -1.0
        point = np.array(points.p_WCb if object_is_b else points.p_WCa)
        normal, force = outward * points.nhat_BA_W, outward * pair_info.contact_force()
        strength = float(abs(force @ normal))
        contacts.append(
            LinkContact(link, point, normal, force, strength, None, outward, link_id, felt_id)
        )
    return contacts


def contacts_of_parts(patches: Sequence[FlatPart], time: float) -> Contacts:
    """Return flat parts that are in contact at a time [s] as contacts."""
    return Contacts(
        points=np.array([patch.point for patch in patches]) + 0.0,  # no negative zeros
        normals=np.array([patch.normal for patch in patches]) + 0.0,
        forces=np.array([patch.force for patch in patches]),
        fingers=tuple(patch.link for patch in patches),
        times=np.full(len(patches), time),
    )


def split_patch(
    link: str,
    areas: FloatArray,
    centroids: FloatArray,
    normals: FloatArray,
    pieces: IntArray,
    *,
    force: float,
) -> list[FlatPart]:
    """Split a contact patch at gaps and at the object's edges, convex or concave.

    A tip in a corner touches two faces: their mean normal is the normal of neither. A tip across a
    groove touches both sides: their mean point is not on the object. Faces of one connected piece
    within 35 degrees of a part's area-weighted mean normal form that part, the largest first.

    The faces have areas (F,) [m^2], centroids (F, 3) [m], outward unit normals (F, 3), and pieces
    (F,). `force` is the normal force of the whole patch [N]. A patch with area has at least one
    part.
    """
    total = float(areas.sum())
    remaining = areas > 0.0
    parts: list[FlatPart] = []
    while remaining.any():
        largest = int(np.argmax(np.where(remaining, areas, -1.0)))
        normal = normals[largest]
        for _ in range(3):  # the mean converges in two or three rounds
            alike = (pieces == pieces[largest]) & (normals @ normal > np.cos(_SPLIT_ANGLE))
            members = remaining & alike
            members[largest] = True
            normal = areas[members] @ normals[members]
            normal = unit(normal)
        fraction = float(areas[members].sum()) / total
        if fraction >= _LEAST_FRACTION or not parts:
            point = areas[members] @ centroids[members] / areas[members].sum()
            parts.append(FlatPart(link, point, normal, force * fraction))
        remaining &= ~members
    return parts


def _connected_pieces(mesh: PolygonSurfaceMesh | TriangleSurfaceMesh) -> IntArray:
    """Return the connected piece that each face belongs to, shape (F,); faces share vertices."""
    faces = [mesh.element(i) for i in range(mesh.num_elements())]
    owners = np.repeat(np.arange(len(faces)), [face.num_vertices() for face in faces])
    vertices = np.array(
        [mesh.vertex(face.vertex(k)) for face in faces for k in range(face.num_vertices())]
    )
    pairs = owners[cKDTree(vertices).query_pairs(_SAME_VERTEX, output_type="ndarray")]  # (K, 2)
    return np.asarray(connected_component_labels(pairs, len(faces)), dtype=np.int64)
