"""Protocols of a simulated scene of a lift and of what carries the hand; steps of any scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from lis_grasp.arms.use import ArmUse
from lis_grasp.lifting.outcome import LARGEST_FORCE_BESIDE
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.wrist_path import WristPath, rest_at
from lis_grasp.motion import Motion, beside_body
from lis_grasp.typing import FloatArray

CONTROL_RATE = 100.0
"""Rate of finger commands [Hz]; the wrist is commanded in each time step."""

_FEEL_EVERY = 4  # commands between two looks at how the links carry the object

# Time since the phase's start [s] -> whether the phase is over.
FingerCommand = Callable[[float], bool]

Touched = Literal["object", "table"]
"""What a hand's contacts are with."""


@dataclass(frozen=True, slots=True, eq=False)
class CarrierMotion:
    """A motion of what carries the hand."""

    duration: float  # [s]
    command: Callable[[float], None]  # the state that belongs to a time since the start [s]


class Carrier(Protocol):
    """The carrier of the hand in a lift.

    The defaults describe a free wrist: without a home, and without limits. An arm has both; its
    motions, and the scene's steps, raise `ArmStoppedError` where it cannot go on.
    """

    @property
    def use(self) -> ArmUse | None:
        """What was demanded of an arm so far."""
        return None

    def follow(self, path: WristPath, duration: float) -> CarrierMotion:
        """Return the palm's motion along a path of a duration [s]; an arm may take longer."""
        ...

    def wait(self, displacement: FloatArray, duration: float) -> CarrierMotion:
        """Return a wait [s] where the hand was placed, at a displacement (6,) or an arm's home."""
        return self.follow(rest_at(displacement), duration)

    def bring(self) -> CarrierMotion | None:
        """Return the motion to where the approach begins, without contact; None if it is there."""
        return None

    def expect_contact(self) -> None:
        """Let the hand touch the object from now on."""
        return

    def shake(
        self, path_at: Callable[[float], WristPath], acceleration: float, duration: float, name: str
    ) -> CarrierMotion:
        """Return the motion of a named shake with a peak acceleration [m/s^2].

        `path_at` gives the path of a peak acceleration.
        """
        return self.follow(path_at(acceleration), duration)

    def go_home(self) -> CarrierMotion | None:
        """Return the motion home from where the approach begins; None if there is no home."""
        return None


class FreeWrist(Carrier):
    """A wrist without an arm, under a command of displacement (6,), see `WristPath`, and rate."""

    def __init__(self, command: Callable[[FloatArray, FloatArray], None]) -> None:
        self._command = command

    def follow(self, path: WristPath, duration: float) -> CarrierMotion:
        """Return the motion along a path of a duration [s]."""
        return CarrierMotion(duration, lambda time: self._command(*path(time)))


@dataclass(frozen=True, slots=True, eq=False)
class HandContact:
    """Contact of a link of the hand with the object or the table, in W."""

    link: str
    point: FloatArray  # (3,) [m]: centre of the contact
    normal: FloatArray  # (3,), unit, out of the object or table: mean
    force: FloatArray  # (3,) [N], of the hand on it

    @property
    def strength(self) -> float:
        """Size of the force [N]."""
        return float(np.linalg.norm(self.force))


