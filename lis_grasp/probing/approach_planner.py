"""Approach planning: hand posture, wrist pose and a straight collision-free approach to a probe."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, groupby
from operator import itemgetter

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.arms.reach import ArmPlace, ArmProbe, ProbeReach
from lis_grasp.arms.station import Station
from lis_grasp.exceptions import InvalidHandError
from lis_grasp.exploration.probe import Probe
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.geometry import apply_pose, make_pose, tangent_frame
from lis_grasp.probing.bodies_beside import POSE_SPACING, BodiesBeside
from lis_grasp.probing.exposure import SPACING, exposed_width
from lis_grasp.probing.keep_out import FREE, INSIDE, KeepOut, keep_out_of
from lis_grasp.records import Record
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import ProbePosture
from lis_grasp.typing import BoolArray, FloatArray

# Rotations about the finger, +x, shape (8, 3, 3).
_ROLLS = Rotation.from_rotvec(np.pi / 4.0 * np.arange(8)[:, None] * np.eye(3)[0]).as_matrix()


def _directions(*angles: float) -> FloatArray:
    """Return six directions (A, 3) around +x at each of some angles [rad] from it."""
    around = np.pi / 3.0 * np.arange(6)
    return np.array(
        [
            [np.cos(off), np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn)]
            for off in angles
            for turn in around
        ]
    )


# Finger directions oblique and perpendicular to the motion, +x; and tilted ones, which an arm often
# reaches where it does not reach the motion's direction.
_OBLIQUE, _TILTED = _directions(np.pi / 4.0, np.pi / 2.0), _directions(np.pi / 12.0, np.pi / 6.0)
# Low on an object's side the hand stays above a fingertip that points obliquely down.
_DOWN = np.deg2rad([45.0, 60.0, 75.0])

# Where an arm seeks the object, its end or its new place, it takes no approach that is more exposed
# than the least exposed one by this width [m]: another motion finds it by a fingertip.
_MORE_EXPOSED = 0.02
# Inner links keep this far off the estimate on a motion beyond its target [m].
_FARTHER = 0.005
# Number of axes that are tried before the oblique ones.
_FIRST = 1 + len(_TILTED)

# Spacing of points on the hand; links are thicker [m].
_SPACING = 0.015
NO_FREE_START = "no finger and roll of the hand is collision-free at the start"
NO_FREE_APPROACH = "no finger and roll of the hand has a collision-free straight approach"
OUT_OF_ARM_REACH = "the arm reaches no collision-free straight approach of the hand"


@dataclass(frozen=True, slots=True, eq=False)
class Approach(Record):
    """Pose of a hand at the start of a probe, and the straight path to that pose."""

    posture: ProbePosture  # the leading finger, and the positions of all joints
    X_OH: FloatArray  # (4, 4): pose of the palm at the start of the probe
    axis: FloatArray  # (3,), unit, in O: direction of the finger and of the approach
    distance: float  # length of the approach [m]
    arm: ArmProbe | None = None  # joint positions of the arm that carries the hand
    #: (4, 4) each: poses of a free hand from above all bodies beside the object to the approach
    way: tuple[FloatArray, ...] = ()

    @property
    def X_OH_outside(self) -> FloatArray:
        """Pose (4, 4) of the palm where the approach begins."""
        outside = self.X_OH.copy()
        outside[:3, 3] -= self.distance * self.axis
        return outside


class ApproachPlanner:
    """Plans approaches of a hand to probes.

    A hand in a probe posture is one rigid body with a leading finger. So its pose at a start
    follows in closed form from the direction of the finger and the roll about it. The finger
    points along the probe's motion. If that collides, as in a bore, it is oblique or perpendicular
    to the motion, and touches with its side. Without a probe posture, raises InvalidHandError.

    With a `station`, the approach and the probe's motion have to be within its arm's reach. Then
    fingers tilted by 15 and 30 degrees, and those turned down are tried before oblique ones. Only
    fingertips are to touch: other links keep out of the estimated object, and off it where the arm
    can (`KeepOut`). Probes are in its frame W. The hand keeps off the bodies `beside` the object on
    the approach and up to the probe's target; a free one needs a way to the approach, too.
    """

    def __init__(
        self,
        hand: Hand,
        station: Station | None = None,
        *,
        beside: BodiesBeside | None = None,
    ) -> None:
        self._beside = beside
        self._reach = None if station is None else ProbeReach(station)
        self._axes = _OBLIQUE if station is None else np.vstack([_TILTED, _OBLIQUE])
        if not hand.probe_postures:
            raise InvalidHandError(
                f"touching needs a probe posture; hand '{hand.name}' has none: add one to its YAML",
                key="probe_postures",
            )
        postures = hand.probe_postures.values()
        joints = [posture.joint_positions for posture in postures]
        points = points_on_links(hand, joints)
        self._bodies = [
            (posture, leading_center(hand, posture), points_H)
            for posture, points_H in zip(postures, points, strict=True)
        ]
        inner = points_on_links(hand, joints, hand.fingertip_links)
        tips = points_on_links(hand, joints, set(hand.links) - hand.fingertip_links)
        self._inner = {p.finger: points for p, points in zip(postures, inner, strict=True)}
        self._tips = {p.finger: points for p, points in zip(postures, tips, strict=True)}

    def place_station(self, station: Station) -> None:
        """Place the station in the frame of the probes."""
        self._reach = ProbeReach(station)

    def plan(self, probe: Probe, obstacles: ObstacleModel) -> Approach | None:
        """Return the first collision-free approach, or None."""
        found = self.find(probe, obstacles)
        return None if isinstance(found, str) else found

    def find(
        self, probe: Probe, obstacles: ObstacleModel, start: ArmPlace | None = None
    ) -> Approach | str:
        """Return the first collision-free approach, or why there is none.

        Of those along one axis, an arm takes the one nearest to its `start`; None for its home.
        """
        blocked = NO_FREE_APPROACH if self._reach is None else OUT_OF_ARM_REACH
        centers = [probe.start - posture.radius * probe.direction for posture, _, _ in self._bodies]
        if obstacles.occupies(np.array(centers)).all():
            return blocked
        keep_out, hits = keep_out_of(obstacles), list[tuple[ProbePosture, FloatArray]]()
        height = obstacles.space.support_height
        searches = height is not None and probe.direction[2] == 0.0
        searched: list[Approach] = []
        spare: list[list[Approach]] = []

        def reached(approaches: list[Approach]) -> Approach | None:
            if self._reach is None:
                return self._with_way(approaches, obstacles, hits)
            # Where an earlier probe passed with this pose, no other link touched.
            for passed in (True, False):
                some = [a for a in approaches if _is_on_passed_way(a, probe) == passed]
                if (found := self._reached(self._reach, some, probe, obstacles, start)) is not None:
                    return found
            return None

        for axis in self._axes_of(probe, searches):
            free: list[Approach] = []
            near: list[Approach] = []
            for approach in self._collision_free(axis, probe, obstacles, hits):
                level = self._nearness(approach, probe, keep_out)
                if level == FREE and self._reach is None and not searches:
                    if (found := reached([approach])) is not None:
                        return found
                elif level == FREE:
                    (searched if searches else free).append(approach)
                elif level < INSIDE or self._reach is None:
                    near.append(approach)
            spare.append(near)
            if (found := reached(free)) is not None:
                return found
        seeks = self._reach is not None and probe.purpose != "policy"
        most = _MORE_EXPOSED if seeks else np.inf
        exposed = self._least_exposed(searched, probe, height, most) if height is not None else ()
        for some in chain(exposed, spare):
            if (found := reached(some)) is not None:
                return found
        if not hits or self._beside is None:
            return blocked
        return f"{blocked}: {self._beside.in_the_way(*hits[0])} is in the way"

    def _axes_of(self, probe: Probe, searches: bool) -> FloatArray:
        """Return directions of the finger, and of the approach, in the order of trial, (A, 3)."""
        axes = np.vstack([probe.direction, self._axes @ rotation_to_x(probe.direction)])
        if self._reach is None and not searches:
            return axes
        return np.vstack([axes[:_FIRST], _turned_down(probe.direction), axes[_FIRST:]])

    def _collision_free(
        self,
        axis: FloatArray,
        probe: Probe,
        obstacles: ObstacleModel,
        hits: list[tuple[ProbePosture, FloatArray]],
    ) -> Iterator[Approach]:
        """Yield the collision-free approaches along an axis, and list what hits a body beside."""
        for posture, center_H, points_H in self._bodies:
            center = probe.start - posture.radius * probe.direction
            distance = float(obstacles.space.approach_distance(center, axis))
            rolled = list(_rolled(posture, center_H, probe, axis, distance))
            if self._beside is not None:
                ends = np.array([(a.X_OH, a.X_OH_outside) for a in rolled])  # (R, 2, 4, 4)
                hit = np.asarray(self._beside.overlaps(posture, ends)).any(axis=1)
                hits += [(posture, ends[k]) for k in np.flatnonzero(hit)[:1]]
                rolled = [rolled[k] for k in np.flatnonzero(np.logical_not(hit))]
                if not rolled:
                    continue
            points = apply_pose(np.array([a.X_OH for a in rolled]), points_H)  # (R, P, 3)
            for k in np.flatnonzero(~_collides(points, obstacles)):
                back = np.arange(POSE_SPACING, distance + POSE_SPACING, POSE_SPACING)
                offsets = np.minimum(back, distance)[:, None, None] * axis  # (S, 1, 3)
                if _collides(points[k] - offsets, obstacles).any():
                    continue
                approach = rolled[k]
                if self._beside is not None and self._beside.hits(
                    posture, path := _path(approach, probe)
                ):
                    hits.append((posture, path))
                    continue
                yield approach

    def _least_exposed(
        self, approaches: list[Approach], probe: Probe, height: float, most: float
    ) -> Iterator[list[Approach]]:
        """Yield the approaches to a level motion above a table, equally exposed ones at once.

        The least exposed are first, the last are at `most` more exposed than these [m].
        """

        def exposed(approach: Approach) -> float:
            inner, tips = (
                apply_pose(approach.X_OH, points[approach.posture.finger])
                for points in (self._inner, self._tips)
            )
            width = exposed_width(inner, tips, probe.direction, height)
            return float(np.round(width / SPACING))

        widths = [(exposed(approach), approach) for approach in approaches]
        least = min((width for width, _ in widths), default=0.0)
        widths = [(width, a) for width, a in widths if width <= least + most / SPACING]
        for _, equal in groupby(sorted(widths, key=itemgetter(0)), itemgetter(0)):
            yield [approach for _, approach in equal]

    def _with_way(
        self,
        approaches: list[Approach],
        obstacles: ObstacleModel,
        hits: list[tuple[ProbePosture, FloatArray]],
    ) -> Approach | None:
        """Return the first approach that a free hand has a way to, and list those without one."""
        if self._beside is None:
            return approaches[0] if approaches else None
        for approach in approaches:
            posture, outside = approach.posture, approach.X_OH_outside
            way = self._beside.way_out(posture, outside, -approach.axis, obstacles.space)
            if way is not None:
                return replace(approach, way=tuple(way[::-1]))
            hits.append((posture, outside[None]))
        return None

    def _nearness(self, approach: Approach, probe: Probe, keep_out: KeepOut) -> int:
        """Return how near the links other than fingertips come to the estimate on the motion."""
        if not keep_out.is_known:
            return FREE
        points = apply_pose(approach.X_OH, self._inner[approach.posture.finger])  # (P, 3)
        length = probe.standoff + min(probe.overshoot, _FARTHER)
        ahead = np.append(np.arange(0.0, length, POSE_SPACING), length)[:, None] * probe.direction
        back = np.arange(POSE_SPACING, approach.distance, POSE_SPACING)[:, None] * approach.axis
        return keep_out.nearness(points + np.vstack([ahead, -back])[:, None])

    def _reached(
        self,
        reach: ProbeReach,
        approaches: list[Approach],
        probe: Probe,
        obstacles: ObstacleModel,
        start: ArmPlace | None,
    ) -> Approach | None:
        """Return one of the approaches that the arm can follow, the nearest to its start."""
        if not approaches:
            return None
        reached = reach.first(
            np.array([approach.X_OH for approach in approaches]),
            np.array([approach.posture.joint_positions for approach in approaches]),
            approach=np.array([approach.distance * approach.axis for approach in approaches]),
            motion=(probe.standoff + probe.overshoot) * probe.direction,
            occupied=obstacles.occupies,
            start=start,
        )
        return None if reached is None else replace(approaches[reached[0]], arm=reached[1])

    def starts(self, probe: Probe) -> Iterator[Approach]:
        """Yield every hand at the start of a probe, without an approach and without a check."""
        for posture, center_H, _ in self._bodies:
            yield from _rolled(posture, center_H, probe, probe.direction, 0.0)


def _is_on_passed_way(approach: Approach, probe: Probe) -> bool:
    """Return whether an earlier probe made this motion, with this pose of the hand."""
    way = probe.passed
    return way is not None and way.length_from(approach.X_OH, probe.direction) > 0.0


def _path(approach: Approach, probe: Probe) -> FloatArray:
    """Return poses of the hand (W, 4, 4) on an approach and the motion to its target.

    The motion beyond the target may end before a body.
    """
    back = np.arange(-approach.distance, 0.0, POSE_SPACING)[:, None] * approach.axis
    length = probe.standoff + min(probe.overshoot, _FARTHER)
    ahead = np.append(np.arange(0.0, length, POSE_SPACING), length)[:, None] * probe.direction
    path = np.repeat(approach.X_OH[None], len(back) + len(ahead), axis=0)
    path[:, :3, 3] += np.vstack([back, ahead])
    return path


def _collides(points: FloatArray, obstacles: ObstacleModel) -> BoolArray:
    """Return which of the hand's poses, with points (R, P, 3), collide, shape (R,)."""
    occupied = obstacles.occupies(points.reshape(-1, 3))
    return np.asarray(occupied.reshape(points.shape[:2]).any(axis=1))


