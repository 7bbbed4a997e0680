"""Grasp refinement: contact sets near those of known grasps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.grasping.contact_samples import SurfaceSamples
from lis_grasp.grasping.contact_sets import ContactSets
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.hands.hand import Hand
from lis_grasp.typing import FloatArray, IndexArray


def perturb_grasps(
    hand: Hand,
    grasps: Sequence[Grasp],
    samples: SurfaceSamples,
    *,
    each: int,
    distance: float,
    rng: np.random.Generator,
) -> tuple[IndexArray, ContactSets, FloatArray, FloatArray]:
    """Perturb the contacts of grasps, and project them on the surface.

    All contacts of a set move by one common random step, blended with a step of each contact by a
    random weight. Steps are drawn in the palm's frame, so that grasps turn with the object. Sets
    with a contact that finds no usable surface are left out.

    Each grasp gets `each` draws, with steps of the standard deviation `distance` [m] in each
    coordinate. Returned are, of B sets: the index (B,) of the perturbed grasp, the sets, and an
    initial guess of inverse kinematics: palm poses (B, 4, 4) and joint positions (B, J).
    """
    parents = np.repeat(np.arange(len(grasps)), each)
    points = np.zeros((len(grasps), len(hand.pads), 3))
    used = np.zeros((len(grasps), len(hand.pads)), dtype=bool)
    for g, grasp in enumerate(grasps):
        pads = [hand.fingers.index(finger) for finger in grasp.contact_fingers]
        points[g, pads], used[g, pads] = grasp.contact_points, True
    points, used = points[parents], used[parents]
    alone = rng.random((len(parents), 1, 1))
    poses = np.array([grasp.X_OH for grasp in grasps])
    steps_H = rng.normal(scale=distance, size=(len(parents), 1 + len(hand.pads), 3))
    steps = steps_H @ np.swapaxes(poses[parents, :3, :3], -1, -2)
    moved = points + (1.0 - alone) * steps[:, :1] + alone * steps[:, 1:]
    on_surface, normals, usable = samples.nearest(moved)
    kept = (usable | ~used).all(axis=1)
    X_OH = poses[parents[kept]]
    q = np.array([grasp.joint_positions for grasp in grasps])[parents[kept]]
    mask = used[kept][..., None]
    sets = ContactSets(
        np.where(mask, on_surface[kept], 0.0),
        np.where(mask, normals[kept], 0.0),
        used[kept],
    )
    # The palm moves with the middle of the contacts.
    shift = ((on_surface - points) * used[..., None]).sum(axis=1) / used.sum(axis=1)[:, None]
    X_OH[:, :3, 3] += shift[kept]
    return parents[kept], sets, X_OH, q
