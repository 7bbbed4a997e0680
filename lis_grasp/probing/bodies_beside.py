"""Bodies beside the object that a hand's motion meets, and its way between them and outside."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping

import numpy as np

from lis_grasp.exploration.workspace import Workspace
from lis_grasp.geometry import AXES, apply_pose
from lis_grasp.robots.body_pairs import balls_around
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_bodies import balls_inside
from lis_grasp.robots.robot_model import LinkGeometry, ProbePosture
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.world import Surroundings

POSE_SPACING = 0.01
"""Spacing of the hand's poses along a motion; links are thicker [m]."""

# The same of poses where balls around the links overlap a body: a corner may pass between.
_FINE = 0.002

# A hand outside is this far above all bodies [m].
_ABOVE = 0.02
# Steps of a way that turns, and most places that are tried [m].
_STEP, _MOST = 0.06, 400


class BodiesBeside:
    """Known bodies beside the object, which a hand in a probe posture keeps off.

    They are in W, poses of the hand in the frame E of the probes. Balls inside the links find most
    hits from the distance to the bodies, balls around them most free poses; FCL decides the others.
    """

    def __init__(self, hand: Hand, surroundings: Surroundings) -> None:
        self._hand, self._bodies = hand, surroundings
        self._X_WE = np.eye(4)
        postures = hand.probe_postures.values()
        self._balls = {p.finger: _balls(hand, p, balls_inside) for p in postures}
        self._covers = {p.finger: _balls(hand, p, balls_around) for p in postures}
        self._build()

    def _build(self) -> None:
        self._checker = HandCollisionChecker(self._hand, obstacles=self._bodies.mesh)
        #: height of the highest body in W [m]
        self.top = max(float(body.mesh.bounds[1, 2]) for body in self._bodies)

    def place_frame(self, X_WE: FloatArray) -> None:
        """Give later poses in the frame E with pose X_WE (4, 4)."""
        self._X_WE = X_WE

    def place(self, poses: Mapping[str, FloatArray]) -> None:
        """Place bodies at poses (4, 4) in W, by their names."""
        bodies = self._bodies.placed(poses)
        if bodies is not self._bodies:
            self._bodies = bodies
            self._build()

    def hits(self, posture: ProbePosture, path: FloatArray) -> bool:
        """Return whether a hand hits a body at one of the poses (W, 4, 4)."""
        if self.overlaps(posture, path).any():
            return True
        near = self._near(self._covers[posture.finger], path)
        if not near.any():
            return False
        path = self._X_WE @ _refined(path, near)
        return bool(self._checker.hit_obstacle(path[None], posture.joint_positions[None])[0])

    def are_hit(self, postures: FloatArray, path: FloatArray) -> bool:
        """Return whether a hand in any of postures (N, J) hits a body at a pose of (W, 4, 4)."""
        paths = np.broadcast_to(self._X_WE @ path, (len(postures), *path.shape))
        return bool(self._checker.hit_obstacle(paths, postures).any())

    def free_length(
        self, posture: ProbePosture, X_EH: FloatArray, direction: FloatArray, length: float
    ) -> float:
        """Return how far a hand moves along a direction before it hits a body, up to a length."""
        steps = np.append(np.arange(0.0, length, POSE_SPACING), length)
        for k, step in enumerate(steps):
            if self.hits(posture, _moved(X_EH, step * direction)[None]):
                return float(steps[max(k - 1, 0)])
        return length

    def in_the_way(self, posture: ProbePosture, path: FloatArray) -> str:
        """Return the name of the body that a hand hits deepest on a path (W, 4, 4)."""
        balls = self._balls[posture.finger]
        centers = apply_pose(self._X_WE @ path, balls[:, :3]).reshape(-1, 3)
        apart = self._bodies.distances(centers) - np.tile(balls[:, 3], len(path))[:, None]
        return self._bodies.bodies[int(apart.min(axis=0).argmin())].name

    def way_out(
        self, posture: ProbePosture, X_EH: FloatArray, back: FloatArray, space: Workspace
    ) -> list[FloatArray] | None:
        """Return poses (4, 4) from a pose to one above all bodies, where the hand can turn.

        The hand does not turn on the way. It goes straight up, or first straight back or to a side;
        else around corners, by A* on a lattice. None if there is no way. It keeps off the object's
        ball where it begins outside of it.
        """
        free = self._keeps_off(posture, space)
        rise = self._rise(posture, X_EH)
        up = np.array([0.0, 0.0, rise])
        if self._goes(posture, X_EH, up, free):
            return [X_EH, _moved(X_EH, up)]
        for direction in [back, *AXES[AXES[:, 2] == 0.0]]:
            far = self._extent(posture) * direction
            around = _moved(X_EH, far)
            lifted = np.array([0.0, 0.0, max(self._rise(posture, around), 0.0)])
            if self._goes(posture, X_EH, far, free) and self._goes(posture, around, lifted, free):
                return [X_EH, around, _moved(around, lifted)]
        return self._around(posture, X_EH, free)

    def _around(
        self, posture: ProbePosture, X_EH: FloatArray, free: Callable[[FloatArray], bool]
    ) -> list[FloatArray] | None:
        """Return a way of steps along the axes, by A* (Hart, Nilsson and Raphael 1968)."""
        start: tuple[int, ...] = (0, 0, 0)
        queue = [(self._rise(posture, X_EH), start)]
        before: dict[tuple[int, ...], tuple[int, ...] | None] = {start: None}
        cost = {start: 0}
        for _ in range(_MOST):
            if not queue:
                return None
            _, at = heapq.heappop(queue)
            here = _moved(X_EH, _STEP * np.array(at))
            left = self._rise(posture, here)
            if left <= 0.0:
                way: list[FloatArray] = []
                last: tuple[int, ...] | None = at
                while last is not None:
                    way.append(_moved(X_EH, _STEP * np.array(last)))
                    last = before[last]
                return way[::-1]
            for step in AXES.astype(int):
                after = tuple(int(k) for k in np.array(at) + step)
                if after in before or not self._goes(posture, here, _STEP * step, free):
                    continue
                before[after], cost[after] = at, cost[at] + 1
                rise = self._rise(posture, _moved(here, _STEP * step))
                heapq.heappush(queue, (_STEP * cost[after] + rise, after))
        return None

    def _goes(
        self,
        posture: ProbePosture,
        X_EH: FloatArray,
        motion: FloatArray,
        free: Callable[[FloatArray], bool],
    ) -> bool:
        """Return whether a hand can move straight by a vector (3,) [m]."""
        length = float(np.linalg.norm(motion))
        parts = np.linspace(0.0, 1.0, int(np.ceil(length / POSE_SPACING)) + 1)[1:]
        path = np.repeat(X_EH[None], len(parts), axis=0)
        path[:, :3, 3] += parts[:, None] * motion
        return not len(path) or (free(path) and not self.hits(posture, path))

    def _keeps_off(self, posture: ProbePosture, space: Workspace) -> Callable[[FloatArray], bool]:
        """Return the check that a path is above the table, and no deeper in the object's ball."""
        balls, height = self._balls[posture.finger], space.support_height

        def free(path: FloatArray) -> bool:
            centers = apply_pose(path, balls[:, :3])  # (W, S, 3)
            if height is not None and (centers[..., 2] - balls[:, 3]).min() < height:
                return False
            inside = space.radius - np.linalg.norm(centers - space.center, axis=-1)
            return bool((inside.max(axis=1) <= max(float(inside[0].max()), 0.0) + 1e-9).all())

        return free

    def _rise(self, posture: ProbePosture, X_EH: FloatArray) -> float:
        """Return how far a hand is to rise until it is above all bodies, or beside them [m]."""
        balls = self._balls[posture.finger]
        lowest = apply_pose(self._X_WE @ X_EH, balls[:, :3])[:, 2] - balls[:, 3]
        return max(self.top + _ABOVE - float(lowest.min()), 0.0)

    def _extent(self, posture: ProbePosture) -> float:
        """Return a length by which a hand leaves all bodies sideways [m]."""
        low, high = (
            np.min([body.mesh.bounds[0] for body in self._bodies], axis=0),
            np.max([body.mesh.bounds[1] for body in self._bodies], axis=0),
        )
        reach = float(np.linalg.norm(self._balls[posture.finger][:, :3], axis=1).max())
        return float((high - low)[:2].max()) + reach

    def overlaps(self, posture: ProbePosture, poses: FloatArray) -> BoolArray:
        """Return at which poses (..., 4, 4) a ball inside the hand overlaps a body, shape (...)."""
        return self._near(self._balls[posture.finger], poses)

    def _near(self, balls: FloatArray, poses: FloatArray) -> BoolArray:
        """Return at which poses (..., 4, 4) one of balls (S, 4) in H overlaps a body, (...)."""
        X_WH = (self._X_WE @ poses).reshape(-1, 4, 4)
        middle = balls[:, :3].mean(axis=0)
        reach = np.max(np.linalg.norm(balls[:, :3] - middle, axis=1) + balls[:, 3])
        near = (self._bodies.distances(apply_pose(X_WH, middle)) < reach).any(axis=1)
        centers = apply_pose(X_WH[near], balls[:, :3])
        apart = self._bodies.distances(centers.reshape(-1, 3)).min(axis=1)
        near[near] = (apart.reshape(centers.shape[:-1]) < balls[:, 3]).any(axis=-1)
        return np.asarray(near.reshape(poses.shape[:-2]))


