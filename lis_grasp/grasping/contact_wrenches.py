"""Contact models: friction cones, and the wrenches that contacts can apply to an object."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import (
    InvalidContactsError,
    InvalidOptionError,
    require_at_least,
    require_positive,
)
from lis_grasp.geometry import cross, tangent_frame
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray

ContactModel = Literal["frictionless", "coulomb", "soft_finger"]

CONE_EDGES = 8
"""Edges of a friction pyramid."""

# Torsional lever of a flat pad [m]: 2/3 of a contact radius of 9 mm (Howe and Cutkosky 1996).
_FLAT_PAD_LEVER = 0.006
# A rotation counts as the acceleration at the first distance [m] from its axis, as in a lift's
# shake; radii of gyration are at least the second.
_TURN_ARM, _LEAST_GYRATION = 0.65, 0.017


@dataclass(frozen=True, slots=True, eq=False)
class WrenchModel:
    """The model of contact wrenches: friction, contact model, origin and length scale of torques.

    A wrench is ``(f, (p - origin) x f / length_scale)``: torques are divided by a length, so that
    all six parts are forces and a change of units changes nothing (Li and Sastry 1988).

    Parameters
    ----------
    friction
        Coulomb coefficient; not used by the frictionless model.
    contact_model
        ``"frictionless"``: the normal force alone; ``"coulomb"``: a friction pyramid;
        ``"soft_finger"``: the pyramid, and a torque about the normal of up to `torsion` times the
        normal force (Salisbury and Roth 1983). The torque shrinks as sideways friction is used:
        the linear limit surface, inside the elliptic one (Howe and Cutkosky 1996).
    torsion
        Torsional coefficient of a soft finger [m].
    origin
        Shape (3,) [m]: reference point of torques; None for the centroid of the contacts.
    length_scale
        Divisor of torques [m]; None for the largest distance of a contact from the origin.
    torque_metric
        Shape (3, 3) [1/m]: torques are multiplied by it, instead of divided by a length; see
        `inertial_metric`.
    edges
        Edges of the friction pyramid.

    Raises
    ------
    InvalidOptionError
        If the contact model is unknown, or the length scale is not positive.
    """

    friction: float
    contact_model: ContactModel = "coulomb"
    torsion: float = 0.0
    origin: npt.ArrayLike | None = None
    length_scale: float | None = None
    edges: int = CONE_EDGES
    torque_metric: npt.ArrayLike | None = None

    def __post_init__(self) -> None:
        if self.contact_model not in get_args(ContactModel):
            choices = get_args(ContactModel)
            raise InvalidOptionError.not_one_of("model", self.contact_model, choices)
        if self.length_scale is not None:
            require_positive(length_scale=self.length_scale)

    def wrenches(self, points: npt.ArrayLike, normals: npt.ArrayLike) -> FloatArray:
        """Return the primitive wrenches of contacts, each with unit normal force.

        Points (..., C, 3) [m] and unit normals, OUTWARD of the object, give wrenches of shape
        (..., C, K, 6) with K = 1 (frictionless), edges, or edges + 2 (soft finger). Contacts of
        another shape, or with C = 0, raise `InvalidContactsError`.
        """
        points, normals = _checked(points, normals)
        center = points.mean(axis=-2) if self.origin is None else np.asarray(self.origin)
        arms = points - center[..., None, :]
        if self.torque_metric is not None:
            length = np.ones(center.shape[:-1])
        elif self.length_scale is None:
            radius = np.linalg.norm(arms, axis=-1).max(axis=-1)
            length = np.where(radius > 0.0, radius, 1.0)
        else:
            length = np.asarray(self.length_scale, dtype=np.float64)
        arms = arms / length[..., None, None]
        if self.contact_model == "frictionless":
            forces = -normals[..., None, :]
        else:
            forces = cone_edges(normals, self.friction, edges=self.edges)
        wrenches = np.concatenate([forces, cross(arms[..., None, :], forces)], axis=-1)
        if self.contact_model == "soft_finger":
            lever = np.asarray(self.torsion / length)[..., None, None]
            push = np.concatenate([-normals, cross(arms, -normals)], axis=-1)  # (..., C, 6)
            spin = np.concatenate([np.zeros_like(normals), lever * normals], axis=-1)
            spins = np.stack([push - spin, push + spin], axis=-2)  # (..., C, 2, 6)
            wrenches = np.concatenate([wrenches, spins], axis=-2)
        if self.torque_metric is not None:
            wrenches[..., 3:] = wrenches[..., 3:] @ np.asarray(self.torque_metric).T
        return wrenches

    def wrenches_of_grasp(self, points: npt.ArrayLike, normals: npt.ArrayLike) -> FloatArray:
        """Return all primitive wrenches (K, 6) of one grasp's contacts (C, 3)."""
        wrenches = self.wrenches(points, normals)
        if wrenches.ndim != 3:
            raise InvalidContactsError(
                f"contacts must be of shape (C, 3); it is {np.shape(points)}", field="points"
            )
        return wrenches.reshape(-1, 6)


