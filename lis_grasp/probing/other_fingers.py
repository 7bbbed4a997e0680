"""More touches of one approach: the fingers that did not lead stretch out until they touch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import trimesh

from lis_grasp.exploration.motion_time import PROBE_SPEED, TRANSIT_SPEED
from lis_grasp.hands.collision import HandCollisionChecker, NearestLink
from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_parts import Joint
from lis_grasp.probing.guarded_motion import TOUCHING
from lis_grasp.typing import FloatArray

# Of a pad's way, for its length.
_PATH_POINTS = 33
# Of its way, a finger goes on at least by this, so that a graze comes to an end.
_LEAST_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Stretching:
    """What came of a finger that stretched out.

    Parameters
    ----------
    met
        The link that touches the object, and where; None where nothing was met.
    length
        How far the finger's pad has gone [m].
    joints, positions
        The joints that moved, and where they are at the end, shapes (K,).
    """

    met: NearestLink | None
    length: float
    joints: list[int]
    positions: FloatArray

    @property
    def until_contact(self) -> float:
        """Time of the motion to where it ended [s]."""
        return self.length / PROBE_SPEED

    @property
    def duration(self) -> float:
        """Time of the motion, there and back [s]."""
        return self.until_contact + self.length / TRANSIT_SPEED


class OtherFingers:
    """Stretches fingers out towards the posture in which they would lead, until a link touches.

    The palm and all other fingers rest. Conservative advancement (Mirtich 1996) over the joints: no
    point of a finger moves faster than the joints' speeds times their distances from the farthest
    point, so it is as far as the distance to the object allows. Only joints that no other finger
    hangs on move. Distances are python-fcl's, on the exact mesh.

    Parameters
    ----------
    hand
        The hand.
    mesh
        The true object in O [m], watertight.
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
                reaches = np.array([_reach(alone, joint) for joint in joints])
                checker = HandCollisionChecker(alone, mesh)
                self._fingers[finger] = checker, joints, posture.joint_positions[joints], reaches

    def stretch(self, X_OH: FloatArray, q: FloatArray, *, but: str | None) -> list[Stretching]:
        """Stretch out every finger but one, each from joint positions q, shape (J,).

        Parameters
        ----------
        X_OH
            Shape (4, 4), pose of the palm in O.
        q
            Shape (J,), where all fingers are.
        but
            The finger that touches already; None where the palm does.
        """
        return [self._stretch(finger, X_OH, q) for finger in self._fingers if finger != but]

    def _stretch(self, finger: str, X_OH: FloatArray, q: FloatArray) -> Stretching:
        checker, joints, goal, reaches = self._fingers[finger]
        way = goal - q[joints]
        length = float(np.abs(way) @ reaches)
        if length == 0.0:
            return Stretching(None, 0.0, joints, goal)
        share, posture = 0.0, q.copy()
        gone = self._pad_path(finger, X_OH, q, goal)
        while True:
            posture[joints] = q[joints] + share * way
            checker.place(X_OH, checker.poses_in_hand(posture))
            nearest = checker.nearest(np.zeros(3))
            if nearest.distance < TOUCHING:
                return Stretching(nearest, gone(share), joints, posture[joints])
            if share >= 1.0:
                return Stretching(None, gone(1.0), joints, goal)
            share = min(share + max(nearest.distance / length, _LEAST_STEP), 1.0)

    def _pad_path(
        self, finger: str, X_OH: FloatArray, q: FloatArray, goal: FloatArray
    ) -> Callable[[float], float]:
        """Return how long a way [m] a finger's pad has gone, after a share of the joints' way."""
        joints = self._fingers[finger][1]
        shares = np.linspace(0.0, 1.0, _PATH_POINTS)
        postures = np.tile(q, (len(shares), 1))
        postures[:, joints] += shares[:, None] * (goal - q[joints])
        pad = self._hand.fingers.index(finger)
        places = self._hand.pad_centers(X_OH, postures)[:, pad]  # (_PATH_POINTS, 3)
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        gone = np.append(0.0, np.cumsum(steps))
        return lambda share: float(np.interp(share, shares, gone))


def _reach(hand: Hand, index: int) -> float:
    """Return how far a joint moves any point of the hand's bodies, at the most [m per rad or m].

    Joints that follow it count too.
    """
    return sum(
        abs(joint.multiplier) * _reach_of(hand, joint)
        for joint in hand.joints
        if joint.index == index
    )


def _reach_of(hand: Hand, moved: Joint) -> float:
    if moved.kind == "prismatic":
        return 1.0
    by_child = {joint.child: joint for joint in hand.joints}
    reach = 0.0
    for geometry in hand.link_geometries:
        corners = trimesh.transform_points(geometry.mesh.vertices, geometry.X_LG)
        length = float(np.linalg.norm(corners, axis=1).max())
        link = geometry.link
        while link in by_child and link != moved.child:
            length += float(np.linalg.norm(by_child[link].X_PJ[:3, 3]))
            link = by_child[link].parent
        if link == moved.child:
            reach = max(reach, length)
    return reach
