"""Coverage of any surface by touches, and of the true surface that a fingertip can reach."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import sample_mesh
from lis_grasp.exceptions import require_positive
from lis_grasp.exploration.targets import gaps
from lis_grasp.exploration.workspace import STEP_FRACTION
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.typing import BoolArray, FloatArray

SAMPLES = 4_000
"""Points on the surface."""

# A ball of this part of the fingertip's radius must fit where the fingertip touches: the mesh of a
# curved surface is a little above or below its chords.
_FITS = 0.98


def touch_radius(mesh: trimesh.Trimesh) -> float:
    """Return the distance [m] up to which a touch covers the surface of an object.

    A quarter of the diameter of the ball of equal area: 40 touches can cover any object twice, long
    or compact, as they cover the ball.
    """
    return STEP_FRACTION * float(np.sqrt(mesh.area / np.pi))


def touch_coverage(mesh: trimesh.Trimesh, contacts: Contacts, *, radius: float) -> float:
    """Return the fraction of a mesh's area, 0 to 1, within a radius [m] of a contact on its side.

    A contact on the far side of a thin wall does not count.

    Raises `InvalidOptionError` if the radius is not positive.
    """
    require_positive(radius=radius)
    return _covered(*_sampled(mesh), contacts, radius)


def reachable_coverage(
    mesh: trimesh.Trimesh,
    contacts: Contacts,
    *,
    tip_radius: float,
    radius: float,
    support_height: float | None = None,
) -> float | None:
    """Return the fraction of the reachable true area, 0 to 1, within a radius of a contact.

    A point is reachable if a ball as large as the fingertip touches the object there from outside,
    without crossing it or the table. The rest of the hand is not considered. The true object is
    closed and outward, in O [m], as are contacts and the height of a table. Contacts count on a
    point's side within a `radius` [m], mostly `touch_radius`. None if no point is reachable. Raises
    `InvalidOptionError` if a radius is not positive.
    """
    require_positive(tip_radius=tip_radius, radius=radius)
    points, normals = _sampled(mesh)
    reachable = _is_reachable(mesh, points, normals, tip_radius, support_height)
    if not reachable.any():
        return None
    return _covered(points[reachable], normals[reachable], contacts, radius)


def _sampled(mesh: trimesh.Trimesh) -> tuple[FloatArray, FloatArray]:
    points, faces = sample_mesh(mesh, SAMPLES)
    return points, np.asarray(mesh.face_normals)[faces]


def _is_reachable(
    mesh: trimesh.Trimesh,
    points: FloatArray,
    normals: FloatArray,
    tip_radius: float,
    support_height: float | None,
) -> BoolArray:
    centers = points + tip_radius * normals
    free, _ = distances_to_mesh(centers, mesh)
    reachable = free > _FITS * tip_radius
    if support_height is not None:
        reachable &= centers[:, 2] - support_height > _FITS * tip_radius
    return np.asarray(reachable)


def _covered(points: FloatArray, normals: FloatArray, contacts: Contacts, radius: float) -> float:
    return float(np.mean(gaps(points, normals, contacts) <= radius))
