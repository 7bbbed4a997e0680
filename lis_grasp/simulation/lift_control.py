"""Close the fingers until each one touches, then squeeze with forces that balance each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from lis_grasp.contacts import Contacts
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.grip_forces import balanced_grip
from lis_grasp.hands.hand import Hand
from lis_grasp.simulation.lift_scene import LiftScene, Touch
from lis_grasp.typing import FloatArray

# What a fingertip must feel before its finger stops: the weight of a few coins.
_TOUCH_FORCE = 0.2  # [N]
_CLOSING_SPEED = 0.05  # [m/s] of the fastest pad
_SEARCH_SPEED = 0.03  # [m/s] of a pad that is past its planned contact and still feels nothing
# Squeezing forces stay well inside the friction cones where they can: a load is yet to come.
_CONE_SHARES = (0.6, 0.8, 1.0)
_ENOUGH = 0.9  # of the wanted grip, for cones of that share to do
# Joint torques may not all be spent on the squeeze: the springs need some to keep the posture.
_EFFORT_SHARE = 0.9
# Part of the way to the measured posture that the springs' rest posture moves in each command while
# the squeeze builds up: fingers settle where the object lets them, not where the estimate was.
_YIELD = 0.1
# Of a searching pad's sideways motion [1] and of joint motion [m] against its progress.
_SIDEWAYS_WEIGHT, _STEP_WEIGHT = 0.3, 3e-3
_ROOM = 1e-6  # bounds of a least-squares problem must not touch each other


@dataclass(frozen=True, slots=True, eq=False)
class _FingerContact:
    """A point (3,) of a link, fixed on it [m], where a finger pushes; and the normal there in W."""

    link: str
    point: FloatArray
    normal: FloatArray


class FingerControl:
    """Commands the fingers of a hand through a grasp, from what the hand feels.

    Guarded closing: every finger moves from the pregrasp towards its planned posture, and on along
    the planned contact normal, until it touches, and stops there. Then all fingers that touch push
    with forces that balance each other at the felt points and normals (`balanced_grip`), by joint
    torques ``tau = J^T f`` on top of soft springs that hold the posture.

    Parameters
    ----------
    scene
        The running trial.
    hand, grasp
        The hand, and what to execute.
    friction
        Coefficient that the squeeze counts on.
    grip_force
        Wanted sum of the fingers' normal forces [N].
    search_distance
        How far a pad goes beyond its planned contact to find the object [m].
    """

    def __init__(
        self,
        scene: LiftScene,
        hand: Hand,
        grasp: Grasp,
        *,
        friction: float,
        grip_force: float,
        search_distance: float,
    ) -> None:
        self._scene, self._hand = scene, hand
        self._friction, self._grip_force = friction, grip_force
        self._search_distance = search_distance
        self._finger_of_link = hand.link_fingers
        self._pads = {pad.finger: pad for pad in hand.pads}
        self._joints = {finger: list(hand.finger_joints(finger)) for finger in hand.fingers}
        self._planned_normals = _normals_by_finger(grasp, hand)
        self._start = np.array(grasp.pregrasp_positions, dtype=np.float64)
        self._goal = np.array(grasp.joint_positions, dtype=np.float64)
        self._posture = self._start.copy()  # where the springs pull to, (J,)
        self._searched = dict.fromkeys(self._planned_normals, 0.0)
        self._contacts: dict[str, _FingerContact] = {}
        self._forces: dict[str, FloatArray] = {}  # on the object, in the palm's frame H
        travel = hand.pad_centers(np.eye(4), np.stack([self._start, self._goal]))  # (2, F, 3)
        longest = float(np.linalg.norm(travel[1] - travel[0], axis=-1).max())
        self._closing_time = max(longest / _CLOSING_SPEED, 0.1)

    @property
    def fingers(self) -> tuple[str, ...]:
        """The fingers that the grasp uses."""
        return tuple(self._planned_normals)

    @property
    def touching(self) -> tuple[str, ...]:
        """The fingers of the grasp that have felt the object."""
        return tuple(finger for finger in self.fingers if finger in self._contacts)

    def felt(self) -> Contacts:
        """Return where the fingers that touch felt the object, in W."""
        fingers = self.touching
        contacts = [self._contacts[finger] for finger in fingers]
        return Contacts(
            np.reshape([self._point(contact) for contact in contacts], (-1, 3)),
            np.reshape([contact.normal for contact in contacts], (-1, 3)),
            fingers=fingers,
        )

    def close(self, elapsed: float, interval: float) -> bool:
        """Move the fingers on by `interval` [s]; True once none has anywhere to go."""
        q = self._scene.joint_positions
        felt = self._felt_by_finger()
        share = min(elapsed / self._closing_time, 1.0)
        moving = False
        for finger, joints in self._joints.items():
            if finger in self._contacts:
                continue
            contact = self._contact_of(felt.get(finger, []))
            if contact is not None:
                self._contacts[finger] = contact
                self._posture[joints] = q[joints]
            elif share < 1.0:
                way = self._goal[joints] - self._start[joints]
                self._posture[joints] = self._start[joints] + share * way
                moving = True
            elif self._searched.get(finger, self._search_distance) < self._search_distance:
                self._search(finger, _SEARCH_SPEED * interval)
                moving = True
        self._scene.command_fingers(self._posture, np.zeros(len(q)))
        return not moving

    def squeeze(self, share: float) -> None:
        """Push with `share` (0 to 1) of the grip force; plan the forces anew from what is felt."""
        felt = self._felt_by_finger()
        for finger in self.fingers:
            contact = self._contact_of(felt.get(finger, []))
            if contact is not None:
                self._contacts[finger] = contact
        self._plan_forces()
        if share < 1.0:
            self._posture += _YIELD * (self._scene.joint_positions - self._posture)
        self._scene.command_fingers(self._posture, share * self._efforts(self._forces))

    def open(self) -> None:
        """Let go: back to the pregrasp."""
        self._contacts, self._forces = {}, {}
        self._scene.command_fingers(self._start, np.zeros(len(self._start)))

    def hold(self) -> None:
        """Keep pushing with the planned forces, which turn with the palm."""
        self._scene.command_fingers(self._posture, self._efforts(self._forces))

    def _felt_by_finger(self) -> dict[str, list[Touch]]:
        felt: dict[str, list[Touch]] = {}
        for touch in self._scene.touches():
            finger = self._finger_of_link.get(touch.link)
            if finger is not None:
                felt.setdefault(finger, []).append(touch)
        return felt

    def _contact_of(self, touches: list[Touch]) -> _FingerContact | None:
        """Return a finger's strongest contact among `touches`; None if all are too weak."""
        if not touches:
            return None
        strengths = [touch.strength for touch in touches]
        if sum(strengths) < _TOUCH_FORCE:
            return None
        touch = touches[int(np.argmax(strengths))]
        X_WL = self._scene.X_WL(touch.link)
        p_L = X_WL[:3, :3].T @ (touch.point - X_WL[:3, 3])
        return _FingerContact(touch.link, p_L, touch.normal)

    def _search(self, finger: str, distance: float) -> None:
        """Move a finger's pad against its planned normal by `distance`, within the joints' limits.

        Sideways motion costs little: a finger at a limit that cannot go straight goes as it can.
        """
        pad, joints = self._pads[finger], self._joints[finger]
        J = self._scene.jacobian(pad.link, pad.center_L)[:, joints]  # (3, K)
        n = self._planned_normals[finger]
        sideways = _SIDEWAYS_WEIGHT * (np.eye(3) - np.outer(n, n))
        matrix = np.vstack([n @ J, sideways @ J, _STEP_WEIGHT * np.eye(len(joints))])
        wanted = np.concatenate([[-distance], np.zeros(3 + len(joints))])
        q = self._posture[joints]
        room = self._hand.lower[joints] - q - _ROOM, self._hand.upper[joints] - q + _ROOM
        self._posture[joints] = q + lsq_linear(matrix, wanted, bounds=room).x
        self._searched[finger] += distance

    def _plan_forces(self) -> None:
        fingers = self.touching
        if not fingers:
            self._forces = {}
            return
        contacts = [self._contacts[finger] for finger in fingers]
        points = np.array([self._point(contact) for contact in contacts])
        normals = np.array([contact.normal for contact in contacts])
        forces = self._balanced_forces(points, normals)
        R_WH = self._scene.X_WH[:3, :3]
        self._forces = dict(zip(fingers, forces @ R_WH, strict=True))
        # Scaled together, so that they stay in balance: no finger pushes harder than it can.
        strongest = float(np.abs(np.sum(forces * normals, axis=1)).max())
        efforts = self._efforts(self._forces)
        load = max(
            strongest / self._hand.max_contact_force,
            float(np.max(np.abs(efforts) / (_EFFORT_SHARE * self._hand.effort_limits))),
        )
        if load > 1.0:
            self._forces = {finger: force / load for finger, force in self._forces.items()}

    def _balanced_forces(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return forces (C, 3) on the object, inside the narrowest cones that they balance in."""
        for share in _CONE_SHARES:
            forces = balanced_grip(
                points, normals, friction=share * self._friction, total=self._grip_force
            )
            total = -float(np.sum(forces * normals))
            if total >= _ENOUGH * self._grip_force:
                return forces
        # No balance anywhere, as where a jaw first feels a rod at one end of each finger: the least
        # unbalanced squeeze of full strength; table and palm take the rest.
        return forces * (self._grip_force / total)

    def _efforts(self, forces: dict[str, FloatArray]) -> FloatArray:
        """Return the joint efforts (J,) with which the fingers exert forces, in H."""
        efforts = np.zeros(len(self._hand.joint_names))
        R_WH = self._scene.X_WH[:3, :3]
        for finger, force in forces.items():
            contact, joints = self._contacts[finger], self._joints[finger]
            efforts[joints] += (
                self._scene.jacobian(contact.link, contact.point)[:, joints].T @ R_WH @ force
            )
        return efforts

    def _point(self, contact: _FingerContact) -> FloatArray:
        X_WL = self._scene.X_WL(contact.link)
        point: FloatArray = X_WL[:3, :3] @ contact.point + X_WL[:3, 3]
        return point


def _normals_by_finger(grasp: Grasp, hand: Hand) -> dict[str, FloatArray]:
    """Return the mean planned normal of each finger that the grasp uses, outward of the object."""
    sums: dict[str, FloatArray] = {}
    for finger, normal in zip(grasp.contact_fingers, grasp.contact_normals, strict=True):
        if finger in hand.fingers:
            sums[finger] = sums.get(finger, np.zeros(3)) + normal
    return {finger: total / np.linalg.norm(total) for finger, total in sums.items()}
