"""Finger control of a lift: guarded closing, a squeeze with balanced forces, slip sensing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import apply_inverse, apply_pose, rotate_back, unit
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.hand_capacity import EFFORT_FRACTION, balanced_grip
from lis_grasp.grasping.inverse_kinematics import solve_ik
from lis_grasp.lifting.outcome import Reason
from lis_grasp.lifting.scene import HandContact, LiftingScene, Touched
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.typing import FloatArray

TOUCH_FORCE = 0.2
"""Force at which a finger stops closing [N]: the weight of a few coins."""
# Force on the table at which a finger stops searching the object [N].
_TABLE_FORCE = 1.0
_CLOSING_SPEED = 0.05  # [m/s] of the fastest pad
SEARCH_SPEED = 0.03
"""Speed of a pad, or of a wrist with a fixed jaw, that searches its contact [m/s]."""
# Squeezing forces are well inside the friction cones if possible: the lift adds a load.
_CONE_FRACTIONS = (0.6, 0.8, 1.0)
_ENOUGH = 0.9  # fraction of the wanted grip that a narrower cone must give
# Fraction by which a squeeze command moves the springs' rest posture to the measured one: fingers
# settle where the object is, not where the estimate was.
_YIELD = 0.1
# Weights of a searching pad's sideways motion [1] and of joint motion [m] against its progress.
_SIDEWAYS_WEIGHT = 0.3
_STEP_WEIGHT = 3e-3
# Plans of grip forces until one is within the efforts.
_TRIES = 6
_ROOM = 1e-6  # least distance between the bounds of a least-squares problem


@dataclass(frozen=True, slots=True, eq=False)
class _FingerContact:
    """A contact point (3,), fixed on a link in its frame L [m], and the normal (3,) there in W."""

    link: str
    point: FloatArray
    normal: FloatArray


class FingerControl:
    """Controls the fingers of a hand through a grasp, from measured contacts.

    Guarded closing: every finger moves from the pregrasp to its planned posture, then along the
    planned contact normal, until it touches. Pads that slide on the table move along it. Then all
    touching fingers push with forces that balance each other at the measured points and normals
    (`balanced_grip`): joint torques ``tau = J^T f`` on top of soft springs that hold the posture.
    Once the object is weighed, they balance its weight too, so that the springs do not yield to it.
    """

    def __init__(self, scene: LiftingScene, setup: LiftSetup) -> None:
        self._scene, self._setup, self._hand = scene, setup, setup.hand
        hand, grasp = setup.hand, setup.grasp
        self._finger_of_link = hand.link_fingers
        self._pads = {pad.finger: pad for pad in hand.pads}
        self._joints = {finger: list(hand.finger_joints(finger)) for finger in hand.fingers}
        self._planned_normals = _normals_by_finger(grasp, hand)
        self._start = np.array(grasp.pregrasp_positions, dtype=np.float64)
        self._goal = np.array(grasp.joint_positions, dtype=np.float64)
        self._posture = self._start.copy()  # rest posture of the springs, (J,)
        self._searched = dict.fromkeys(self._planned_normals, 0.0)
        for finger, p, n in zip(
            grasp.contact_fingers, grasp.contact_points, grasp.contact_normals, strict=True
        ):
            if n[2] > 0.0:  # a pad on top of the object does not search inside the table
                room = (p[2] - setup.support_height) / n[2]
                self._searched[finger] = max(setup.options.search_distance - room, 0.0)
        self._grip = setup.grip_force(setup.options.assumed_mass or setup.mass)  # [N]
        self._contacts: dict[str, _FingerContact] = {}
        self._forces: dict[str, FloatArray] = {}  # on the object, in the palm's frame H
        self.exerted = 0.0  # sum of their normal parts [N]
        self._p_OC = np.asarray(setup.mesh.center_mass)
        self._weight: FloatArray | None = None  # (3,) [N], once the hand has weighed the object
        travel = hand.pad_centers(np.eye(4), np.stack([self._start, self._goal]))  # (2, F, 3)
        longest = float(np.linalg.norm(travel[1] - travel[0], axis=-1).max())
        self._closing_time = max(longest / _CLOSING_SPEED, 0.1)
        middle = 0.5 * (self._start + self._goal)
        self._bulge = np.zeros_like(middle)  # of the path of postures half way, (J,)
        if setup.slides_on_table:
            batch = GraspBatch.of_grasps([grasp], hand)
            radii = np.array([pad.radius for pad in hand.pads])[:, None]
            points = apply_pose(batch.X_OH, travel.mean(axis=0)) - radii * batch.normals
            half_way = replace(batch, points=points, q=middle[None])
            self._bulge = solve_ik(hand, half_way, palm_fixed=True).q[0] - middle

    @property
    def touching(self) -> tuple[str, ...]:
        """The fingers of the grasp that have touched the object."""
        return tuple(finger for finger in self._planned_normals if finger in self._contacts)

    def measured_contacts(self) -> Contacts:
        """Return the contacts of the touching fingers, in W."""
        fingers = self.touching
        contacts = [self._contacts[finger] for finger in fingers]
        return Contacts(
            np.reshape([self._point(contact) for contact in contacts], (-1, 3)),
            np.reshape([contact.normal for contact in contacts], (-1, 3)),
            fingers=fingers,
        )

    def is_seated(self) -> bool:
        """Return whether every fixed finger of the grasp touches the object."""
        measured = self._contacts_by_finger()
        fixed = [finger for finger in self._planned_normals if not self._joints[finger]]
        return all(self._strongest(measured.get(finger, [])) is not None for finger in fixed)

    def way_to_seat(self) -> FloatArray:
        """Return the direction (3,) in W in which a fixed jaw moves against its planned normal."""
        normals = [n for finger, n in self._planned_normals.items() if not self._joints[finger]]
        return -np.sum(normals, axis=0)

    def close(self, elapsed: float, interval: float) -> bool:
        """Close the fingers for `interval` [s]; return whether all have finished."""
        q = self._scene.joint_positions
        measured = self._contacts_by_finger()
        on_table = self._contacts_by_finger("table") if self._setup.slides_on_table else {}
        blocked = {
            finger
            for finger, contacts in on_table.items()
            if sum(contact.strength for contact in contacts) > _TABLE_FORCE
        }
        part = min(elapsed / self._closing_time, 1.0)
        limit = self._setup.options.search_distance
        moving = False
        for finger, joints in self._joints.items():
            if finger in self._contacts:
                continue
            contact = self._strongest(measured.get(finger, []))
            if contact is not None:
                self._contacts[finger] = contact
                self._posture[joints] = q[joints]
            elif not joints:
                continue
            elif part < 1.0:
                motion = self._goal[joints] - self._start[joints]
                self._posture[joints] = self._start[joints] + part * motion
                self._posture[joints] += 4.0 * part * (1.0 - part) * self._bulge[joints]
                moving = True
            elif self._searched.get(finger, limit) < limit:
                if finger not in blocked:
                    self._search(finger, SEARCH_SPEED * interval)
                self._searched[finger] += SEARCH_SPEED * interval
                moving = True
        self._scene.command_fingers(self._posture, np.zeros(len(q)))
        return not moving

    def refusal(
        self, measured: Contacts, accept_grasp: Callable[[Contacts], bool] | None
    ) -> Reason | None:
        """Return why closed fingers do not squeeze: the tactile check, or too few contacts."""
        if accept_grasp is not None and not accept_grasp(measured):
            return "aborted"
        return "no_contact" if len(measured) < 2 else None

    def reason_of(self, loss: Reason) -> Reason:
        """Return the reason of a loss, which fingers do not know better."""
        return loss

    def squeeze(self, fraction: float) -> None:
        """Push with a fraction of the grip force; plan the forces from the measured contacts."""
        measured = self._contacts_by_finger()
        for finger in self._planned_normals:
            contact = self._strongest(measured.get(finger, []))
            if contact is not None:
                self._contacts[finger] = contact
        self._plan_forces()
        if fraction < 1.0:
            self._posture += _YIELD * (self._scene.joint_positions - self._posture)
        self._scene.command_fingers(self._posture, fraction * self._efforts(self._forces))

    def carry(self, mass: float) -> None:
        """Plan the forces again for a weighed mass [kg], so that they balance its weight."""
        self._grip = max(self._grip, self._setup.grip_force(mass))
        self._weight = np.array([0.0, 0.0, -GRAVITY * mass])
        self._plan_forces()

    def grip_harder(self, factor: float) -> None:
        """Plan the forces again with a grip force that is larger by a factor."""
        self._grip *= factor
        self._plan_forces()

    def pad_points(self) -> dict[str, FloatArray]:
        """Return the contact point (3,) on each touching finger's link, in W."""
        return {finger: self._point(self._contacts[finger]) for finger in self.touching}

    def release(self) -> None:
        """Stop pushing: the springs keep the present posture."""
        self._contacts, self._forces = {}, {}
        self._posture = np.array(self._scene.joint_positions)
        self._scene.command_fingers(self._posture, np.zeros(len(self._start)))

    def open(self, fraction: float) -> None:
        """Open the hand by a fraction of the way from the released posture to the pregrasp."""
        posture = self._posture + min(fraction, 1.0) * (self._start - self._posture)
        self._scene.command_fingers(posture, np.zeros(len(self._start)))

    def hold(self) -> None:
        """Keep pushing with the planned forces, which rotate with the palm."""
        self._scene.command_fingers(self._posture, self._efforts(self._forces))

    def _contacts_by_finger(self, on: Touched = "object") -> dict[str, list[HandContact]]:
        contacts: dict[str, list[HandContact]] = {}
        for contact in self._scene.contacts(on):
            finger = self._finger_of_link.get(contact.link)
            if finger is not None:
                contacts.setdefault(finger, []).append(contact)
        return contacts

    def _strongest(self, contacts: list[HandContact]) -> _FingerContact | None:
        """Return the strongest contact of a finger; None if its total force is too small."""
        if not contacts:
            return None
        strengths = [contact.strength for contact in contacts]
        if sum(strengths) < TOUCH_FORCE:
            return None
        contact = contacts[int(np.argmax(strengths))]
        p_L = apply_inverse(self._scene.X_WL(contact.link), contact.point)
        return _FingerContact(contact.link, p_L, contact.normal)

    def _search(self, finger: str, distance: float) -> None:
        """Move a pad against its planned normal by `distance`; at a joint limit it may deviate."""
        pad, joints = self._pads[finger], self._joints[finger]
        J = self._scene.jacobian(pad.link, pad.center_L)[:, joints]  # (3, K)
        n = self._planned_normals[finger]
        sideways = _SIDEWAYS_WEIGHT * (np.eye(3) - np.outer(n, n))
        matrix = np.vstack([n @ J, sideways @ J, _STEP_WEIGHT * np.eye(len(joints))])
        wanted = np.concatenate([[-distance], np.zeros(3 + len(joints))])
        q = self._posture[joints]
        room = self._hand.lower[joints] - q - _ROOM, self._hand.upper[joints] - q + _ROOM
        self._posture[joints] = q + lsq_linear(matrix, wanted, bounds=room).x

    def _plan_forces(self) -> None:
        fingers = self.touching
        if not fingers:
            self._forces = {}
            return
        contacts = [self._contacts[finger] for finger in fingers]
        points = np.array([self._point(contact) for contact in contacts])
        normals = np.array([contact.normal for contact in contacts])
        wanted, load = self._grip, None
        if self._weight is not None:
            load = self._weight, apply_pose(self._scene.X_WO, self._p_OC)
        for _ in range(_TRIES):
            forces = balanced_forces(points, normals, self._setup.grip_friction, wanted, load)
            in_hand = rotate_back(self._scene.X_WH, forces)
            self._forces = dict(zip(fingers, in_hand, strict=True))
            self.exerted = -float(np.sum(forces * normals))
            exerted = self._exerted(forces, normals)
            if exerted <= 1.0:
                return
            wanted /= exerted
        # Scaled together so that no finger pushes harder than it can.
        self._forces = {finger: force / exerted for finger, force in self._forces.items()}
        self.exerted /= exerted

    def _exerted(self, forces: FloatArray, normals: FloatArray) -> float:
        """Return the planned forces (C, 3) as a fraction of what the fingers can exert."""
        strongest = float(np.abs(np.sum(forces * normals, axis=1)).max())
        efforts = self._efforts(self._forces)
        return max(
            strongest / self._hand.max_contact_force,
            float(np.max(np.abs(efforts) / (EFFORT_FRACTION * self._hand.effort_limits))),
        )

    def _efforts(self, forces: dict[str, FloatArray]) -> FloatArray:
        """Return the joint efforts (J,) with which the fingers exert forces, given in H."""
        efforts = np.zeros(len(self._hand.joint_names))
        R_WH = self._scene.X_WH[:3, :3]
        for finger, force in forces.items():
            contact, joints = self._contacts[finger], self._joints[finger]
            efforts[joints] += (
                self._scene.jacobian(contact.link, contact.point)[:, joints].T @ R_WH @ force
            )
        return efforts

    def _point(self, contact: _FingerContact) -> FloatArray:
        return apply_pose(self._scene.X_WL(contact.link), contact.point)


