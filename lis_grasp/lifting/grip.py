"""Role of what holds the object in a lift, by fingers or by a suction cup."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from lis_grasp.contacts import Contacts
from lis_grasp.lifting.cup_control import CupControl
from lis_grasp.lifting.finger_control import FingerControl
from lis_grasp.lifting.outcome import Reason
from lis_grasp.lifting.scene import LiftingScene
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.typing import FloatArray


class Grip(Protocol):
    """Control of what holds the object, from measured contacts."""

    @property
    def exerted(self) -> float:
        """Sum of the planned normal forces, or the pull of a cup [N]."""

    @property
    def touching(self) -> tuple[str, ...]:
        """The fingers of the grasp that have touched the object."""

    def measured_contacts(self) -> Contacts:
        """Return the contacts of the touching fingers, in W."""

    def is_seated(self) -> bool:
        """Return whether every finger that the wrist seats touches the object."""

    def way_to_seat(self) -> FloatArray:
        """Return the direction (3,) in W in which the wrist seats them."""

    def close(self, elapsed: float, interval: float) -> bool:
        """Close for `interval` [s]; return whether all have finished."""

    def refusal(
        self, measured: Contacts, accept_grasp: Callable[[Contacts], bool] | None
    ) -> Reason | None:
        """Return why a closed grasp is not lifted, by its contacts; None if it is."""

    def squeeze(self, fraction: float) -> None:
        """Hold with a fraction of the grip."""

    def hold(self) -> None:
        """Keep holding."""

    def carry(self, mass: float) -> None:
        """Take note of a weighed mass [kg]."""

    def grip_harder(self, factor: float) -> None:
        """Hold harder by a factor, if that can be done."""

    def pad_points(self) -> Mapping[str, FloatArray]:
        """Return the contact point (3,) on each touching finger's link, in W."""

    def reason_of(self, loss: Reason) -> Reason:
        """Return the reason of a loss, by what holds."""

    def release(self) -> None:
        """Stop holding."""

    def open(self, fraction: float) -> None:
        """Open the hand by a fraction of the way."""


def grip_of(scene: LiftingScene, setup: LiftSetup) -> Grip:
    """Return the control of what a hand holds with."""
    control = FingerControl if setup.hand.cup is None else CupControl
    return control(scene, setup)
