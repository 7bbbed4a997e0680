"""Contacts of flat pads near their fingertips, so that low objects can be grasped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lis_grasp.geometry import apply_pose, rotate
from lis_grasp.grasping.contact_sets import ContactSets
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import Pad
from lis_grasp.typing import FloatArray

_FACE_DEPTH = 0.001  # [m]: parts of a link this near to the plane of its pad belong to the pad
_BORDER = 0.0005  # [m] of a flat pad at the fingertip without contacts
_STEEP = 0.2  # least descent of the approach per metre at which the palm rises by going back


def fingertip_offsets(hand: Hand) -> FloatArray:
    """Return the way from each pad's centre to the end of its flat face, shape (F, 3) [m].

    In the frame of the pad's link, along the hand's approach as far as the link's collision bodies
    reach in the plane of the pad. Zero for rounded pads, which touch in any direction anyway.
    """
    posture = next(iter(hand.pregrasps.values()))
    links = hand.forward_kinematics(np.eye(4), posture)
    return np.array([_to_fingertip(hand, pad, links[pad.link][:3, :3]) for pad in hand.pads])


def _to_fingertip(hand: Hand, pad: Pad, R_HL: FloatArray) -> FloatArray:
    ahead = R_HL.T @ hand.approach_H
    ahead = ahead - (ahead @ pad.axis_L) * pad.axis_L
    length = float(np.linalg.norm(ahead))
    if pad.radius > 0.0 or length < 1e-6:
        return np.zeros(3)
    ahead /= length
    points = [
        apply_pose(geometry.X_LG, geometry.mesh.vertices) - pad.center_L
        for geometry in hand.link_geometries
        if geometry.link == pad.link
    ]
    relative = np.vstack([np.zeros((1, 3)), *points])
    on_face = np.abs(relative @ pad.axis_L) < _FACE_DEPTH
    return max(float((relative[on_face] @ ahead).max()) - _BORDER, 0.0) * ahead


class FingertipContacts:
    """Moves contacts on flat pads from their centres towards the fingertips, off the support.

    The pads of a hand are tall, so that with the contacts at their centres the fingertips would be
    inside the support where an object is low. The palm goes back along its approach until the hand
    clears the height `floor` [m], or until the contacts are at the fingertips.
    """

    def __init__(self, hand: Hand, checker: HandCollisionChecker, *, floor: float | None) -> None:
        self._hand, self._checker, self._floor = hand, checker, floor
        self._offsets = fingertip_offsets(hand)
        self._reach = float(np.linalg.norm(self._offsets, axis=1).min())
        self._radii = np.array([pad.radius for pad in hand.pads])

    def move(
        self, contacts: ContactSets, X_OH: FloatArray, q: FloatArray
    ) -> tuple[ContactSets, FloatArray]:
        """Return the contact sets with offsets, and initial palm poses (B, 4, 4) moved back.

        `X_OH` (B, 4, 4) and `q` (B, J) are the initial guess of the inverse kinematics.
        """
        if self._floor is None or self._reach <= 0.0:
            return contacts, X_OH
        moved = X_OH.copy()
        targets = contacts.points + self._radii[:, None] * contacts.normals
        used = contacts.used[..., None]
        off = np.where(used, targets - self._hand.pad_centers(X_OH, q), 0.0)
        moved[:, :3, 3] += off.sum(axis=1) / used.sum(axis=1)  # pads at their centres
        approach = rotate(moved, self._hand.approach_H)
        low = self._floor - self._checker.lowest(moved[:, None] @ self._checker.poses_in_hand(q))
        back = np.clip(low / np.maximum(-approach[:, 2], _STEEP), 0.0, self._reach)
        moved[:, :3, 3] -= back[:, None] * approach
        offsets = (back / self._reach)[:, None, None] * self._offsets
        return replace(contacts, offsets=offsets), moved
