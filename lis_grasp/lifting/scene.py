"""Protocols of a simulated scene of a lift, and of what carries the hand, for any simulator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.lifting.outcome import Reason
from lis_grasp.lifting.wrist_path import WristPath, rest_at
from lis_grasp.typing import FloatArray

Touched = Literal["object", "table"]
"""What a hand's contacts are with."""


@dataclass(frozen=True, slots=True, eq=False)
class CarrierMotion:
    """A motion of what carries the hand."""

    duration: float  # [s]
    command: Callable[[float], None]  # the state that belongs to a time since the start [s]


class ArmStoppedError(Exception):
    """The arm cannot go on, for a reason that ends the trial."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason: Reason = reason


class Carrier(Protocol):
    """The carrier of the hand in a lift.

    The defaults are those of a free wrist: without a home, and without limits. An arm has both; its
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