def _refined(path: FloatArray, near: BoolArray) -> FloatArray:
    """Return the poses of a path (W, 4, 4) that are near, and more on the motions from or to them.

    Motions of at most `POSE_SPACING` are straight, and turn nothing.
    """
    motions = np.diff(path[:, :3, 3], axis=0)
    close = np.linalg.norm(motions, axis=1) < POSE_SPACING + 1e-9
    begin = np.flatnonzero(close & (near[1:] | near[:-1]))
    parts = np.arange(_FINE, POSE_SPACING - 1e-9, _FINE) / POSE_SPACING
    between = np.repeat(path[begin], len(parts), axis=0)
    between[:, :3, 3] += (parts[:, None] * motions[begin, None]).reshape(-1, 3)
    return np.concatenate([path[near], between])


def _moved(X: FloatArray, motion: FloatArray) -> FloatArray:
    moved = X.copy()
    moved[:3, 3] += motion
    return moved


def balls_in_links(hand: Hand, posture: ProbePosture) -> FloatArray:
    """Return balls inside a hand's links in a posture, centres in H and radii [m], (S, 4)."""
    return _balls(hand, posture, balls_inside)


def _balls(
    hand: Hand,
    posture: ProbePosture,
    balls_of: Callable[[LinkGeometry], tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """Return balls in or around a hand's links in a posture, (S, 4)."""
    links = hand.forward_kinematics(np.eye(4), posture.joint_positions)
    balls = []
    for geometry in hand.link_geometries:
        centers, radii = balls_of(geometry)
        centers_H = apply_pose(links[geometry.link] @ geometry.X_LG, centers)
        balls.append(np.column_stack([centers_H, radii]))
    return np.concatenate(balls)
