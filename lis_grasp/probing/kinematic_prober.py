"""Kinematic prober: touch a fixed object by geometry alone, without forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.contacts import Contacts
from lis_grasp.exploration.disturbance import Disturbance
from lis_grasp.exploration.probe import HandPose, Probe, ProbeOutcome
from lis_grasp.exploration.probe_motions import PROBE_SPEED, TRANSIT_SPEED
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.geometry import apply_pose
from lis_grasp.probing.guarded_motion import TOUCHING, GuardedMotion
from lis_grasp.probing.true_bodies import TrueBodies
from lis_grasp.robots.collision import HandCollisionChecker, NearestLink
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import Joint
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

Fingers = Literal["one", "all"]

# Points on a pad's path that measure its length.
_PATH_POINTS = 33
# Least step of an extension, as a fraction of the whole, so that grazing motions end.
_LEAST_STEP = 1e-4


class KinematicProber:
    """Probes by geometry alone: ten times faster than `DynamicProber`, without forces.

    The hand moves until its first link touches (`GuardedMotion`). The contact is the point of the
    object that the link touches, with the normal of the triangle there. With `fingers` ``"one"``
    the first touch ends a probe. With ``"all"`` the others then extend, and each that touches adds
    a contact. With a `station`, probes must be within the reach of its arm. `surroundings` are the
    true bodies beside the object, `known` those that the approach avoids.

    Raises `InvalidHandError` if the hand has no probe posture, `InvalidMeshError` if the mesh of
    the true object in O [m] is not watertight.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        *,
        fingers: Fingers = "one",
        station: Station | None = None,
        surroundings: Surroundings = ALONE,
        known: Surroundings = ALONE,
    ) -> None:
        self._motion = GuardedMotion(hand, mesh, station, surroundings=surroundings, known=known)
        self._extender = FingerExtender(hand, mesh, surroundings) if fingers == "all" else None
        self._link_fingers = hand.link_fingers
        self._felt: dict[str, int] = {}

    @property
    def disturbance(self) -> Disturbance:
        """Contacts so far with the bodies beside the object, which do not move."""
        return Disturbance(self._felt)

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        """Carry out one probe; see `Prober`."""
        if self._extender is not None:  # other fingers would slide, too
            probe = replace(probe, slides=probe.slides[:0])
        missed, course = self._motion.outcome(probe, obstacles)
        if course is None or course.touched is None:
            return missed
        touches = [(course.until_contact, course.touched)]
        longest = 0.0
        q = course.joint_positions.copy()
        if self._extender is not None:
            touching = self._link_fingers.get(course.touched.link)
            for extension in self._extender.extend(course.X_OH_end, q, but=touching):
                longest = max(longest, extension.duration)
                if extension.touched is not None:
                    time = course.until_contact + extension.until_contact
                    touches.append((time, extension.touched))
                    q[extension.joints] = extension.positions
        touches.sort(key=lambda touch: touch[0])
        slide, made = course.slide, len(touches)
        if slide is not None and slide.touched is not None:
            touches.append((course.until_contact + slide.until_end, slide.touched))
        for _, link in touches:
            if link.body is not None:
                self._felt[link.body] = self._felt.get(link.body, 0) + 1
        contacts = Contacts(
            points=np.array([link.point for _, link in touches]),
            normals=np.array([self._motion.normal(link) for _, link in touches]),
            fingers=tuple(link.link for _, link in touches),
            times=np.array([time for time, _ in touches]),
        )
        return replace(
            missed,
            status="touched",
            contacts=contacts,
            duration=course.duration + longest,
            seconds={**course.seconds, **({"extend": longest} if longest else {})},
            hand_pose=HandPose(course.X_OH_end, q),
            slid=len(touches) - made,
        )

    def resume(self, recorded: Sequence[ProbeOutcome]) -> None:
        """Begin where the last of the recorded probes left the arm."""
        self._motion.resume(recorded)

    def go_home(self) -> float:
        """Move the arm home; see `HomingProber`."""
        return self._motion.go_home()

    def reaches(self, probe: Probe, obstacles: ObstacleModel) -> str:
        """Return why no finger reaches a probe; empty if one does. See `PlanningProber`."""
        return self._motion.reaches(probe, obstacles)

    def place_known(self, poses: Mapping[str, FloatArray]) -> None:
        """Place known bodies at believed poses (4, 4), by their names."""
        self._motion.place_known(poses)


@dataclass(frozen=True, slots=True, eq=False)
class Extension:
    """Extension of one finger."""

    joints: list[int]  # the K joints that moved
    positions: FloatArray  # (K,), at the end
    length: float  # length of the pad's path [m]
    touched: NearestLink | None  # the touching link and its contact

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

    After a touch, the palm and all other fingers rest. Conservative advancement (Mirtich 1996)
    over the joints: a point of a finger moves at most by the sum over joints of motion times
    distance to the farthest point. So each step is as long as the distance to the object allows.
    Only joints that belong to one finger alone move. python-fcl computes distances on the exact,
    watertight mesh.
    """

    def __init__(
        self, hand: Hand, mesh: trimesh.Trimesh, surroundings: Surroundings = ALONE
    ) -> None:
        self._hand = hand
        self._beside: dict[str, TrueBodies] = {}
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
                if len(surroundings):
                    self._beside[finger] = TrueBodies(alone, surroundings)
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
            poses = checker.poses_in_hand(posture)
            checker.place(X_OH, poses)
            nearest = checker.nearest(np.zeros(3))
            if (beside := self._beside.get(finger)) is not None:
                beside.place_hand(X_OH, poses)
                nearest = min(nearest, beside.nearest(np.zeros(3)), key=lambda n: n.distance)
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
    """Return the largest motion of the hand's bodies by a joint and its mimics [m/rad or m/m]."""
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
        corners = apply_pose(geometry.X_LG, geometry.mesh.vertices)
        length = float(np.linalg.norm(corners, axis=1).max())
        link = geometry.link
        while link in by_child and link != moved.child:
            length += float(np.linalg.norm(by_child[link].X_PJ[:3, 3]))
            link = by_child[link].parent
        if link == moved.child:
            radius = max(radius, length)
    return radius
