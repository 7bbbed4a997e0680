"""Guarded motion of a hand through the true scene, up to the first contact of any link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import trimesh

from lis_grasp.arms.reach import ArmPlace
from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import JointTrajectory
from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.probe_motions import PROBE_SPEED
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.geometry import apply_pose, inverse_pose, rotate, unit
from lis_grasp.motion import OBJECT
from lis_grasp.probing.approach_planner import NO_FREE_START, Approach, leading_center
from lis_grasp.probing.bodies_beside import balls_in_links
from lis_grasp.probing.course import Course, Leg, Slide
from lis_grasp.probing.probe_planner import ProbePlanner
from lis_grasp.probing.true_bodies import TrueBodies
from lis_grasp.robots.collision import HandCollisionChecker, NearestLink
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import ProbePosture
from lis_grasp.shapes.mesh_distance import any_inside
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

TOUCHING = 2e-5
"""Distance below which two bodies touch [m]."""

AT_TABLE = "the table ended the motion"

SLIDE_STEP = 0.0025
"""Step after which a slide presses the tip onto the surface again, lifted by as much [m]."""

# A slide ends where the surface has turned by 60 degrees from the first contact.
_LEAST_TURN_COSINE = 0.5
# It has reached an edge where the contact proceeds by less than this fraction of a step.
_PROGRESS = 0.5
# A slide that is shorter than this fraction of the wanted length gives no second contact.
_LEAST_SLIDE = 0.4


class GuardedMotion:
    """Moves a hand through the true scene until a link touches.

    Conservative advancement (Mirtich 1996): move as far as the distance between links and object
    or another body allows, repeatedly. python-fcl computes distances on the exact mesh: the true
    object in O [m]. A hand without probe posture and a mesh that is not watertight are refused.

    Probes, obstacles and courses are in the frame E in which the hand is commanded. It is O until
    `place_object` moves the object. With a `station`, probes are within the reach of its arm.
    `surroundings` are the true bodies beside the object, which end a motion as it does, `known`
    those that plans avoid. Both are in E at first.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        station: Station | None = None,
        *,
        probe_speed: float = PROBE_SPEED,
        surroundings: Surroundings = ALONE,
        known: Surroundings = ALONE,
    ) -> None:
        self._planner = ProbePlanner(hand, station, probe_speed=probe_speed, known=known)
        self._beside = TrueBodies(hand, surroundings) if len(surroundings) else None
        if not mesh.is_watertight:
            raise InvalidMeshError("touching needs a watertight mesh: load it with `shapes.load`")
        self._mesh = mesh
        self._checker = HandCollisionChecker(hand, mesh)
        self._fingers = hand.link_fingers
        self._poses = {
            name: self._checker.poses_in_hand(posture.joint_positions)
            for name, posture in hand.probe_postures.items()
        }
        self._balls = {
            name: _balls_in_hand(hand, posture) for name, posture in hand.probe_postures.items()
        }
        self._X_OE: FloatArray | None = None  # None for the identity
        #: where an arm is; None at home
        self.arm_at: ArmPlace | None = None
        self._space: Workspace | None = None  # of the last probe

    def place_object(self, X_EO: FloatArray) -> None:
        """Place the true object at a pose, shape (4, 4)."""
        moved = not np.array_equal(X_EO, np.eye(4))
        self._X_OE = inverse_pose(X_EO) if moved else None

    def place_surroundings(self, surroundings: Surroundings, X_WE: FloatArray) -> None:
        """Place the true bodies beside the object, in a frame W in which E has a pose (4, 4).

        The known bodies stay in W, too.
        """
        self._planner.place_frame(X_WE)
        if self._beside is not None:
            self._beside.place_frame(X_WE)
            self._beside.place(surroundings)

    def place_known(self, poses: Mapping[str, FloatArray]) -> None:
        """Place the bodies that plans avoid at believed poses (4, 4) in W, by their names."""
        self._planner.place_known(poses)

    def reaches(self, probe: Probe, obstacles: ObstacleModel) -> str:
        """Return why no finger reaches a probe; empty if one does."""
        known = self._planner.kept_off(obstacles)
        found = self._planner.approach(probe, known, self.arm_at)
        return found if isinstance(found, str) else ""

    def place_station(self, station: Station) -> None:
        """Place the station of the arm in the frame E."""
        self._planner.place_station(station)

    def resume(self, recorded: Sequence[ProbeOutcome]) -> None:
        """Begin where the last of the recorded probes that moved left the arm."""
        moved = [outcome for outcome in recorded if outcome.duration > 0.0]
        if moved and len(moved[-1].left_at):
            self.arm_at = self._planner.arm_place(moved[-1].left_at)

    def way_home(self) -> JointTrajectory | None:
        """Return the arm's path home, if it is not there; None without a path too."""
        if self.arm_at is None or self._space is None:
            return None
        return self._planner.way_home(self.arm_at, self._space)

    def go_home(self) -> float:
        """Move the arm home; return the time [s]."""
        way, self.arm_at = self.way_home(), None
        return 0.0 if way is None else way.duration

    def run(self, probe: Probe, obstacles: ObstacleModel | None = None) -> Course | str:
        """Move up to the first contact; return the course, or the reason that blocks the probe.

        With `obstacles`, the hand approaches from outside of the object's ball, avoids the known
        object, and stops above the table. Without them, it starts where no link touches the object.
        """
        way = None
        if obstacles is None:
            started = self._free_start(probe)
            if isinstance(started, str):
                return started
            approach = started
        else:
            obstacles = self._planner.kept_off(obstacles)
            self._space = obstacles.space
            planned = self._planner.approach(probe, obstacles, self.arm_at)
            if isinstance(planned, str):
                return planned
            approach = planned
            met = self._place(approach, approach.X_OH_outside)
            if met is not None:
                return _no_start(met)
            transit = self._planner.transit(approach, obstacles.space, self.arm_at)
            if isinstance(transit, str):
                return transit
            way = transit
        way_in, ahead = self._planner.legs(approach, probe, obstacles)
        posture, touched = approach.posture, None
        if way_in.planned > 0.0:
            way_in, touched = self._moved(way_in, way_in.planned)
        legs: tuple[Leg, ...] = (way_in,)
        at_table = False
        if touched is None:
            self._place(approach, approach.X_OH)
            end = min(ahead.planned, self._planner.above_table(approach, probe, obstacles))
            at_table = end < probe.standoff
            if obstacles is not None:
                end = min(end, self._planner.before_bodies(approach, probe))
            ahead, touched = self._moved(ahead, end)
            legs, at_table = (way_in, ahead), touched is None and at_table
        course = Course(posture.finger, posture.joint_positions, legs, touched, at_table, way)
        if way_in.q_arm is not None:
            self.arm_at = ArmPlace(way_in.q_arm[0], posture.joint_positions)
        slide = self._slide(probe, course, obstacles)
        return course if slide is None else replace(course, slide=slide)

    @cached_property
    def face_normals(self) -> FloatArray:
        """Unit normals of the mesh, shape (F, 3); of the neighbours where a face is flat."""
        normals = np.array(self._mesh.face_normals)
        flat = np.linalg.norm(normals, axis=1) < 0.5
        around = np.asarray(self._mesh.vertex_normals)[self._mesh.faces[flat]].sum(axis=1)  # (K, 3)
        normals[flat] = unit(around, least=1e-12)
        return normals

    def normal(self, touched: NearestLink) -> FloatArray:
        """Return the normal (3,) of the object, or of the body beside it, where a link touches."""
        if self._beside is not None and touched.body is not None:
            return self._beside.normal(touched.face)
        normal: FloatArray = self.face_normals[touched.face]
        return normal

    def _slide(self, probe: Probe, course: Course, obstacles: ObstacleModel | None) -> Slide | None:
        """Slide a touching fingertip of the placed hand along the surface; None if it cannot.

        The first of the probe's slides that is long enough, or turns around the object, counts;
        after any other, the tip goes back. The hand does not turn.
        """
        finger, touched = course.finger, course.touched
        if not len(probe.slides) or course.way is not None or self._X_OE is not None:
            return None
        if touched is None or touched.body or self._fingers.get(touched.link) != finger:
            return None
        height, slide = -np.inf, None
        if obstacles is not None and obstacles.space.support_height is not None:
            lowest = float(self._checker.lowest(course.last.X_OH @ self._poses[finger]))
            height = obstacles.space.support_height - lowest
        for wanted in probe.slides:
            slide = self._slide_along(wanted, course, height, slide)
            if slide.touched is not None:
                break
        return slide

    def _slide_along(
        self, wanted: FloatArray, course: Course, height: float, before: Slide | None
    ) -> Slide:
        """Slide the tip by a vector (3,) [m] after earlier slides; the palm stays above a height.

        The tip follows the surface by the measured normal, as the tactile sensor of Lepora et al.
        2017 follows a contour: lift by a step, move along the tangent, press against the normal.
        The slide ends after the wanted length, at an edge, at a wall (its last contact), where the
        surface turns too much, or above the table.
        """
        assert course.touched is not None
        leg, end, length = course.last, course.touched, 0.0
        first = normal = self.face_normals[end.face]
        at, far, turned = leg.length * leg.direction, float(np.linalg.norm(wanted)), False
        places = [at]
        while length < far - TOUCHING and not turned:
            along = wanted - (wanted @ normal) * normal
            if np.linalg.norm(along) < _LEAST_TURN_COSINE * far:
                break
            along = unit(along)
            step = min(SLIDE_STEP, far - length)
            lifted = at + SLIDE_STEP * normal
            ahead = lifted + step * along
            if (ahead - 2.0 * SLIDE_STEP * normal)[2] < height:
                break
            wall, way = self._advance(along, step, lifted)
            if wall is not None:
                if way > 0.0:
                    length, end, normal = length + way, wall, self.normal(wall)
                    places.append(lifted + way * along)
                    turned = normal @ first < _LEAST_TURN_COSINE
                break
            found, drop = self._advance(-normal, 2.0 * SLIDE_STEP, ahead)
            if found is None or found.body or self._fingers.get(found.link) != course.finger:
                places.append(ahead)
                break
            there = self.face_normals[found.face]
            proceeds = (found.point - end.point) @ along >= _PROGRESS * step
            if not proceeds or there @ normal < _LEAST_TURN_COSINE:  # an edge
                break
            at, normal, end, length = ahead - drop * normal, there, found, length + step
            places.append(at)
            turned = normal @ first < _LEAST_TURN_COSINE
        reached = end if turned or length >= _LEAST_SLIDE * far else None
        so_far = leg.X_OH[:3, 3] + np.array(places)
        if before is None:
            return Slide(so_far, length, reached, normal)
        so_far = np.concatenate([before.places, so_far])
        return Slide(so_far, length, reached, normal, before.duration)

    def _moved(self, leg: Leg, end: float) -> tuple[Leg, NearestLink | None]:
        """Move the placed hand along a leg up to `end` [m]; return its part, and any touch."""
        touched, length = self._advance(leg.direction, end)
        return replace(leg, length=length, remaining=end - length), touched

    def outcome(
        self, probe: Probe, obstacles: ObstacleModel | None
    ) -> tuple[ProbeOutcome, Course | None]:
        """Return the outcome of a probe as if no link touched, and its course, if any."""
        course = self.run(probe, obstacles)
        if isinstance(course, str):
            return ProbeOutcome(probe, "blocked", reason=course), None
        free_points, free_radii = self._free_space(course, obstacles)
        missed = ProbeOutcome(
            probe,
            "blocked" if course.at_table else "missed",
            free_points=free_points,
            duration=course.duration,
            seconds=course.seconds,
            left_at=np.empty(0) if self.arm_at is None else self.arm_at.joint_positions,
            reason=AT_TABLE if course.at_table else "",
            free_radii=free_radii,
        )
        return missed, course

    def _free_space(
        self, course: Course, obstacles: ObstacleModel | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return a course's free balls, the leader's first: centres (K, 3) in O, radii (K,)."""
        balls = self._balls[course.finger]
        X_OH = course.poses()
        centers = apply_pose(X_OH, balls[:, :3])
        tip, others = centers[:, 0], centers[:, 1:].reshape(-1, 3)
        radii = np.tile(balls[1:, 3], len(X_OH))
        if obstacles is not None:
            distances = np.linalg.norm(others - obstacles.space.center, axis=1)
            overlapping = distances < obstacles.space.radius + radii
            others, radii = others[overlapping], radii[overlapping]
        return (
            np.vstack([tip, others]),
            np.concatenate([np.full(len(tip), balls[0, 3]), radii]),
        )

    def _place(self, approach: Approach, X_EH: FloatArray) -> str | None:
        """Place the hand; return what it touches: the object's surface, or a body; None if none."""
        finger = approach.posture.finger
        X_OH = X_EH if self._X_OE is None else self._X_OE @ X_EH
        touches = self._checker.place(X_OH, self._poses[finger])
        met = None
        if self._beside is not None:
            met = self._beside.met_at(X_EH, self._poses[finger], self._balls[finger])
        return OBJECT if touches else met

    def _free_start(self, probe: Probe) -> Approach | str:
        met: str | None = OBJECT
        inside: dict[float, bool] = {}  # by the tip's radius
        for approach in self._planner.starts(probe):
            radius = approach.posture.radius
            if radius not in inside:
                # A hand that does not cross the surface is wholly inside or outside.
                center = probe.start - radius * probe.direction
                if self._X_OE is not None:
                    center = apply_pose(self._X_OE, center)
                inside[radius] = any_inside(self._mesh, center[None])
            if not inside[radius]:
                met = self._place(approach, approach.X_OH)
                if met is None:
                    return approach
        return _no_start(met or OBJECT)

    def _advance(
        self, direction: FloatArray, length: float, start: FloatArray | float = 0.0
    ) -> tuple[NearestLink | None, float]:
        """Move the hand, from an offset (3,) [m] to its placed pose, until a link touches.

        Return the link and the distance [m].
        """
        travelled, direction_E = 0.0, direction
        if self._X_OE is not None:
            direction = rotate(self._X_OE, direction)
        clear = -np.inf  # the hand can move as far before a body beside the object is met [m]
        while True:
            moved, moved_E = start + travelled * direction, start + travelled * direction_E
            nearest, distance = self._checker.nearest, self._checker.distance(moved)
            if self._beside is not None and clear - travelled < distance:
                apart = self._beside.distance(moved_E)
                clear = travelled + apart
                if apart < distance:
                    nearest, distance, moved = self._beside.nearest, apart, moved_E
            if distance < TOUCHING:
                return nearest(moved), travelled
            if travelled >= length:
                return None, length
            travelled = min(travelled + distance, length)


def _no_start(met: str) -> str:
    """Return why a hand that touches the object or a body cannot start there."""
    return NO_FREE_START if met == OBJECT else f"{NO_FREE_START}: {met} is in the way"


def _balls_in_hand(hand: Hand, posture: ProbePosture) -> FloatArray:
    """Return balls inside the links, centres in H and radii [m], shape (S, 4); the leader first."""
    leader = np.append(leading_center(hand, posture), posture.radius)
    inside = balls_in_links(hand, posture)
    return np.vstack([leader, inside[np.linalg.norm(inside - leader, axis=1) > TOUCHING]])
