"""Wrenches that a sealed suction cup applies to an object: pull, shear, twist and bending."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.geometry import cross, tangent_frame
from lis_grasp.grasping.contact_wrenches import CONE_EDGES
from lis_grasp.robots.robot_model import Cup
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CupWrenches:
    """The wrenches of sealed cups, as half-spaces ``rows w <= limits`` of wrenches w.

    The suction ring contact of Mahler et al. (2018), Dex-Net 3.0, section IV: air presses the
    object against the lip with V (`Cup.pull`), and the object pulls on the cup with ``f_z`` along
    the outward normal, so that the lip presses with ``N = V - f_z``. A ring of radius R carries

    - a pull: ``N >= 0``;
    - shear and twist by friction mu: ``|f_t| + |m_z| / R <= mu N``, the linear limit surface;
    - bending and twist: ``|m_t| / R + |m_z| / (mu R) <= N``. At ``N R`` the object tips over the
      lip's edge, which has no friction left for a twist. The paper has a constant of the rubber
      there, ``pi R kappa``. From ``N R / 2`` on, where a linear elastic ring presses with 0 on one
      side, only a lip that follows the surface keeps the seal.

    Circles are replaced by regular polygons inside them.
    """

    rows: FloatArray  #: (B, K, 6): of forces [1] and of torques about the origin [1/m], in O
    limits: FloatArray  #: (B, K) [N]

    @classmethod
    def of(
        cls, cup: Cup, friction: float, points: FloatArray, axes: FloatArray, *, origin: FloatArray
    ) -> CupWrenches:
        """Return those of cups at points (B, 3) [m] with outward axes (B, 3), in O.

        Torques are about an `origin` (3,) [m].
        """
        of_forces, of_moments, limits = _half_spaces(cup, friction, axes)
        arms = (points - origin)[:, None]
        forces = of_forces - cross(of_moments, arms)  # m about the lip is tau - arm x f
        rows = np.concatenate([forces, of_moments], axis=-1)
        return cls(rows, np.broadcast_to(limits, rows.shape[:2]))

    def spare_forces(self, weights: FloatArray) -> FloatArray:
        """Return the largest force, in any direction, that cups add to weights (M,) [N], (M, B).

        Both act at the origin; 0 where the weight alone is too large. +z points upwards.
        """
        left = self.limits - weights[:, None, None] * self.rows[..., 2]  # (M, B, K)
        distances = left / np.linalg.norm(self.rows[..., :3], axis=-1)
        return np.asarray(np.maximum(distances.min(axis=-1), 0.0))

    def epsilon(self, length: float) -> FloatArray:
        """Return the largest wrench, in any direction, of cups, (B,) [N].

        Torques count as forces at a length [m] from the origin.
        """
        scaled = self.rows * np.repeat([1.0, length], 3)
        return np.asarray((self.limits / np.linalg.norm(scaled, axis=-1)).min(axis=-1))


def _half_spaces(
    cup: Cup, friction: float, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the half-spaces of cups with axes (B, 3): of forces, of moments about the lip.

    Rows (B, K, 3) of both, and the limits (K,) [N].
    """
    angles = 2.0 * np.pi * np.arange(CONE_EDGES) / CONE_EDGES
    inside = float(np.cos(np.pi / CONE_EDGES))  # of a circle: the nearest points of its polygon
    frames = tangent_frame(axes)  # (B, 2, 3)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ frames  # (B, E, 3)
    along, none = np.broadcast_to(axes[:, None], ways.shape), np.zeros_like(ways)
    grip, twist = inside * friction, along / cup.radius
    shear, press, bend = ways + grip * along, inside * along, ways / cup.radius
    forces = np.concatenate([shear, shear, press, press], axis=1)
    moments = np.concatenate(
        [none + twist, none - twist, bend + twist / friction, bend - twist / friction], axis=1
    )
    limits = cup.pull * np.repeat([grip, grip, inside, inside], CONE_EDGES)
    return forces, moments, limits
