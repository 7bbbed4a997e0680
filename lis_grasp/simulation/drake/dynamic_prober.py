"""Dynamic prober: touch an object with a hand in Drake, by guarded motion and contact patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import TIME_STEP
from lis_grasp.arms.use import ArmStoppedError, ArmUse
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import require_positive
from lis_grasp.exploration import HandPose, ObstacleModel, Probe, ProbeOutcome
from lis_grasp.exploration.disturbance import Disturbance
from lis_grasp.exploration.probe_motions import GENTLE_SPEED, PROBE_SPEED
from lis_grasp.geometry import apply_pose, as_pose, inverse_pose, rotate
from lis_grasp.probing.course import Course, Leg, PathOf, path_back, path_out
from lis_grasp.probing.guarded_motion import SLIDE_STEP, GuardedMotion
from lis_grasp.records import read_only
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake._probing_scene import ProbingScene
from lis_grasp.simulation.drake.object_plant import FreeObject
from lis_grasp.simulation.drake.transit_scene import TransitScene
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

# Free flight needs no dynamics: the simulation starts this far before the first contact [m]; an arm
# first settles under its load.
_BEFORE = 0.0005
_BEFORE_WITH_ARM = 0.002
# A touch is detected within this distance of the first contact; later ones are grazes [m].
_BEYOND = 0.01
# From a free object the hand retreats this late after the detection [s]: a sensor of 100 Hz.
_LATENCY = 0.01
# To feel whether the object resists, the hand rests for this time after a touch [s]. What rolls
# has left it then.
_REST = 0.05


ARM_STOPPED = "the arm stopped"
GRAZED = "a link grazed the object below the force threshold"


class DynamicProber:
    """Probes with the whole hand in Drake; every link can touch.

    The hand moves along the probe's direction at its pace, one finger extended in its probe
    posture, the joints under PD control. The motion is simulated from 0.5 mm before the first
    contact until a contact's normal force exceeds the threshold.

    Contact is Drake's hydroelastic one with the exact mesh. A contact is the area-weighted centroid
    and normal of its patch; a patch across an edge counts as two.

    A free object stays where a touch leaves it. Probes and contacts are in the frame E in which the
    hand is commanded, at first the object's frame O: the prober never measures the object's pose.

    Parameters
    ----------
    hand, mesh
        The hand and the true object; for requirements and errors see `KinematicProber`.
    free
        Makes the object free to move on a table, and touches slow; None fixes it.
    force_threshold
        Normal force that ends a touch [N]; None for 0.2 N, and 0.05 N on a free object. It is
        exceeded by at most 1 N.
    station
        The arm that carries the hand, which blocks probes beyond its reach, its efforts, or
        with a collision of it. None for a hand on a rail.
    arm_use
        Gets what touches demand of the arm; None for a record that nobody reads.
    surroundings, known
        The true bodies beside the object, and those that plans avoid, in E. The hand feels them as
        it feels the object. Free ones stay where touches leave them, and make touches slow.

    Raises
    ------
    InvalidOptionError
        If the threshold is not above 0.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        *,
        free: FreeObject | None = None,
        force_threshold: float | None = None,
        station: Station | None = None,
        arm_use: ArmUse | None = None,
        surroundings: Surroundings = ALONE,
        known: Surroundings = ALONE,
    ) -> None:
        if force_threshold is None:
            force_threshold = 0.2 if free is None else 0.05
        require_positive(force_threshold=force_threshold)
        self._scene = ProbingScene(
            hand,
            mesh,
            force_threshold,
            free=free,
            station=station,
            arm_use=arm_use,
            surroundings=surroundings,
        )
        self._beside, self._before = surroundings, Disturbance()  # in W
        self._felt: dict[str, int] = {}
        self._moves = free is not None or bool(surroundings.free)
        self._speed = GENTLE_SPEED if free is not None or known.free else PROBE_SPEED
        self._motion = GuardedMotion(
            hand,
            mesh,
            station,
            probe_speed=self._speed,
            surroundings=surroundings,
            known=known,
        )
        self._station = station
        self._has_bodies = len(surroundings) + len(known) > 0
        self._ways: TransitScene | None = None
        if station is not None:
            self._ways = TransitScene(station, mesh, arm_use or ArmUse(), surroundings)
        # The plant is in W, where the arm's base and fixed bodies stay; without any, in E.
        self._X_WE = np.eye(4)
        self._hand = hand
        self._free = free
        self._hull = np.asarray(mesh.convex_hull.vertices)
        self._X_EO = np.eye(4)

    @property
    def X_EO(self) -> FloatArray | None:
        """True pose of a free object; see `SimulatedProber`."""
        return None if self._free is None else self._X_EO

    @property
    def surroundings(self) -> Surroundings:
        """The true bodies beside the object where they are now, in E."""
        return self._beside.in_frame(self._X_WE)

    @property
    def disturbance(self) -> Disturbance:
        """What touches did so far to the bodies beside the object; see `DisturbingProber`."""
        so_far = Disturbance(self._felt, self._scene.forces_beside, self._free_poses)
        if self._ways is not None:
            so_far = so_far.after(Disturbance(forces=self._ways.forces_beside))
        return self._before.after(so_far)

    def place_disturbed(self, before: Disturbance) -> None:
        """Begin after recorded touches, with free bodies beside the object as they left them."""
        self._before = before
        self._place_beside(before.poses)

    @property
    def _free_poses(self) -> dict[str, FloatArray]:
        return {body.name: body.X_EB for body in self._beside.free}

    def _place_beside(self, poses: Mapping[str, FloatArray]) -> None:
        self._beside = self._beside.placed(poses)
        self._motion.place_surroundings(self._beside, self._X_WE)

    def place_object(self, X_EO: FloatArray) -> None:
        """Place the true object, free and at rest, at a recorded pose, shape (4, 4)."""
        self._X_EO = read_only(as_pose(X_EO).copy())

    def move_frame(self, X_EF: FloatArray) -> None:
        """Give later probes in a frame F with pose X_EF, shape (4, 4), about the vertical axis."""
        self.place_object(inverse_pose(X_EF) @ self._X_EO)
        self.place_frame(self._X_WE @ X_EF)

    def reaches(self, probe: Probe, obstacles: ObstacleModel) -> str:
        """Return why no finger reaches a probe; empty if one does. See `PlanningProber`."""
        return self._motion.reaches(probe, obstacles)

    def place_known(self, poses: Mapping[str, FloatArray]) -> None:
        """Place known bodies at believed poses (4, 4) in W, by their names."""
        self._motion.place_known(poses)
        if self._station is not None and self._station.table is not None:
            table = self._station.table
            table = table.with_bodies(table.surroundings.placed(poses))
            self._station = replace(self._station, table=table)
            self._motion.place_station(self._station.in_frame(self._X_WE))

    def place_frame(self, X_WE: FloatArray) -> None:
        """Give later probes in a frame E with pose X_WE, shape (4, 4), in that of the first."""
        if self._station is None and not self._has_bodies:
            return
        self._X_WE = X_WE
        self._motion.place_surroundings(self._beside, X_WE)
        if self._station is not None:
            self._motion.place_station(self._station.in_frame(X_WE))

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        """Carry out one probe; see `Prober`.

        Raises `SimulationError` if Drake's solver fails.
        """
        self._motion.place_object(self._X_EO)
        missed, course = self._motion.outcome(probe, obstacles)
        if course is None:
            return missed
        try:
            self._go(course, path_out)
        except ArmStoppedError as stopped:
            return self._stopped(missed, stopped)
        outcome = missed if course.touched is None else self._end_of(course, missed)
        try:
            self._go(course, path_back)
        except ArmStoppedError:  # recorded; what was touched is known
            self._motion.arm_at, outcome = None, replace(outcome, left_at=np.empty(0))
        return outcome

    def resume(self, recorded: Sequence[ProbeOutcome]) -> None:
        """Begin where the last of the recorded probes left the arm."""
        self._motion.resume(recorded)

    def go_home(self) -> float:
        """Move the arm home; see `HomingProber`."""
        way, place = self._motion.way_home(), self._motion.arm_at
        if way is not None and place is not None and self._ways is not None:
            with suppress(ArmStoppedError):  # recorded
                X_WO = self._X_WE @ self._X_EO
                self._ways.run(way, place.q_hand, X_WO, beside=self._free_poses)
        return self._motion.go_home()

    def _stopped(self, missed: ProbeOutcome, stopped: ArmStoppedError) -> ProbeOutcome:
        """Return the outcome of a probe whose arm stopped: it is taken home."""
        self._motion.arm_at, reason = None, f"{ARM_STOPPED}: {stopped.reason}"
        return replace(missed, status="blocked", reason=reason, left_at=np.empty(0))

    def _go(self, course: Course, path: PathOf) -> None:
        """Simulate the arm's way of a course in free space; without an arm, there is none."""
        if self._ways is not None and self._station is not None and course.way is not None:
            way = path(self._station.arm, course, _BEFORE, TIME_STEP)
            q_hand = course.joint_positions if path is path_back else course.way.q_hand
            touch: float | None = None
            if course.touched is not None:
                touch = way.duration if path is path_out else 0.0
            X_WO = self._X_WE @ self._X_EO
            self._ways.run(way, q_hand, X_WO, touch=touch, beside=self._free_poses)

    def _end_of(self, course: Course, missed: ProbeOutcome) -> ProbeOutcome:
        """Return the outcome of a course with a contact at its end."""
        before, reason = self._X_EO, GRAZED
        if course.touched is not None and course.touched.body is not None:
            reason = reason.replace("the object", course.touched.body)
        hand_pose: HandPose | None
        try:
            rests = self._free is not None and missed.probe.pace == "tested"
            contacts, hand_pose, resisted = self._touch(course, rests=rests)
        except ArmStoppedError as stopped:
            contacts, hand_pose, resisted = Contacts.empty(), None, None
            reason = f"{ARM_STOPPED}: {stopped.reason}"
        if self._free is not None:
            missed = replace(missed, moved=self._displacement(before))
        if not len(contacts):
            return replace(missed, status="blocked", reason=reason)
        if resisted is not None:
            guarded = missed.seconds["guarded"] + _REST
            seconds = {**missed.seconds, "guarded": guarded}
            missed = replace(missed, duration=missed.duration + _REST, seconds=seconds)
        contacts = replace(contacts, times=np.full(len(contacts), course.until_contact))
        end = self._end_of_slide(course)
        return replace(
            missed,
            status="touched",
            contacts=contacts.append(end),
            hand_pose=hand_pose,
            slid=len(end),
            resisted=resisted,
        )

    def _end_of_slide(self, course: Course) -> Contacts:
        """Return the contacts that the fingertip makes where its slide ends; none without one.

        The way there is computed by geometry: a light force bends no finger. Its end is simulated.
        """
        slide = course.slide
        if slide is None or slide.touched is None:
            return Contacts.empty()
        X_OH = course.last.X_OH.copy()
        X_OH[:3, 3] = slide.places[-1] + SLIDE_STEP * slide.normal
        press = Leg(
            X_OH, -slide.normal, SLIDE_STEP, self._speed, length=SLIDE_STEP, remaining=_BEYOND
        )
        end, _, _ = self._touch(replace(course, legs=(press,)))
        time = course.until_contact + slide.until_end
        return replace(end, times=np.full(len(end), time)) if len(end) else end

    def _touch(
        self, course: Course, *, rests: bool = False
    ) -> tuple[Contacts, HandPose, bool | None]:
        """Simulate the last part of a course; return contacts and the hand's pose.

        The last result is whether a hand that `rests` feels the object in the end.
        """
        scene, q, leg = self._scene, course.joint_positions, course.last
        palm_to_base = self._hand.forward_kinematics(np.eye(4), q)
        X_EB = leg.X_OH @ palm_to_base[self._hand.base_link]
        X_WB, X_WO = self._X_WE @ X_EB, self._X_WE @ self._X_EO
        q_arm = None if leg.q_arm is None else leg.q_arm[0]
        beside = self._free_poses
        scene.place(q, X_WB, rotate(self._X_WE, leg.direction), X_WO, q_arm, beside)
        speed = leg.speed_at_end
        before = _BEFORE if self._station is None else _BEFORE_WITH_ARM
        start = max(leg.length - before, 0.0)
        scene.start_motion(start, speed)
        step = speed * scene.time_step
        end = leg.length + min(_BEYOND, leg.remaining)
        contacts = Contacts.empty()
        scene.command(start + step, speed)
        for n in range(1, int(np.ceil((end - start) / step)) + 1):
            scene.advance()
            scene.command(start + (n + 1) * step, speed)
            if start + n * step > leg.length:
                contacts = scene.touch()
            if len(contacts):
                break
        X_EW = inverse_pose(self._X_WE)
        hand_pose = HandPose(X_EW @ scene.X_WH + 0.0, scene.joint_positions)
        contacts = contacts.in_frame(self._X_WE)
        for name, count in scene.felt_beside().items():
            self._felt[name] = self._felt.get(name, 0) + count
        resisted: bool | None = None
        if self._moves or self._station is not None:
            late = n + (1 if self._station is not None else round(_LATENCY / scene.time_step))
            for m in range(n + 1, late + 1):
                scene.step(start + m * step, speed)
            if rests and len(contacts):
                for _ in range(round(_REST / scene.time_step)):
                    scene.step(start + late * step, 0.0)
                resisted = bool(len(scene.touch()))
            scene.retreat(start + late * step, PROBE_SPEED)
        if self._free is not None:
            self._X_EO = read_only(X_EW @ scene.X_WO)
        if beside:
            self._place_beside(scene.poses_beside)
        return contacts, hand_pose, resisted

    def _displacement(self, X_EO: FloatArray) -> float:
        """Return the largest displacement of a point of the object from an earlier pose [m]."""
        before, now = (apply_pose(X, self._hull) for X in (X_EO, self._X_EO))
        return float(np.linalg.norm(now - before, axis=1).max())
