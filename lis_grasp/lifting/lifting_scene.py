"""Protocols of a simulated scene in which a lift is executed, whatever the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from lis_grasp.lifting.wrist_trajectory import WristPath
from lis_grasp.typing import FloatArray


class CarrierMotion(Protocol):
    """A motion of what carries the hand, along a path of the palm."""

    @property
    def duration(self) -> float:
        """Time of the motion [s]."""

    def command(self, time: float) -> None:
        """Command the state that belongs to a time since the motion's start [s]."""


class HandContact(Protocol):
    """Contact of a link of the hand with the object, in W."""

    @property
    def link(self) -> str:
        """Name of the link."""

    @property
    def point(self) -> FloatArray:
        """Centre of the contact, shape (3,) [m]."""

    @property
    def normal(self) -> FloatArray:
        """Mean normal, shape (3,), unit, out of the object."""

    @property
    def strength(self) -> float:
        """Size of the force [N]."""


class LiftingScene(Protocol):
    """A carried hand, a free object and a table, advanced one time step at a time.

    The world frame W is the object's frame O in which the grasp was planned. Displacements of the
    palm, see `WristPath`, are relative to its pose in the grasp. J is the number of actuated
    joints, in the hand's order.
    """

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

    @property
    def object_center(self) -> FloatArray:
        """The object's centre of mass, shape (3,) [m]."""

    @property
    def object_bottom(self) -> float:
        """Height of the object's lowest point [m]."""

    def place_hand(self, displacement: FloatArray, q: FloatArray) -> None:
        """Set the palm to a displacement (6,) and the joints to q, at rest."""

    def follow(self, path: WristPath, duration: float) -> CarrierMotion:
        """Return the palm's motion along a path of a duration [s]; it may take longer."""

    def command_fingers(self, q: FloatArray, efforts: FloatArray) -> None:
        """Command joint positions q, shape (J,), and efforts (J,) on top of the springs'."""

    def rest_object(self) -> None:
        """Keep the object where it is until the hand touches it."""

    def step(self) -> None:
        """Advance by one time step; raise `SimulationError` if the simulation fails."""

    def poses(self) -> dict[str, FloatArray]:
        """Return the pose of every hand link and the object, each (4, 4)."""

    def contacts(self) -> Sequence[HandContact]:
        """Return the contacts of the hand with the object, in a fixed order."""

    def jacobian(self, link: str, p_L: FloatArray) -> FloatArray:
        """Return the Jacobian of a point p_L of a link with respect to the joints, (3, J)."""

    def X_WL(self, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
