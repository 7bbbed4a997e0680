"""What the upper half of a seen object implies of its lower half: that it is its mirror image.

No finger gets under an object that lies on a table, and its far side hides its lower half from a
camera. Many things that lie are alike above and below: bottles, rods, stones. Their mirror plane is
at half of their height, which the table and the top give. What is seen must agree: an image that
would be visible has to be on seen surface, and none is in free space. Only surface that the mirror
moves is evidence: a wall and its image are one plane. Without evidence a thing that is mostly walls
is taken to have walls, and one that mostly slopes to slope below, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import unit
from lis_grasp.surfaces import FreeSpace
from lis_grasp.surfaces.contact_places import farthest_point_order
from lis_grasp.typing import BoolArray, FloatArray

# Seen contacts that are compared with their mirror images, and that are implied, at most.
_COMPARED, _MOST = 160, 60
# The top is above this part of the seen contacts [%].
_TOP = 99.5
# Contacts agree this near to each other [m], this far off their planes [m], and this parallel.
_NEAR, _OFF, _PARALLEL = 0.01, 0.003, 0.8
# Depth in free space that no surface has [m]. A surface shows itself to a camera that it faces by
# this cosine.
_FREE, _FACING = 0.004, 0.25
# A mirror moves surface with normals of a larger vertical part.
_LEAST_SLOPE = 0.2
# An object is taken to be alike above and below if this part of what is seen agrees, or this part
# slopes; and if no more is contradicted, and in free space.
_AGREEING, _SLOPING, _MOST_WRONG, _MOST_FREE = 0.04, 0.5, 0.1, 0.04
# Seen contacts this near say the same [m].
_SEEN = 0.008
# Noise of what is implied: positions [m] and normals [rad].
_NOISE = (0.003, 0.25)


def lower_half(
    seen: Contacts, touches: Contacts, eyes: FloatArray, free: FreeSpace, support_height: float
) -> Contacts:
    """Return the weak contacts that are mirror images of what was seen and touched.

    They are where nothing is seen. There are none of an object that is seen not to be alike above
    and below, or may be a prism.

    Parameters
    ----------
    seen
        Contacts by cameras, in W.
    touches
        Contacts by touch, in W.
    eyes
        Places of the cameras, shape (E, 3) [m], in W.
    free
        Space that the cameras show to be free.
    support_height
        Height of the table in W [m].
    """
    height = _plane(seen, eyes, free, support_height)
    if height is None:
        return Contacts.empty()
    images = _mirrored(seen.append(touches), height)
    away, _ = cKDTree(seen.points).query(images.points)
    unseen = (away > _SEEN) & (images.points[:, 2] > support_height)
    unseen &= free.depths(images.points)[0] < _FREE
    images = images.subset(unseen)
    if not len(images):
        return images
    images = images.subset(farthest_point_order(images.points, min(_MOST, len(images)))[0])
    position, normal = (np.full(len(images), noise) for noise in _NOISE)
    return replace(images, position_noise=position, normal_noise=normal)


def _plane(
    seen: Contacts, eyes: FloatArray, free: FreeSpace, support_height: float
) -> float | None:
    """Return the height of the plane in which an object is mirrored [m]; None without evidence."""
    if not len(seen):
        return None
    chosen, _ = farthest_point_order(seen.points, min(_COMPARED, len(seen)))
    some, tree = seen.subset(chosen), cKDTree(seen.points)
    top = float(np.percentile(seen.points[:, 2], _TOP))
    height = 0.5 * (support_height + top)
    images = _mirrored(some, height)
    agrees = _agrees(images, seen, tree)
    is_free = free.depths(images.points)[0] > _FREE
    is_free |= images.points[:, 2] < support_height - _FREE
    lines = unit(eyes[:, None] - images.points, least=1e-9)  # (E, N, 3)
    visible = (np.einsum("enk,nk->en", lines, images.normals) > _FACING).any(axis=0)
    moved = np.abs(some.normals[:, 2]) > _LEAST_SLOPE
    moved &= images.points[:, 2] > support_height + _OFF  # the top is as level as the table
    alike = np.mean(moved) >= _SLOPING or np.mean(agrees & moved) >= _AGREEING
    wrong = np.mean((is_free | visible) & ~agrees & moved)
    return height if alike and wrong <= _MOST_WRONG and np.mean(is_free) <= _MOST_FREE else None


def _agrees(images: Contacts, known: Contacts, tree: cKDTree) -> BoolArray:
    """Return which mirror images, (N,), are on the surface of known contacts next to them."""
    distances, near = tree.query(images.points)
    normals = known.normals[near]
    heights = np.einsum("nk,nk->n", images.points - known.points[near], normals)
    alike = np.einsum("nk,nk->n", images.normals, normals) > _PARALLEL
    return np.asarray((distances < _NEAR) & (np.abs(heights) < _OFF) & alike)


def _mirrored(contacts: Contacts, height: float) -> Contacts:
    """Return contacts mirrored at a level plane at a height [m]."""
    down = np.array([1.0, 1.0, -1.0])
    points = contacts.points * down + [0.0, 0.0, 2.0 * height]
    return Contacts(points, contacts.normals * down)
