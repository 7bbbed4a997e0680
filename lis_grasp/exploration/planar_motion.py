"""Planar displacements of an object on a table: (x, y, yaw), as a pose and as a push makes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.typing import FloatArray

# Radius at which friction resists a turn, as a fraction of the object's extent: between a disc's,
# 0.33, and a ring's, 0.5. The extent is at least [m].
_TURNING_RADIUS, _LEAST_EXTENT = 0.4, 0.03
# Standard deviations of a displacement by a hand that closed on an object or hit it: x, y [m], yaw;
# and of a contact's distance from the estimated surface [m].
_CLOSING_MOTION, _CONTACT_ERROR = np.array([0.01, 0.01, 0.2]), 0.002
_ITERATIONS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Push:
    """Displacements of an object by a push, about the origin of its frame, for each metre."""

    along: FloatArray  #: (3,): x and y with the push, and yaw [rad/m]
    aside: FloatArray  #: (3, 3): variances of a metre in any direction, and turns alike


def push_of(contacts: Contacts, known: Contacts) -> Push:
    """Return how `contacts` push an object whose extent the `known` ones show.

    The push is against the contacts' normals. A steep one presses the object down, so its
    horizontal part counts squared. What moves far under a gentle touch rolls, and rolling does not
    turn it about the vertical; a slider turns at an unknown rate about an unknown centre of
    friction (Lynch, Maekawa & Tanie 1992), which is a part of the uncertainty.
    """
    both = np.vstack([contacts.points, known.points])[:, :2]
    low, high = both.min(axis=0), both.max(axis=0)
    center = 0.5 * (low + high)
    radius = _TURNING_RADIUS * max(float((high - low).max()), _LEAST_EXTENT)
    force = -contacts.normals.mean(axis=0)[:2]
    strength = float(np.linalg.norm(force))
    about_origin = np.array([[1.0, 0.0, center[1]], [0.0, 1.0, -center[0]], [0.0, 0.0, 1.0]])
    aside = about_origin @ np.diag([1.0, 1.0, radius**-2]) @ about_origin.T
    return Push(np.append(strength * force, 0.0), aside)


def planar_pose(displacement: FloatArray) -> FloatArray:
    """Return the pose, shape (4, 4), of a displacement (3,): x, y [m] and yaw [rad]."""
    x, y, yaw = displacement
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:2, 3] = x, y
    return pose


def displacement_rows(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return how a displacement moves points (N, 3) along normals (N, 3), shape (N, 3)."""
    turn = points[:, 0] * normals[:, 1] - points[:, 1] * normals[:, 0]
    return np.column_stack([normals[:, :2], turn])


def register_motions(sets: Sequence[Contacts], mesh: trimesh.Trimesh) -> FloatArray:
    """Return the planar displacements (K, 3) of an object at K successive sets of contacts.

    Gauss-Newton iterations of the most probable displacements d_k from the estimate. Between two
    sets the object moves by a normal displacement of 10 mm and 0.2 rad. The distances
    ``n . d_k(p)`` of the contacts from the estimated surface are known to 2 mm (point-to-plane
    registration: Chen and Medioni 1992). So later contacts correct earlier displacements too.

    Parameters
    ----------
    sets
        Contacts in the order of their measurement, all in the frame of the estimate [m].
    mesh
        The surface estimated before the first motion, closed [m].
    """
    count = len(sets)
    displacements = np.zeros((count, 3))
    difference = np.eye(count) - np.eye(count, k=-1)
    prior = np.kron(difference.T @ difference, np.diag(_CLOSING_MOTION**-2.0))
    for _ in range(_ITERATIONS if any(map(len, sets)) else 0):
        information, gradient = prior.copy(), -prior @ displacements.ravel()
        for k, contacts in enumerate(sets):
            if not len(contacts):
                continue
            back = np.linalg.inv(planar_pose(displacements[k]))
            points = trimesh.transform_points(contacts.points, back)
            nearest, _, triangles = trimesh.proximity.closest_point(mesh, points)
            normals = mesh.face_normals[triangles]
            distances = np.einsum("ni,ni->n", points - nearest, normals) / _CONTACT_ERROR
            rows = displacement_rows(nearest, normals) / _CONTACT_ERROR
            own = slice(3 * k, 3 * k + 3)
            information[own, own] += rows.T @ rows
            gradient[own] += rows.T @ distances
        displacements += np.linalg.solve(information, gradient).reshape(count, 3)
    return displacements
