"""A contact patch as contacts: one, or in a concave corner one for each face that is touched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

# A fingertip of 12 mm pressed in by 0.3 mm spans 13 deg to either side of its mean normal on a ball
# of its own size; faces that differ by more than this belong to different sides of an edge.
_SPLIT_ANGLE = np.deg2rad(35.0)
# A part smaller than this share of the patch says too little of where its face is.
_LEAST_SHARE = 0.2


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


def split_patch(
    link: str, areas: FloatArray, centroids: FloatArray, normals: FloatArray, *, force: float
) -> list[Patch]:
    """Split a contact patch at the edges that it lies across.

    A patch across an edge covers two faces, and the mean of their normals is the normal of neither.
    Faces within 35 degrees of a part's area-weighted mean normal form that part, the largest
    first. In a concave corner the tip rests on both faces, apart from each other: each is a contact.
    Round a convex edge the parts meet in one place: only the largest counts.

    Parameters
    ----------
    link
        The hand's link that touches.
    areas, centroids, normals
        Of the patch's faces: (F,) [m^2], (F, 3) [m], (F, 3) unit and out of the object.
    force
        Normal force of the whole patch [N].

    Returns
    -------
    list of Patch
        At least one for a patch with area; points and normals in the frame of the arguments.
    """
    total = float(areas.sum())
    remaining = areas > 0.0
    parts = []
    while remaining.any():
        largest = int(np.argmax(np.where(remaining, areas, -1.0)))
        normal = normals[largest]
        for _ in range(3):  # the mean settles in two or three rounds
            members = remaining & (normals @ normal > np.cos(_SPLIT_ANGLE))
            members[largest] = True
            normal = areas[members] @ normals[members]
            normal /= np.linalg.norm(normal)
        share = float(areas[members].sum()) / total
        point = areas[members] @ centroids[members] / areas[members].sum()
        # Concave: the new part rises above the plane of the first.
        if not parts or (share >= _LEAST_SHARE and (point - parts[0].point) @ parts[0].normal > 0.0):
            parts.append(Patch(link, point, normal, force * share))
        remaining &= ~members
    return parts
