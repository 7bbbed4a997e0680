"""Planner of antipodal grasps for grippers of two fingers, a baseline of the track of planners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from lis_grasp import Grasp, Hand
from lis_grasp.geometry import cross, make_pose, unit
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.shapes.object_mass import USUAL_FRICTION
from lis_grasp.typing import FloatArray, Seed

_SAMPLES = 400  # points that are drawn on the surface
_TILTS = np.radians([0.0, 30.0, -30.0, 60.0, -60.0])  # of the approach from the steepest
_BATCH = 50  # poses that are checked at once
_LEAST_WIDTH = 0.002  # between the two points [m]
_DOWN = np.array([0.0, 0.0, -1.0])


class AntipodalPlanner:
    """Grasps where two points face each other best (Mahler et al. 2016, section IV.B).

    Points are drawn on the surface. The jaws close along the normal of each, if the line leaves the
    object inside the friction cone of the point that it leaves at. Of these pairs the one whose
    normals are opposed best is first, of equals the one that the hand approaches most steeply. What
    `ForceClosureSampler.at` rejects is left out; its ranking is not used.

    Parameters
    ----------
    hand
        A gripper of two fingers.

    Examples
    --------
    >>> planner = AntipodalPlanner(Hand.load("wsg50"))
    >>> len(planner.sample(shapes.find("box").mesh, count=2))
    2
    """

    def __init__(self, hand: Hand) -> None:
        posture = max(hand.pregrasps.values(), key=lambda q: self._opening(hand, q))
        self._first, self._second = hand.pad_centers(np.eye(4), posture)
        self._hand = hand
        self.widest = float(np.linalg.norm(self._second - self._first))

    def sample(
        self,
        mesh: trimesh.Trimesh,
        *,
        rng: Seed = 0,
        support_height: float | None = None,
        count: int = 10,
    ) -> list[Grasp]:
        """Return up to `count` grasps, the best first; arguments as of `ForceClosureSampler`."""
        sampler, grasps = ForceClosureSampler(self._hand), list[Grasp]()
        every = self._poses(mesh, np.random.default_rng(rng))
        for start in range(0, len(every), _BATCH):
            poses = every[start : start + _BATCH]
            found = sampler.at(mesh, poses, support_height=support_height)
            grasps += _in_order(found, poses)
            if len(grasps) >= count:
                break
        return grasps[:count]

    def _poses(self, mesh: trimesh.Trimesh, rng: np.random.Generator) -> list[FloatArray]:
        """Return palm poses (4, 4), those of the best pair first."""
        points, faces = trimesh.sample.sample_surface(mesh, _SAMPLES, seed=rng)
        inward = -np.asarray(mesh.face_normals)[faces]
        hits, lines, left = mesh.ray.intersects_location(points, inward, multiple_hits=True)
        widths = ((hits - points[lines]) * inward[lines]).sum(axis=1)
        opposed = (np.asarray(mesh.face_normals)[left] * inward[lines]).sum(axis=1)
        cone = 1.0 / np.hypot(1.0, USUAL_FRICTION)
        kept = np.flatnonzero((widths > _LEAST_WIDTH) & (widths < self.widest) & (opposed > cone))
        return [
            self._pose(0.5 * (points[lines[k]] + hits[k]), inward[lines[k]], tilt)
            for k in kept[np.argsort(-opposed[kept].round(3), kind="stable")]
            for tilt in _TILTS
        ]

    def _pose(self, middle: FloatArray, closing: FloatArray, tilt: float) -> FloatArray:
        """Return the pose in which the jaws close along a direction about a point."""
        approach = unit(_DOWN - closing * (_DOWN @ closing), least=1e-9)
        approach = np.cos(tilt) * approach + np.sin(tilt) * cross(closing, approach)
        of_palm = _frame(unit(self._second - self._first), self._hand.approach_H)
        R_OH = _frame(closing, approach) @ of_palm.T
        return make_pose(R_OH, middle - R_OH @ (0.5 * (self._first + self._second)))

    @staticmethod
    def _opening(hand: Hand, q: FloatArray) -> float:
        first, second = hand.pad_centers(np.eye(4), q)
        return float(np.linalg.norm(second - first))


def _in_order(grasps: Sequence[Grasp], poses: Sequence[FloatArray]) -> list[Grasp]:
    """Return grasps in the order of the poses that their palms are nearest to."""
    apart = [np.abs(np.array(poses) - grasp.pose).sum(axis=(1, 2)) for grasp in grasps]
    return [grasps[k] for k in np.argsort([way.argmin() for way in apart], kind="stable")]


def _frame(closing: FloatArray, approach: FloatArray) -> FloatArray:
    """Return the rotation whose columns are two directions at right angles and their normal."""
    return np.column_stack([closing, approach, cross(closing, approach)])
