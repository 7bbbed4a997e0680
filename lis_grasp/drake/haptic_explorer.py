"""Haptic explorer: a Drake system that moves a hand from touch to touch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from lis_grasp.arms.station import Station
from lis_grasp.contacts import Contacts
from lis_grasp.drake._hand_motion import HandMotion, Mover
from lis_grasp.drake._movers import ArmMover, FreeMover
from lis_grasp.drake._ports import declare_output, read_port
from lis_grasp.drake.surface_estimator import Estimate
from lis_grasp.exceptions import InvalidOptionError, require_positive
from lis_grasp.exploration import (
    GENTLE_SPEED,
    MOST_BLOCKED,
    Exploration,
    ExplorationState,
    ExplorationStrategy,
    HandPose,
    Policy,
    Probe,
    ProbeOutcome,
    Region,
    StopRule,
    TactilePerception,
    TactileSensor,
    Workspace,
    advance,
    begin,
    choose,
)
from lis_grasp.geometry import inverse_pose
from lis_grasp.probing.guarded_motion import AT_TABLE
from lis_grasp.probing.probe_planner import ProbePlanner
from lis_grasp.records import Record
from lis_grasp.simulation.drake.hand_plant import HandInPlant, require_in_plant
from lis_grasp.simulation.drake.plant_parts import numbers_of, pose_of, require_type, wrong_type
from lis_grasp.stages.touch import make_policy
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings


@dataclass(frozen=True, slots=True, eq=False)
class _Progress(Record):
    """Progress of the exploration; the whole memory of the system."""

    phase: Literal["begin", "out", "back", "done"]
    motion: HandMotion
    began: float = 0.0  # beginning of the motion [s]
    left: float = 0.0  # beginning of the probe [s]
    probe: Probe | None = None
    touched: HandPose | None = None  # where the hand turned back
    known: int = 0  # contacts at the beginning of the probe
    free: int = 0  # free points then
    exploration: ExplorationState | None = None
    ended: str = ""


class HapticExplorer(LeafSystem):
    """Explores an object by touch: chooses probes, moves the hand to them, and back.

    .. code-block:: text

        contacts, estimate -> HapticExplorer -> X_WG, joint_state, arm_state, listening, done,
                                                exploration

    ``estimate`` is that of the same ``contacts``. ``X_WG`` is the desired pose of the hand's base
    link, continuous in time. ``joint_state`` (2J,) has desired positions and rates in the order of
    the hand's actuators, for ``plant.get_desired_state_input_port(hand.instance)``. ``listening``
    is 1 on approach and probe; connect it to the sensor's ``enable``. ``done`` is 1 at the end, and
    ``exploration`` is the `Exploration` so far. With a station there is also ``arm_state`` (2K,).
    Contacts before the first probe are prior knowledge.

    Parameters
    ----------
    hand
        The hand in the plant; it needs a probe posture.
    space
        The object's place and size in E, or the region that contains it.
    X_WE
        Pose of E, the contacts' frame, in the world.
    home
        Pose X_WG at which the hand begins; needed without a station.
    q_home
        Joint positions (J,) at which the hand begins; None for a probe posture.
    policy
        Name of a policy, or a function of a `Workspace` that makes one.
    touches
        Wanted number of contacts.
    stop
        Rules that end the exploration early.
    noise
        The sensor's noise, which the policy's own estimate is given.
    seed
        Seed of all random draws.
    probe_speed
        Speed of a free hand on the probe's own motion [m/s].
    station
        Arm, mount and table, the base in the world. The arm begins at its home.
    surroundings
        Known bodies in the world, which the hand must not hit, such as `surroundings_of` the plant
        without hand, arm and object. With a station, its table holds them.
    period
        Time between two checks of the contacts [s].

    Raises
    ------
    InvalidHandError
        If the hand has no probe posture.
    InvalidOptionError
        If there is neither home nor station, or an option is out of range.

    Examples
    --------
    >>> plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    >>> hand = add_hand(plant, "wsg50")
    >>> plant.Finalize()
    >>> space = Workspace(step=0.03, center=[0.0, 0.0, 0.0], size=0.12)
    >>> explorer = HapticExplorer(hand, space, home=RigidTransform([0.0, 0.0, 0.4]), touches=8)
    >>> explorer.X_WG.Eval(explorer.CreateDefaultContext()).translation()
    array([0. , 0. , 0.4])
    """

    def __init__(
        self,
        hand: HandInPlant,
        space: Workspace | Region,
        *,
        X_WE: RigidTransform | None = None,
        home: RigidTransform | None = None,
        q_home: FloatArray | None = None,
        policy: str | Callable[[Workspace], Policy] = "spread",
        touches: int = 15,
        stop: Sequence[StopRule] = (),
        noise: TactileSensor | None = None,
        seed: int = 0,
        probe_speed: float = GENTLE_SPEED,
        station: Station | None = None,
        surroundings: Surroundings = ALONE,
        period: float = 0.01,
    ) -> None:
        super().__init__()
        require_in_plant("HapticExplorer", hand)
        if not isinstance(space, Workspace | Region):
            raise InvalidOptionError(
                "HapticExplorer needs the object's Workspace, or the Region that holds it; it has"
                f" a {type(space).__name__}",
                option="space",
            )
        require_positive(probe_speed=probe_speed, period=period)
        require_type("noise", noise, TactileSensor)
        require_type("station", station, Station)
        require_type("surroundings", surroundings, Surroundings)
        if not isinstance(policy, str) and not callable(policy):
            raise wrong_type("policy", policy, "the name of a policy, or a function of a Workspace")
        X_WE = pose_of(X_WE, "X_WE")
        self._sensor, self._seed = noise or TactileSensor(), seed
        self._X_WE = X_WE.GetAsMatrix4()
        self._X_LH, self._actuated = hand.hand.X_LH, hand.actuated
        chooses = make_policy(policy, space, self._sensor)
        self._strategy = ExplorationStrategy(chooses, touches, space, stop)
        self._mover: Mover
        known = surroundings.in_frame(self._X_WE)
        if station is not None:
            station = _beside(station, surroundings).in_frame(self._X_WE)
            self._mover = ArmMover(station, ProbePlanner(hand.hand, station, known=known), X_WE)
        elif home is None:
            raise InvalidOptionError(
                "HapticExplorer needs the pose at which the hand begins: give home=X_WG, or the"
                " station of its arm",
                option="home",
            )
        else:
            planner = ProbePlanner(hand.hand, probe_speed=probe_speed, known=known)
            q = next(iter(hand.hand.probe_postures.values())).joint_positions
            if q_home is not None:
                q = numbers_of(q_home, "q_home", q.shape, least=-np.inf)
            start = pose_of(home, "home"), q
            self._mover = FreeMover(hand.hand, planner, X_WE, start, probe_speed)
        self._declare(0 if station is None else len(station.arm.joint_names), period)

    def ended(self, root: Context) -> EventStatus:
        """End a simulation when the exploration is done: for ``simulator.set_monitor``."""
        if _progress(self.GetMyContextFromRoot(root)).phase == "done":
            return EventStatus.ReachedTermination(self, "the exploration is done")
        return EventStatus.DidNothing()

    def _declare(self, arm_joints: int, period: float) -> None:
        """Declare ports, state and update."""
        empty = Contacts.empty()
        estimate = Estimate(empty)
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(empty))
        self._estimate = self.DeclareAbstractInputPort("estimate", AbstractValue.Make(estimate))
        start = _Progress("begin", self._mover.home())
        index = self.DeclareAbstractState(AbstractValue.Make(start))
        state = {self.abstract_state_ticket(index)}
        moving = state | {self.time_ticket()}
        self.X_WG = declare_output(self, "X_WG", RigidTransform(), self._pose, moving)
        joints = 2 * len(self._actuated)
        self.DeclareVectorOutputPort("joint_state", joints, self._joint_state, moving)
        if arm_joints:
            self.DeclareVectorOutputPort("arm_state", 2 * arm_joints, self._arm_state, moving)
        self.DeclareVectorOutputPort("listening", 1, self._listening, moving)
        self.DeclareVectorOutputPort("done", 1, self._done, state)
        self.exploration = declare_output(
            self, "exploration", Exploration(empty, ()), self._explored, state
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, state: State) -> EventStatus:
        """Turn back at a touch or at the end of a probe, and begin the next one."""
        before = _progress(context)
        now, motion = context.get_time(), before.motion
        elapsed = now - before.began
        after = before
        if before.phase == "out":
            touched = len(self._read_contacts(context)) > before.known
            if touched or elapsed >= motion.duration:
                back = self._mover.back(motion, min(elapsed, motion.duration))
                turned = self._hand_pose(motion, elapsed) if touched else None
                after = replace(before, phase="back", motion=back, began=now, touched=turned)
        elif before.phase == "begin" or (before.phase == "back" and elapsed >= motion.duration):
            after = self._next(context, before)
        if after is before:
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(0).set_value(after)
        return EventStatus.Succeeded()

    def _next(self, context: Context, before: _Progress) -> _Progress:
        """Return the progress after a probe: the next probe's motion, or the end."""
        contacts, now = self._read_contacts(context), context.get_time()
        source = "the output 'estimate' of a SurfaceEstimator"
        estimate = read_port(self._estimate, context, Estimate, source)

        strategy, explored = self._strategy, before.exploration
        perception = TactilePerception(estimate.guide, sensor=self._sensor)
        if explored is None or len(contacts) < before.known:  # the sensor was reset
            explored = begin(replace(perception, prior=contacts), strategy)
        elif before.probe is not None:
            explored = advance(perception, explored, self._outcome(before, contacts, now))
        progress = replace(before, phase="begin", touched=None, probe=None)
        for _ in range(MOST_BLOCKED):
            draws = np.random.SeedSequence(self._seed, spawn_key=(len(explored.observations),))
            chosen = choose(strategy, explored, rng=np.random.default_rng(draws))
            if isinstance(chosen, str):
                return replace(progress, phase="done", exploration=explored, ended=chosen)
            motion = self._mover.out(chosen, before.motion)
            if not isinstance(motion, str):
                return replace(
                    progress,
                    phase="out",
                    motion=motion,
                    began=now,
                    left=now,
                    probe=chosen.probe,
                    known=len(contacts),
                    free=len(contacts.free_points),
                    exploration=explored,
                )
            blocked = ProbeOutcome(chosen.probe, "blocked", reason=motion)
            explored = advance(perception, explored, blocked)
        return replace(progress, exploration=explored)

    def _outcome(self, before: _Progress, contacts: Contacts, now: float) -> ProbeOutcome:
        """Return the outcome of the ended probe, from the sensor's new contacts."""
        assert before.probe is not None
        free = slice(before.free, None)
        made = contacts[before.known :]
        times = None if made.times is None else made.times - before.left
        made = replace(made, times=times, free_points=np.empty((0, 3)), free_radii=np.empty(0))
        at_table = not len(made) and before.motion.at_table
        return ProbeOutcome(
            before.probe,
            "touched" if len(made) else "blocked" if at_table else "missed",
            contacts=made,
            free_points=contacts.free_points[free],
            free_radii=contacts.free_radii[free],
            duration=now - before.left,
            reason=AT_TABLE if at_table else "",
            hand_pose=before.touched,
        )

    def _hand_pose(self, motion: HandMotion, time: float) -> HandPose:
        """Return the commanded pose of the hand in E."""
        X_EH = inverse_pose(self._X_WE) @ motion.X_WG(time).GetAsMatrix4() @ self._X_LH
        joints = motion.state(motion.joints, time)
        return HandPose(X_EH, joints[: len(joints) // 2])

    def _read_contacts(self, context: Context) -> Contacts:
        return read_port(
            self._contacts, context, Contacts, "the output 'contacts' of a TouchSensor"
        )

    def _pose(self, context: Context) -> RigidTransform:
        progress, elapsed = _at(context)
        return progress.motion.X_WG(elapsed)

    def _joint_state(self, context: Context, output: object) -> None:
        progress, elapsed = _at(context)
        state = progress.motion.state(progress.motion.joints, elapsed).reshape(2, -1)
        output.SetFromVector(state[:, self._actuated].ravel())  # type: ignore[attr-defined]

    def _arm_state(self, context: Context, output: object) -> None:
        progress, elapsed = _at(context)
        state = progress.motion.state(progress.motion.arm, elapsed)
        output.SetFromVector(state)  # type: ignore[attr-defined]

    def _listening(self, context: Context, output: object) -> None:
        progress, elapsed = _at(context)
        listens = progress.phase == "out" and elapsed >= progress.motion.guarded
        output.SetFromVector([float(listens)])  # type: ignore[attr-defined]

    def _done(self, context: Context, output: object) -> None:
        done = _progress(context).phase == "done"
        output.SetFromVector([float(done)])  # type: ignore[attr-defined]

    def _explored(self, context: Context) -> Exploration:
        progress = _progress(context)
        explored = progress.exploration or ExplorationState()
        return Exploration(explored.contacts, explored.observations, progress.ended)


def _beside(station: Station, surroundings: Surroundings) -> Station:
    """Return a station whose transits also avoid bodies."""
    if not len(surroundings):
        return station
    if station.table is None:
        raise InvalidOptionError(
            "surroundings need a station with a table, beside whose object they are; it has none:"
            " give Station.make(..., table=Table(height))",
            option="surroundings",
        )
    return replace(station, table=station.table.with_bodies(surroundings))


def _progress(context: Context) -> _Progress:
    progress: _Progress = context.get_abstract_state(0).get_value()
    return progress


def _at(context: Context) -> tuple[_Progress, float]:
    """Return the progress, and the time since its motion began [s]."""
    progress = _progress(context)
    return progress, context.get_time() - progress.began