def wrench_model(mesh: trimesh.Trimesh, hand: Hand, friction: float) -> WrenchModel:
    """Return the wrench model of a hand's contacts on an object; see `WrenchModel`."""
    center = np.asarray(mesh.center_mass)
    length = float(np.linalg.norm(mesh.vertices - center, axis=1).max())
    model = WrenchModel(friction, origin=center, length_scale=length)
    if hand.kind == "parallel_jaw":
        model = replace(model, contact_model="soft_finger", torsion=friction * _FLAT_PAD_LEVER)
    return model


def inertial_metric(mesh: trimesh.Trimesh) -> FloatArray:
    """Return the matrix (3, 3) [1/m] that makes accelerations of wrenches, of unit mass.

    A wrench accelerates an object of uniform density and mass m by ``f / m`` and turns it by
    ``I^-1 tau``. The latter counts as the acceleration at 0.65 m from the axis, so the epsilon in
    this metric is a largest acceleration of the unit mass, per unit of the fingers' forces.
    """
    by_mass, axes = np.linalg.eigh(np.asarray(mesh.moment_inertia) / mesh.volume)  # [m^2]
    inverse = 1.0 / np.maximum(by_mass, _LEAST_GYRATION**2)
    return np.asarray(_TURN_ARM * (axes * inverse) @ axes.T)


def cone_edges(normals: npt.ArrayLike, friction: float, *, edges: int = CONE_EDGES) -> FloatArray:
    """Return the edges of linearised Coulomb friction cones.

    The cone ``|f_t| <= mu f_n`` becomes the pyramid of forces with normal part 1 and tangential
    part mu in `edges` (at least 3) directions, so every non-negative combination is inside the
    cone. Unit normals (..., C, 3), OUTWARD of the object, give forces on the object (..., C, edges,
    3), which point inward.
    """
    require_at_least(0, friction=friction)
    require_at_least(3, edges=edges)
    inward = -np.asarray(normals, dtype=np.float64)
    frames = tangent_frame(inward)
    angles = 2.0 * np.pi * np.arange(edges) / edges
    tangents = np.cos(angles)[:, None] * frames[..., :1, :]
    tangents += np.sin(angles)[:, None] * frames[..., 1:, :]
    return np.asarray(inward[..., None, :] + friction * tangents)


def _checked(points: npt.ArrayLike, normals: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return contacts as arrays of one shape (..., C, 3), or refuse them."""
    points, normals = _rows("points", points), _rows("normals", normals)
    if points.shape != normals.shape:
        raise InvalidContactsError(
            f"each point needs one normal; the shapes are {points.shape} and {normals.shape}",
            field="normals",
        )
    return points, normals


def _rows(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        rows = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidContactsError(
            f"{name} must be numbers of shape (..., C, 3)", field=name
        ) from None
    if rows.ndim < 2 or rows.shape[-1] != 3 or not rows.shape[-2] or not np.isfinite(rows).all():
        raise InvalidContactsError(
            f"{name} must be finite numbers of shape (..., C, 3) with C of at least 1; their shape"
            f" is {rows.shape}",
            field=name,
        )
    return rows
