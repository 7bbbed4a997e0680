"""Contacts of bodies whose surface is known in closed form: a ball, a block, a plate."""

from __future__ import annotations

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import unit
from lis_grasp.typing import FloatArray

RADIUS = 0.03
"""Of the ball [m]."""

HALF = np.array([0.04, 0.03, 0.02])
"""Half the sides of the block [m]."""

_THIN = 0.1  # of a plate: its thickness in that of the block
_JITTER = 0.05  # of places on a face, in its half sides: a grid has ties, which rounding breaks
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


def directions(count: int) -> FloatArray:
    """Return unit vectors spread evenly (Fibonacci's lattice), (count, 3)."""
    heights = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    rings, angles = np.sqrt(1.0 - heights**2), _GOLDEN * np.arange(count)
    return np.column_stack([rings * np.cos(angles), rings * np.sin(angles), heights])


def ball(count: int = 40) -> Contacts:
    """Return contacts of the ball of `RADIUS` about the origin."""
    normals = directions(count)
    return Contacts(RADIUS * normals, normals)


def block(half: FloatArray = HALF) -> Contacts:
    """Return thirty contacts of a block about the origin, five on each face."""
    rng = np.random.default_rng(0)
    places = np.array([[0.0, 0.0], [0.6, 0.5], [-0.6, 0.5], [0.6, -0.5], [-0.6, -0.5]])
    points, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            normal = side * np.eye(3)[axis]
            on_face = np.tile(normal, (len(places), 1))
            others = [k for k in range(3) if k != axis]
            on_face[:, others] = places + rng.uniform(-_JITTER, _JITTER, places.shape)
            points.append(on_face * half)
            normals.append(np.tile(normal, (len(places), 1)))
    return Contacts(np.concatenate(points), np.concatenate(normals))


def plate() -> Contacts:
    """Return contacts of the block as a plate 4 mm thick."""
    return block(HALF * [1.0, 1.0, _THIN])


def block_distance(points: FloatArray, half: FloatArray = HALF) -> FloatArray:
    """Return the signed distance of points (P, 3) from a block [m], (P,)."""
    beyond = np.abs(points) - half
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def noisy(contacts: Contacts, position_noise: float, normal_noise: float) -> Contacts:
    """Return contacts that are moved along their normals [m] and turned [rad] at random."""
    rng = np.random.default_rng(1)
    aside = position_noise * rng.normal(size=len(contacts))
    normals = unit(contacts.normals + normal_noise * rng.normal(size=(len(contacts), 3)))
    return Contacts(contacts.points + aside[:, None] * contacts.normals, normals)


def places_around(count: int = 300) -> FloatArray:
    """Return random points in a cube of twice the block about the origin, (count, 3) [m]."""
    return np.random.default_rng(2).uniform(-2.0, 2.0, (count, 3)) * HALF
