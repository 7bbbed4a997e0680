"""Extension of the other fingers after a touch, each until it touches too."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import trimesh

from lis_grasp.exploration.probe import PROBE_SPEED, TRANSIT_SPEED
from lis_grasp.hands.collision import HandCollisionChecker, NearestLink
from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_parts import Joint
from lis_grasp.probing.guarded_motion import TOUCHING
from lis_grasp.typing import FloatArray

# Points on a pad's path, for its length.
_PATH_POINTS = 33
# Least step of an extension, as a fraction of all of it, so that grazing motions end.
_LEAST_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Extension:
    """Extension of one finger."""

    joints: list[int]  # that moved, K of them
    positions: FloatArray  # (K,), at the end
    length: float  # of the path of the finger's pad [m]
    touched: NearestLink | None  # the link that touches the object, and where

    @property
    def until_contact(self) -> float:
        """Time up to the end of the motion [s]."""
        return self.length / PROBE_SPEED

    @property
    def duration(self) -> float:
        """Time of the motion and back [s]."""
        return self.until_contact + self.length / TRANSIT_SPEED


class FingerExtender:
    """Moves fingers towards the postures in which they lead, until a link touches.

    The palm and all other fingers rest. Conservative advancement (Mirtich 1996) over the joints: a
    finger's point moves at most by the joints' motions times their distances from the farthest
    point. So each step is as long as the distance to the object allows. Only joints that no other
    finger shares move. Distances are python-fcl's, on the exact, watertight mesh.
    """

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh) -> None:
        self._hand = hand
        owners = hand.link_fingers
        shared = [joint for finger in hand.fingers for joint in hand.finger_joints(finger)]
        self._fingers = {}
        for finger, posture in hand.probe_postures.items():
            links = tuple(g for g in hand.link_geometries if owners.get(g.link) == finger)
            joints = [j for j in hand.finger_joints(finger) if shared.count(j) == 1]
            if links and joints:
                alone = replace(hand, link_geometries=links)
                radii = np.array([_largest_radius(alone, joint) for joint in joints])
                checker = HandCollisionChecker(alone, mesh)
                self._fingers[finger] = checker, joints, posture.joint_positions[joints], radii

    def extend(self, X_OH: FloatArray, q: FloatArray, *, but: str | None) -> list[Extension]:
        """Extend every finger but the one that touches (None: the palm), each from q, shape (J,).

        X_OH, shape (4, 4), is the pose of the palm in O.
        """
        return [self._extend(finger, X_OH, q) for finger in self._fingers if finger != but]

    def _extend(self, finger: str, X_OH: FloatArray, q: FloatArray) -> Extension:
        checker, joints, goal, radii = self._fingers[finger]
        motion = goal - q[joints]
        bound = float(np.abs(motion) @ radii)  # of any point's path [m]
        if bound == 0.0:
            return Extension(joints, goal, 0.0, None)
        lengths = self._pad_path(finger, X_OH, q, goal)
        part, posture, touched = 0.0, q.copy(), None
        while True:
            posture[joints] = q[joints] + part * motion
            checker.place(X_OH, checker.poses_in_hand(posture))
            nearest = checker.nearest(np.zeros(3))
            if nearest.distance < TOUCHING:
                touched = nearest
            if touched is not None or part >= 1.0:
                length = float(np.interp(part, np.linspace(0.0, 1.0, _PATH_POINTS), lengths))
                return Extension(joints, posture[joints], length, touched)
            part = min(part + max(nearest.distance / bound, _LEAST_STEP), 1.0)

    def _pad_path(
        self, finger: str, X_OH: FloatArray, q: FloatArray, goal: FloatArray
    ) -> FloatArray:
        """Return the path length [m] of a pad at even parts of the motion, (_PATH_POINTS,)."""
        joints = self._fingers[finger][1]
        parts = np.linspace(0.0, 1.0, _PATH_POINTS)
        postures = np.tile(q, (_PATH_POINTS, 1))
        postures[:, joints] += parts[:, None] * (goal - q[joints])
        pad = self._hand.fingers.index(finger)
        places = self._hand.pad_centers(X_OH, postures)[:, pad]  # (_PATH_POINTS, 3)
        return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))


def _largest_radius(hand: Hand, index: int) -> float:
    """Return the largest motion of any point of the hand's bodies by a joint [m/rad or m/m].

    Joints that follow it count too.
    """
    return sum(
        abs(joint.multiplier) * _radius_about(hand, joint)
        for joint in hand.joints
        if joint.index == index
    )


def _radius_about(hand: Hand, moved: Joint) -> float:
    if moved.kind == "prismatic":
        return 1.0
    by_child = {joint.child: joint for joint in hand.joints}
    radius = 0.0
    for geometry in hand.link_geometries:
        corners = trimesh.transform_points(geometry.mesh.vertices, geometry.X_LG)
        length = float(np.linalg.norm(corners, axis=1).max())
        link = geometry.link
        while link in by_child and link != moved.child:
            length += float(np.linalg.norm(by_child[link].X_PJ[:3, 3]))
            link = by_child[link].parent
        if link == moved.child:
            radius = max(radius, length)
    return radius
