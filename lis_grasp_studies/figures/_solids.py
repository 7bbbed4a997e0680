"""What figures show: views, estimates, and patches of meshes, sharp edges and contacts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.visualization.camera import View
from lis_grasp_studies.estimators import Noise, compared_estimator
from lis_grasp_studies.figures.painter import (
    Patches,
    cut_triangles,
    edge_patches,
    line_patches,
    mesh_patches,
    point_patches,
    triangle_patches,
)
from lis_grasp_studies.figures.palette import CONTACT, EDGE, TRUTH, rgba

COLUMNS = ("gpis", "lis", "blend")
"""Estimators beside each other: the paper's two, then the package's default."""

KERNEL_WIDTH = 0.3
"""Width of the LIS kernel in figs. 2 and 5, in units of the contacts' spacing."""

VIEW = View(np.deg2rad(-55.0), np.deg2rad(28.0))
"""View of most objects."""

_VIEWS = {
    "half_cylinder": View(np.deg2rad(-35.0), np.deg2rad(28.0)),
    "hollow_cylinder": View(np.deg2rad(-55.0), np.deg2rad(38.0)),
    "torus": View(np.deg2rad(-55.0), np.deg2rad(42.0)),
}


def view_of(name: str) -> View:
    """Return the view of a built-in object."""
    return _VIEWS.get(name, VIEW)


def view_on(contacts: Contacts) -> View:
    """Return the view, at the usual elevation, that most contacts face."""
    views = [View(azimuth, VIEW.elevation) for azimuth in np.deg2rad(np.arange(-180, 180, 15))]
    facing = [np.clip(contacts.normals @ view.axes[2], 0.0, None).sum() for view in views]
    return views[int(np.argmax(facing))]


def estimate(name: str, contacts: Contacts) -> ImplicitSurface:
    """Return the surface that a compared estimator, given by its name, makes of exact contacts."""
    return compared_estimator(name)(contacts, Noise())


def estimated_mesh(
    name: str, contacts: Contacts, *, resolution: float | None = None
) -> trimesh.Trimesh:
    """Return the mesh of the estimated surface; resolution [m] as `extract_mesh` takes it."""
    return extract_mesh(estimate(name, contacts), resolution=resolution)


LIFT = 0.006
"""Extra depth of lines and points on a surface, for objects of 20 cm [m]."""

_COARSE = 0.008

_EDGE_WIDTH, _POINT_RADIUS, _NORMAL_WIDTH, _NORMAL_LENGTH = 0.0012, 0.0026, 0.0011, 0.014


def solid_patches(
    view: View, mesh: trimesh.Trimesh, colours: npt.ArrayLike | str = TRUTH
) -> list[Patches]:
    """Return a mesh, true or estimated, with its sharp edges darker."""
    return [mesh_patches(view, mesh, colours), sharp_patches(view, mesh)]


def sharp_patches(view: View, mesh: trimesh.Trimesh) -> Patches:
    """Return a mesh's sharp edges."""
    return edge_patches(view, mesh, EDGE, width=_EDGE_WIDTH, lift=LIFT)


def two_tone_patches(
    view: View,
    mesh: trimesh.Trimesh,
    contacts: Contacts,
    radius: float,
    colours: tuple[str, str],
    *,
    piece: float = 0.002,
) -> Patches:
    """Return a mesh in one colour within `radius` [m] of a contact and in another one beyond.

    On the border between them triangles are cut until no side is longer than `piece` [m].
    """
    facing = np.flatnonzero(view.faces(mesh.face_normals))
    normals = np.asarray(mesh.face_normals)[facing]
    triangles, owners = cut_triangles(np.asarray(mesh.triangles)[facing], _COARSE)
    tree = cKDTree(contacts.points)
    middles = triangles.mean(axis=1)
    radii = np.linalg.norm(triangles - middles[:, None], axis=2).max(axis=1)
    border = np.abs(tree.query(middles)[0] - radius) < radii
    fine, parents = cut_triangles(triangles[border], piece)
    triangles = np.concatenate([triangles[~border], fine])
    owners = np.concatenate([owners[~border], owners[border][parents]])
    near = tree.query(triangles.mean(axis=1))[0] <= radius
    each = np.where(near[:, None], rgba(colours[0]), rgba(colours[1]))
    return triangle_patches(view, triangles, normals[owners], each, darkest=0.75)


def contact_patches(view: View, contacts: Contacts, *, scale: float = 1.0) -> list[Patches]:
    """Return contacts as points with their normals; `scale` is 1 for objects of 20 cm.

    Contacts on the far side get their normals only, which may extend past the outline.
    """
    ends = contacts.points + scale * _NORMAL_LENGTH * contacts.normals
    normals = np.stack([contacts.points, ends], axis=1)
    near = contacts.points[view.faces(contacts.normals)]
    return [
        line_patches(view, normals, CONTACT, width=scale * _NORMAL_WIDTH),
        point_patches(view, near, CONTACT, radius=scale * _POINT_RADIUS, lift=2.0 * LIFT),
    ]