class LiftingScene(Protocol):
    """A carried hand, a free object and a table, advanced one time step at a time.

    The world frame W is the object's frame O in which the grasp was planned. Displacements of the
    palm, see `WristPath`, are relative to its pose in the grasp. J is the number of actuated
    joints, in the hand's order.
    """

    @property
    def carrier(self) -> Carrier:
        """What carries the hand."""

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""

    @property
    def steps(self) -> int:
        """Time steps since the start."""

    @property
    def joint_positions(self) -> FloatArray:
        """Joint positions, shape (J,) [rad or m]."""

    @property
    def X_WH(self) -> FloatArray:
        """Pose of the palm, shape (4, 4)."""

    @property
    def X_WO(self) -> FloatArray:
        """Pose of the object, shape (4, 4)."""

    def place_hand(self, displacement: FloatArray, q: FloatArray) -> None:
        """Set the palm to a displacement (6,) and the joints to q, at rest."""

    def command_fingers(self, q: FloatArray, efforts: FloatArray) -> None:
        """Command joint positions q, shape (J,), and efforts (J,) on top of the springs'."""

    def pull(self, contact: HandContact | None) -> None:
        """Apply a force of a link on the object, and its reaction, until the next call; or none.

        It is the vacuum's, at a point that stays where it is on the object and on the link, and one
        of the `contacts` of the object.
        """

    def rest_object(self) -> None:
        """Keep the object where it is until the hand touches it."""

    def step(self) -> None:
        """Advance by one time step; raise `SimulationError` if that fails."""

    def poses(self) -> dict[str, FloatArray]:
        """Return the pose of every hand link and the object, each (4, 4)."""

    def contacts(self, on: Touched = "object") -> Sequence[HandContact]:
        """Return the contacts of the hand with the object or the table, in a fixed order."""

    def jacobian(self, link: str, p_L: FloatArray) -> FloatArray:
        """Return the Jacobian of a point p_L of a link with respect to the joints, (3, J)."""

    def X_WL(self, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""

    def forces_beside(self) -> Mapping[str, float]:
        """Return the forces [N] of hand, arm and object on bodies beside the object now."""

    def poses_beside(self) -> Mapping[str, FloatArray]:
        """Return the poses X_WB (4, 4) of the free bodies beside the object."""


class BodyHitError(Exception):
    """A body beside the object was pushed too hard, so that the motion ends."""


class Steps:
    """The steps of one lift in a scene.

    They end at a force above `LARGEST_FORCE_BESIDE` on a body beside the object, once. `feel` is
    called at every fourth command.
    """

    def __init__(
        self, scene: LiftingScene, setup: LiftSetup, feel: Callable[[], None] = lambda: None
    ) -> None:
        self._scene, self._options, self._feel = scene, setup.options, feel
        self._goal = np.asarray(setup.grasp.X_OH, dtype=np.float64)[:3, 3]
        self._times: list[float] = []
        self._poses: dict[str, list[FloatArray]] = {}
        #: largest force on each touched body beside the object [N]
        self.forces_beside: dict[str, float] = {}
        self._has_hit = False
        self._record()

    @property
    def displacement(self) -> FloatArray:
        """Displacement of the palm, which has not turned, from the grasp, (6,)."""
        return np.append(self._scene.X_WH[:3, 3] - self._goal, np.zeros(3))

    def advance(
        self, duration: float, path: WristPath, fingers: FingerCommand | None = None
    ) -> None:
        """Move the palm along a path; see `move`."""
        self.move(self._scene.carrier.follow(path, duration), fingers)

    def move(self, motion: CarrierMotion, fingers: FingerCommand | None = None) -> None:
        """Step until the motion is over, or `fingers` returns that the phase is.

        Raises `BodyHitError` at the first force on a body beside the object that is too large.
        """
        step = self._options.time_step
        command_every = max(1, round(1.0 / (CONTROL_RATE * step)))
        feel_every = _FEEL_EVERY * command_every
        record_every = max(1, round(1.0 / (self._options.frame_rate * step)))
        for count in range(round(motion.duration / step)):
            if fingers is not None and count % command_every == 0 and fingers(count * step):
                break
            motion.command((count + 1) * step)
            self._scene.step()
            if self._scene.steps % feel_every == 0:
                self._feel()
            if self._scene.steps % record_every == 0:
                self._record()
            for name, force in self._scene.forces_beside().items():
                self.forces_beside[name] = max(force, self.forces_beside.get(name, 0.0))
            largest = max(self.forces_beside.values(), default=0.0)
            if largest > LARGEST_FORCE_BESIDE and not self._has_hit:
                self._has_hit = True
                raise BodyHitError

    def motion(self) -> Motion:
        """Return the recorded motion so far."""
        poses = {name: np.array(X) for name, X in self._poses.items()}
        return Motion(np.array(self._times), poses)

    def _record(self) -> None:
        self._times.append(self._scene.time)
        beside = self._scene.poses_beside()
        poses = {**self._scene.poses(), **{beside_body(n): X for n, X in beside.items()}}
        for name, X in poses.items():
            self._poses.setdefault(name, []).append(X)