def _rolled(
    posture: ProbePosture, center_H: FloatArray, probe: Probe, axis: FloatArray, distance: float
) -> Iterator[Approach]:
    """Yield the approach for each roll about the axis, the leading point at the probe's start."""
    center_O = probe.start - posture.radius * probe.direction
    R_OX, R_XH = rotation_to_x(axis).T, rotation_to_x(posture.direction_H)
    for roll in _ROLLS:
        R_OH = R_OX @ roll @ R_XH
        yield Approach(posture, make_pose(R_OH, center_O - R_OH @ center_H), axis, distance)


def _turned_down(direction: FloatArray) -> FloatArray:
    """Return directions (A, 3) between a motion's, (3,), and straight down."""
    down = np.array([0.0, 0.0, -1.0])
    across = down - (down @ direction) * direction
    length = float(np.linalg.norm(across))
    if length < 1e-6:
        return np.empty((0, 3))
    angles = _DOWN[np.cos(_DOWN) > down @ direction, None]
    return np.asarray(np.cos(angles) * direction + np.sin(angles) * (across / length))


def leading_center(hand: Hand, posture: ProbePosture) -> FloatArray:
    """Return the leading sphere's centre, (3,), in H [m]."""
    links = hand.forward_kinematics(np.eye(4), posture.joint_positions)
    return apply_pose(links[posture.link], posture.center_L)


def rotation_to_x(direction: FloatArray) -> FloatArray:
    """Return a rotation, shape (3, 3), that takes the unit `direction` to +x."""
    return np.vstack([direction, tangent_frame(direction)])


def points_on_links(
    hand: Hand, postures: Iterable[FloatArray], left_out: Collection[str] = ()
) -> list[FloatArray]:
    """Return points on a hand's links, at most 15 mm apart, (P, 3), in H [m], for postures (J,)."""
    bodies = [
        (body.link, apply_pose(body.X_LG, body.mesh.subdivide_to_size(_SPACING).vertices))
        for body in hand.link_geometries
        if body.link not in left_out
    ]
    every = []
    for posture in postures:
        links = hand.forward_kinematics(np.eye(4), posture)
        points = [apply_pose(links[link], points_L) for link, points_L in bodies]
        joined = np.concatenate([np.empty((0, 3)), *points])
        # One point in each cell of half the spacing is enough.
        _, first = np.unique(np.round(2.0 * joined / _SPACING), axis=0, return_index=True)
        every.append(joined[np.sort(first)])
    return every
