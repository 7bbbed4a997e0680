"""Vary grasps a little: contacts beside theirs, to see whether these hold better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from lis_grasp.grasping.contact_samples import SurfaceSamples
from lis_grasp.grasping.contact_search import ContactSets
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.hands.hand import Hand
from lis_grasp.typing import FloatArray


def vary(
    hand: Hand,
    grasps: Sequence[Grasp],
    samples: SurfaceSamples,
    *,
    each: int,
    distance: float,
    rng: np.random.Generator,
) -> tuple[npt.NDArray[np.intp], ContactSets, FloatArray, FloatArray]:
    """Return contact sets near those of grasps, and the postures of the grasps to start from.

    All contacts of a set move by one random step together, and each by one of its own, whose share
    is random too; steps are drawn in the palm's frame, so that grasps turn with the object. Then
    contacts go to the surface. Sets with one that finds no usable surface where it should be are
    left out.

    Parameters
    ----------
    hand, samples
        The hand, and where it may touch.
    grasps
        Of this hand.
    each
        Sets to try for each grasp.
    distance
        Standard deviation of the steps in each coordinate [m].
    rng
        For every draw.

    Returns
    -------
    tuple
        Of B sets: the index (B,) of the grasp that each is a variation of, the sets, and palm poses
        (B, 4, 4) and joint positions (B, J) to start reaching from.
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
        X_OH[:, :3, :3],
    )
    # The palm goes along with the middle of the contacts.
    shift = ((on_surface - points) * used[..., None]).sum(axis=1) / used.sum(axis=1)[:, None]
    X_OH[:, :3, 3] += shift[kept]
    return parents[kept], sets, X_OH, q
