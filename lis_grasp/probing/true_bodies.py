"""True bodies beside the object, which end the motion of a hand as the object does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lis_grasp.geometry import apply_pose, inverse_pose, rotate
from lis_grasp.robots.collision import HandCollisionChecker, NearestLink
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray
from lis_grasp.world import Surroundings


class TrueBodies:
    """Bodies beside the object, to which distances of a hand are exact.

    They are in W, poses and motions of the hand in the frame E of the probes.
    """

    def __init__(self, hand: Hand, surroundings: Surroundings) -> None:
        self._hand, self._X_WE = hand, np.eye(4)
        self._build(surroundings)

    def place(self, surroundings: Surroundings) -> None:
        """Place the bodies where these are, in W."""
        if surroundings is not self._surroundings:
            self._build(surroundings)

    def _build(self, surroundings: Surroundings) -> None:
        self._surroundings = surroundings
        self._mesh = surroundings.mesh
        self._checker = HandCollisionChecker(self._hand, self._mesh)
        self._ends = np.cumsum([len(body.mesh.faces) for body in surroundings])

    def place_frame(self, X_WE: FloatArray) -> None:
        """Give later poses in a frame E with pose X_WE, shape (4, 4)."""
        self._X_WE = X_WE

    def place_hand(self, X_EH: FloatArray, poses: FloatArray) -> bool:
        """Place the hand for `nearest`; return whether it meets the surface of a body.

        `poses` (G, 4, 4) are those of `HandCollisionChecker.poses_in_hand`.
        """
        return self._checker.place(self._X_WE @ X_EH, poses)

    def met_at(self, X_EH: FloatArray, poses: FloatArray, balls: FloatArray) -> str | None:
        """Place the hand; return the body that a link touches or is in, None if none does.

        `balls` (S, 4) are centres in H and radii [m] of balls inside the links.
        """
        X_WH, meets = self._X_WE @ X_EH, self.place_hand(X_EH, poses)
        depths = self._surroundings.distances(apply_pose(X_WH, balls[:, :3])) - balls[:, 3:]
        nearest = depths.min(axis=0)
        if not meets and nearest.min() > 0.0:
            return None
        return self._surroundings.bodies[int(nearest.argmin())].name

    def distance(self, moved: FloatArray) -> float:
        """Return the distance to a body after moving the placed hand by (3,) [m]."""
        return self._checker.distance(rotate(self._X_WE, moved))

    def nearest(self, moved: FloatArray) -> NearestLink:
        """Return the link nearest to a body after moving the placed hand by (3,) [m].

        Its point is in E.
        """
        link = self._checker.nearest(rotate(self._X_WE, moved))
        body = self._surroundings.bodies[int(np.searchsorted(self._ends, link.face, side="right"))]
        return replace(link, point=apply_pose(inverse_pose(self._X_WE), link.point), body=body.name)

    def normal(self, face: int) -> FloatArray:
        """Return the normal of a triangle, shape (3,), in E."""
        assert self._mesh is not None
        return rotate(inverse_pose(self._X_WE), self._mesh.face_normals[face])
