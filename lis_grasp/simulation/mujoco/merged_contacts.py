"""Contacts of the hand with the object in MuJoCo, those of one collision body merged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from lis_grasp.geometry import unit
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MergedContact:
    """Contact of one collision body of the hand with the object, in W."""

    link: str
    point: FloatArray  # (3,) [m]: mean of the contact points, weighted with their normal forces
    normal: FloatArray  # (3,), unit, out of the object: weighted alike
    force: FloatArray  # (3,) [N], of the hand on the object

    @property
    def strength(self) -> float:
        """Size of the force [N]."""
        return float(np.linalg.norm(self.force))


def merged_contacts(
    model: mujoco.MjModel, data: mujoco.MjData, object_body: int, link_of_geom: Mapping[int, str]
) -> list[MergedContact]:
    """Return the contacts that exert a force, one for each body of the hand, in MuJoCo's order.

    Drake's contact patch is one for each pair of bodies; MuJoCo gives several points of it, and
    several convex pieces of the object. `link_of_geom` are the hand's bodies by number.
    """
    sums: dict[int, tuple[FloatArray, FloatArray, FloatArray, float]] = {}
    for number in range(data.ncon):
        first, second = (int(geom) for geom in data.contact.geom[number])
        if model.geom_bodyid[first] == object_body:
            geom, outward = second, 1.0  # MuJoCo's normal is from the first to the second
        elif model.geom_bodyid[second] == object_body:
            geom, outward = first, -1.0
        else:
            continue
        if geom not in link_of_geom:
            continue
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, number, wrench)
        if wrench[0] <= 0.0:
            continue
        frame = data.contact.frame[number].reshape(3, 3)  # its rows: the normal, two tangents
        # The force of the first body on the second.
        force = -outward * (wrench[:3] @ frame)
        point, normal, total, weight = sums.get(geom, (0.0, 0.0, 0.0, 0.0))
        sums[geom] = (
            point + wrench[0] * data.contact.pos[number],
            normal + outward * wrench[0] * frame[0],
            total + force,
            weight + wrench[0],
        )
    return [
        MergedContact(link_of_geom[geom], point / weight, unit(normal), force)
        for geom, (point, normal, force, weight) in sums.items()
    ]
