"""Control of a suction cup in a lift: the lip touches, the vacuum builds up, holds or leaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import apply_inverse, apply_pose, rotate, rotate_back, unit
from lis_grasp.grasping.seals import press_cups
from lis_grasp.lifting.finger_control import TOUCH_FORCE
from lis_grasp.lifting.outcome import Reason
from lis_grasp.lifting.scene import HandContact, LiftingScene
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.robots.robot_model import Cup
from lis_grasp.shapes.mesh_distance import MeshTree
from lis_grasp.typing import FloatArray

# A held object this far off the lip [m] leaks.
_OFF_LIP = 0.001


class CupControl:
    """Controls a suction cup through a grasp.

    The lip touches the surface. If it seals there, which the true object decides, the air
    presses object and lip together with `Cup.pull`: friction and the contact of the lip, which the
    simulator computes, carry the rest. Where the lip no longer seals, the vacuum is lost for good.
    The folds of the bellows, which lie on each other under vacuum, keep their shape then.
    """

    def __init__(self, scene: LiftingScene, setup: LiftSetup) -> None:
        self._scene, self._hand = scene, setup.hand
        (self._pad,) = setup.hand.pads
        assert self._pad.cup is not None
        self._cup: Cup = self._pad.cup
        self._truth = MeshTree(setup.mesh)
        self._normal = np.asarray(setup.grasp.contact_normals, dtype=np.float64)[0]
        self._relaxed = np.array(setup.grasp.joint_positions, dtype=np.float64)
        self._posture = self._relaxed
        self._contact: tuple[FloatArray, FloatArray] | None = None  # point and normal, in W
        self._fraction = 0.0  # of the largest pull; 0 without a vacuum
        self._leaks = False

    @property
    def exerted(self) -> float:
        """Pull of the sealed cup [N]; 0 without a seal."""
        return self._fraction * self._cup.pull

    @property
    def touching(self) -> tuple[str, ...]:
        """The cup, if its lip has touched the object."""
        return () if self._contact is None else self._hand.fingers

    def measured_contacts(self) -> Contacts:
        """Return the middle of what the lip touches, in W."""
        if self._contact is None:
            return Contacts.empty()
        point, normal = self._contact
        return Contacts(point[None], normal[None], fingers=self._hand.fingers)

    def is_seated(self) -> bool:
        """Return whether the lip touches the object."""
        return sum(contact.strength for contact in self._lip_contacts()) > TOUCH_FORCE

    def way_to_seat(self) -> FloatArray:
        """Return the direction (3,) in W against the planned normal."""
        return -self._normal

    def close(self, elapsed: float, interval: float) -> bool:
        """Measure where the lip, which the wrist has seated, touches."""
        contacts = self._lip_contacts()
        weights = np.array([contact.strength for contact in contacts])
        if weights.sum() > TOUCH_FORCE:
            points = np.array([contact.point for contact in contacts])
            normals = np.array([contact.normal for contact in contacts])
            self._contact = weights @ points / weights.sum(), unit(weights @ normals)
        self._command()
        return True

    def refusal(
        self, measured: Contacts, accept_grasp: Callable[[Contacts], bool] | None
    ) -> Reason | None:
        """Return why a cup is not lifted: the vacuum tests it, instead of `accept_grasp`."""
        if self._contact is None:
            return "no_contact"
        if self._seals(self._cup):
            return None
        return "no_seal" if accept_grasp is None else "aborted"

    def squeeze(self, fraction: float) -> None:
        """Build up a fraction of the vacuum; the bellows yields to it."""
        self._posture = np.array(self._scene.joint_positions)
        self._pull(fraction)

    def hold(self) -> None:
        """Keep the vacuum, as long as the lip seals."""
        self._pull(self._fraction)

    def carry(self, mass: float) -> None:
        """Do nothing: a vacuum does not depend on the load."""

    def grip_harder(self, factor: float) -> None:
        """Do nothing: the vacuum is as large as it gets."""

    def pad_points(self) -> dict[str, FloatArray]:
        """Return the middle of the lip, in W, once it has touched."""
        center, _ = self._lip()
        return dict.fromkeys(self.touching, center)

    def reason_of(self, loss: Reason) -> Reason:
        """Return the reason of a loss: the vacuum was lost, or else `loss`."""
        return "pulled_off" if self._leaks else loss

    def release(self) -> None:
        """End the vacuum."""
        self._fraction = 0.0
        self._scene.pull(None)
        self._posture = self._relaxed
        self._command()

    def open(self, fraction: float) -> None:
        """Relax: a cup has nothing to open."""
        self._command()

    def _command(self) -> None:
        self._scene.command_fingers(self._posture, np.zeros(len(self._posture)))

    def _pull(self, fraction: float) -> None:
        """Pull with a fraction of the largest force, or lose the vacuum."""
        self._command()
        self._leaks |= not self._seals(replace(self._cup, travel=_OFF_LIP))
        self._fraction = 0.0 if self._leaks else fraction
        if not self._fraction:
            self._scene.pull(None)
            return
        center, axis = self._lip()
        self._scene.pull(HandContact(self._pad.link, center, -axis, -self.exerted * axis))

    def _seals(self, cup: Cup) -> bool:
        """Return whether the lip seals on the true object, where it is now."""
        X_WO = self._scene.X_WO
        center, axis = self._lip()
        p_OC, axis_O = apply_inverse(X_WO, center), rotate_back(X_WO, axis)
        return bool(press_cups(self._truth, p_OC[None], -axis_O[None], cup).sealed[0])

    def _lip(self) -> tuple[FloatArray, FloatArray]:
        """Return the middle (3,) [m] of the lip and its outward axis (3,), in W."""
        X_WL = self._scene.X_WL(self._pad.link)
        return apply_pose(X_WL, self._pad.center_L), rotate(X_WL, self._pad.axis_L)

    def _lip_contacts(self) -> list[HandContact]:
        return [c for c in self._scene.contacts() if c.link == self._pad.link]
