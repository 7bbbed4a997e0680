"""Quality of a grasp on the true object, after planning on an estimate."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.grasping.epsilon import epsilon_on
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.suction import cup_epsilon
from lis_grasp.robots.hand import Hand


def epsilon_on_truth(grasp: Grasp, truth: trimesh.Trimesh, hand: Hand, *, friction: float) -> float:
    """Return the grasp's Ferrari-Canny epsilon where its fingers meet the true surface.

    Each finger moves along the line of its planned contact normal until it meets the true surface
    (the crossing nearest to the planned contact); where the line misses the object, the contact is
    lost. Origin, length scale and contact model are as in `epsilon_on`, on the true object, which
    is watertight and in O [m]. The result is 0 where fewer than two fingers meet it, or a cup
    does not seal.
    """
    points, normals = true_contacts(grasp, truth)
    if hand.cup is not None and len(points):
        axes = grasp.contact_normals
        return float(cup_epsilon(truth, hand.cup, points, axes, friction=friction)[0])
    if len(points) < 2:
        return 0.0
    return epsilon_on(truth, hand, points, normals, friction=friction)


def true_contacts(grasp: Grasp, truth: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Return the fingers' contacts on the true surface: points and outward normals, each (K, 3)."""
    # Cast rays from outside along the inward normals; keep the crossing nearest to the contact.
    reach = 2.0 * float(np.linalg.norm(truth.extents))
    points, normals = [], []
    for p_OC, n_OC in zip(grasp.contact_points, grasp.contact_normals, strict=True):
        hits, _, faces = truth.ray.intersects_location(
            [p_OC + reach * n_OC], [-n_OC], multiple_hits=True
        )
        facing = truth.face_normals[faces] @ n_OC > 0.0 if len(faces) else np.zeros(0, bool)
        if not facing.any():
            continue
        hits, faces = hits[facing], faces[facing]
        nearest = int(np.argmin(np.linalg.norm(hits - p_OC, axis=1)))
        points.append(hits[nearest])
        normals.append(truth.face_normals[faces[nearest]])
    return np.reshape(points, (-1, 3)), np.reshape(normals, (-1, 3))