def balanced_forces(
    points: FloatArray,
    normals: FloatArray,
    friction: float,
    wanted: float,
    load: tuple[FloatArray, FloatArray] | None,
) -> FloatArray:
    """Return forces (C, 3) on the object, inside the narrowest cones in which they balance.

    Their normal parts add up to `wanted` [N]; cones are at most as wide as `friction` allows.
    For points, normals and the load see `balanced_grip`.
    """
    cones = [fraction * friction for fraction in _CONE_FRACTIONS]
    for cone in cones:
        forces = balanced_grip(points, normals, friction=cone, total=wanted, load=load)
        total = -float(np.sum(forces * normals))
        if total >= _ENOUGH * wanted:
            return forces
    # Without balance: the least unbalanced full squeeze; table and palm take the rest.
    if total <= 0.0:  # every push would add to the load
        forces = balanced_grip(points, normals, friction=cones[-1], total=wanted)
        total = -float(np.sum(forces * normals))
    return forces * (wanted / total)


def _normals_by_finger(grasp: Grasp, hand: Hand) -> dict[str, FloatArray]:
    """Return the mean planned normal of each finger of the grasp, outward of the object."""
    sums: dict[str, FloatArray] = {}
    for finger, normal in zip(grasp.contact_fingers, grasp.contact_normals, strict=True):
        if finger in hand.fingers:
            sums[finger] = sums.get(finger, np.zeros(3)) + normal
    return {finger: unit(total) for finger, total in sums.items()}
