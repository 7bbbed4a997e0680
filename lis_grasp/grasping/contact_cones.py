"""Support functions of contacts: which wrench of a contact is farthest along a direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.contact_model import (
    ContactModel,
    check_model,
    contact_wrenches,
    scaled_arms,
)
from lis_grasp.typing import FloatArray, IndexArray

_ROUNDING = 1e-12


class ContactCones(Protocol):
    """The wrenches of B grasps with C contacts each, normal forces of 1."""

    def farthest(self, directions: FloatArray, grasps: IndexArray) -> FloatArray:
        """Return each contact's wrench, shape (b, C, 6), farthest along its grasp's direction.

        Parameters
        ----------
        directions
            Shape (b, 6), of wrenches (forces, torques over the length scale).
        grasps
            Shape (b,): which grasp each is for.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class LinearCones:
    """Contacts with finitely many primitive wrenches.

    Parameters
    ----------
    wrenches
        Shape (B, C, K, 6), as of `contact_wrenches`.
    """

    wrenches: FloatArray

    def farthest(self, directions: FloatArray, grasps: IndexArray) -> FloatArray:
        """See `ContactCones.farthest`."""
        wrenches = self.wrenches[grasps]  # (b, C, K, 6)
        reach = (wrenches @ directions[:, None, :, None])[..., 0]  # (b, C, K)
        best = reach.argmax(axis=-1)[..., None, None]
        found: FloatArray = np.take_along_axis(wrenches, best, axis=2)[:, :, 0]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class RoundCones:
    """Contacts with Coulomb's round cone, soft ones with an elliptic limit surface.

    With unit normal force a contact resists tangential forces f and torques t about its normal with
    ``|f|^2 / mu^2 + t^2 / e^2 <= 1`` (Howe and Cutkosky 1996), so the farthest wrench along a
    direction has a closed form.

    Parameters
    ----------
    arms
        Shape (B, C, 3): contacts from the origin, over the length scale.
    normals
        Shape (B, C, 3): unit, outward of the object.
    friction
        Coulomb coefficient mu.
    levers
        Shape (B,): e, over the length scale; 0 for hard fingers.
    """

    arms: FloatArray
    normals: FloatArray
    friction: float
    levers: FloatArray

    def farthest(self, directions: FloatArray, grasps: IndexArray) -> FloatArray:
        """See `ContactCones.farthest`."""
        arms, inward = self.arms[grasps], -self.normals[grasps]  # (b, C, 3)
        turn = directions[:, None, 3:]
        push = directions[:, None, :3] + np.cross(turn, arms)  # what a force does, (b, C, 3)
        sideways = push - (push * inward).sum(axis=-1, keepdims=True) * inward
        # Of a push along the normal, rounding is left, which points anywhere.
        left, size = ((v**2).sum(axis=-1, keepdims=True) for v in (sideways, push))
        sideways = np.where(left <= _ROUNDING**2 * size, 0.0, sideways)
        lever = self.levers[grasps][:, None]
        spin = lever * (turn * inward).sum(axis=-1)  # (b, C)
        length = np.sqrt(self.friction**2 * (sideways**2).sum(axis=-1) + spin**2)
        length = np.where(length > 0.0, length, 1.0)[..., None]
        forces = inward + self.friction**2 * sideways / length
        torques = np.cross(arms, forces) + (lever * spin)[..., None] * inward / length
        return np.concatenate([forces, torques], axis=-1)


def contact_cones(
    points: FloatArray,
    normals: FloatArray,
    *,
    friction: float,
    origin: npt.ArrayLike,
    length_scale: npt.ArrayLike,
    model: ContactModel,
    torsion: float,
    edges: int | None,
) -> LinearCones | RoundCones:
    """Return the cones of contacts (B, C, 3): pyramids, or round ones where `edges` is None."""
    if edges is not None:
        return LinearCones(
            contact_wrenches(
                points,
                normals,
                friction=friction,
                origin=origin,
                length_scale=length_scale,
                model=model,
                torsion=torsion,
                edges=edges,
            )
        )
    check_model(model)
    if not (np.isfinite(friction) and friction >= 0.0):
        raise InvalidOptionError(f"friction must be a number of at least 0; it is {friction}")
    arms, levers = scaled_arms(points, origin=origin, length_scale=length_scale, torsion=torsion)
    soft = model == "soft_finger"
    return RoundCones(
        arms,
        normals,
        0.0 if model == "frictionless" else friction,
        np.broadcast_to(levers if soft else np.zeros(()), points.shape[:1]),
    )
