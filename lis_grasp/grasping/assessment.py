"""The quality of contacts on one object: one choice of origin, length scale and contact model."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.grasping.contact_model import ContactModel
from lis_grasp.grasping.force_closure import is_force_closure, resisted_force
from lis_grasp.grasping.hand import Hand
from lis_grasp.grasping.quality import epsilon_quality

FloatArray = npt.NDArray[np.float64]

# A flat pad resists turning about its normal with about this lever [m]: a patch of 9 mm radius
# under even pressure, two thirds of the radius (Howe and Cutkosky 1996).
_FLAT_PAD_LEVER = 0.006


def closes(hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float) -> bool:
    """Return whether a hand's contacts (C, 3), normals outward, are in force closure."""
    model, torsion = _contact_model(hand, friction)
    return is_force_closure(points, normals, friction=friction, model=model, torsion=torsion)


def epsilon_on(
    mesh: trimesh.Trimesh, hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float
) -> float:
    """Return epsilon of a hand's contacts on an object, comparable between grasps and estimates.

    Torques are taken about the centre of mass at uniform density, and divided by the largest
    distance of a vertex from it. Rounded pads are hard fingers with Coulomb friction, a jaw's
    flat pads soft fingers.

    Parameters
    ----------
    mesh
        Closed mesh of the object in O [m], true or estimated.
    hand
        Whose pads touch.
    points, normals
        Shape (C, 3): contacts in O [m], outward unit normals.
    friction
        Coulomb coefficient.
    """
    model, torsion = _contact_model(hand, friction)
    center = np.asarray(mesh.center_mass)
    return epsilon_quality(
        points,
        normals,
        friction=friction,
        origin=center,
        length_scale=float(np.linalg.norm(mesh.vertices - center, axis=1).max()),
        model=model,
        torsion=torsion,
    )


def weight_on(
    mesh: trimesh.Trimesh, hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float
) -> float:
    """Return the weight [N] that contacts can carry for each newton of their normal forces.

    Gravity pulls along -z of O at the centre of mass at uniform density; arguments and contact
    model are those of `epsilon_on`.
    """
    model, torsion = _contact_model(hand, friction)
    return resisted_force(
        points,
        normals,
        (0.0, 0.0, 1.0),
        friction=friction,
        origin=np.asarray(mesh.center_mass),
        model=model,
        torsion=torsion,
    )


def _contact_model(hand: Hand, friction: float) -> tuple[ContactModel, float]:
    return ("soft_finger", friction * _FLAT_PAD_LEVER) if hand.kind == "jaw" else ("coulomb", 0.0)
