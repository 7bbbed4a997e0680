"""Contact models: the forces and wrenches that a contact can put on an object."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.typing import FloatArray

ContactModel = Literal["frictionless", "coulomb", "soft_finger"]

CONE_EDGES = 8


def cone_edges(normals: npt.ArrayLike, friction: float, *, edges: int = CONE_EDGES) -> FloatArray:
    """Return the edges of linearised Coulomb friction cones.

    The cone ``|f_t| <= mu f_n`` becomes the pyramid of forces with normal part 1 and tangential
    part mu in `edges` directions, so every non-negative combination lies inside the cone.

    Parameters
    ----------
    normals
        Shape (..., C, 3), unit, OUTWARD of the object; forces on the object point inward.
    friction
        Coulomb coefficient mu.
    edges
        Edges of the pyramid, at least 3.

    Returns
    -------
    FloatArray
        Shape (..., C, edges, 3): forces on the object with unit normal part.
    """
    if not (np.isfinite(friction) and friction >= 0.0):
        raise InvalidOptionError(f"friction must be a number of at least 0; it is {friction}")
    if edges < 3:
        raise InvalidOptionError(f"a friction pyramid needs at least 3 edges; {edges} came")
    inward = -np.asarray(normals, dtype=np.float64)
    # Any vector off the normal makes a tangent: the axis least aligned with it.
    helper = np.eye(3)[np.argmin(np.abs(inward), axis=-1)]
    first = np.cross(inward, helper)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(inward, first)
    angles = 2.0 * np.pi * np.arange(edges) / edges
    tangents = (
        np.cos(angles)[:, None] * first[..., None, :]
        + np.sin(angles)[:, None] * second[..., None, :]
    )
    result: FloatArray = inward[..., None, :] + friction * tangents
    return result


def contact_wrenches(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    origin: npt.ArrayLike,
    length_scale: npt.ArrayLike,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int = CONE_EDGES,
) -> FloatArray:
    """Return the primitive wrenches of contacts, each with unit normal force.

    A wrench is ``(f, (p - origin) x f / length_scale)``: torques are divided by a length, so that
    all six parts are forces and a change of units changes nothing (Li and Sastry 1988).

    Parameters
    ----------
    points, normals
        Shape (..., C, 3) [m] and unit, outward of the object.
    friction
        Coulomb coefficient; not used by the frictionless model.
    origin
        Shape (3,) or (..., 3) [m]: where torques are taken about.
    length_scale
        Scalar or shape (...) [m]: what torques are divided by.
    model
        ``"frictionless"``: the normal force alone; ``"coulomb"``: a friction pyramid;
        ``"soft_finger"``: the pyramid, and a torque about the normal of up to ``torsion`` times
        the normal force (Salisbury and Roth 1983), less the more friction is used sideways: the
        linear limit surface, inside of the elliptic one (Howe and Cutkosky 1996).
    torsion
        [m] Of a soft finger.
    edges
        Edges of the pyramid.

    Returns
    -------
    FloatArray
        Shape (..., C, K, 6) with K = 1, edges, or edges + 2.
    """
    arms, levers = scaled_arms(points, origin=origin, length_scale=length_scale, torsion=torsion)
    normals = np.asarray(normals, dtype=np.float64)
    check_model(model)
    if model == "frictionless":
        forces = -normals[..., None, :]
    else:
        forces = cone_edges(normals, friction, edges=edges)
    wrenches = np.concatenate([forces, np.cross(arms[..., None, :], forces)], axis=-1)
    if model == "soft_finger":
        push = np.concatenate([-normals, np.cross(arms, -normals)], axis=-1)  # (..., C, 6)
        spin = np.concatenate([np.zeros_like(normals), levers[..., None, None] * normals], axis=-1)
        spins = np.stack([push - spin, push + spin], axis=-2)  # (..., C, 2, 6)
        wrenches = np.concatenate([wrenches, spins], axis=-2)
    return wrenches


def check_model(model: str) -> None:
    """Refuse what is no contact model."""
    if model not in get_args(ContactModel):
        raise InvalidOptionError(
            f"model must be one of {', '.join(get_args(ContactModel))}; it is '{model}'"
        )


def scaled_arms(
    points: npt.ArrayLike, *, origin: npt.ArrayLike, length_scale: npt.ArrayLike, torsion: float
) -> tuple[FloatArray, FloatArray]:
    """Return the contacts' arms about an origin (..., C, 3), and torsion (...), over the length."""
    length = np.asarray(length_scale, dtype=np.float64)
    if not (np.isfinite(length).all() and (length > 0.0).all()):
        raise InvalidOptionError(f"length_scale must be a positive length [m]; it is {length}")
    arms = np.asarray(points, dtype=np.float64) - np.asarray(origin, dtype=np.float64)[..., None, :]
    return arms / length[..., None, None], np.asarray(torsion / length)
