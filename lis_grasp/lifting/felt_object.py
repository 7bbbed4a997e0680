"""Pose of the held object as a hand feels it in a lift."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import apply_inverse, inverse_pose, rotate_back
from lis_grasp.lifting.contact_odometry import ContactOdometry
from lis_grasp.lifting.pose_in_hand import PoseInHand, locate_in_hand
from lis_grasp.lifting.scene import LiftingScene
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.typing import FloatArray


class FeltObject:
    """What a hand feels of the object: contacts, normals and the poses of its own links.

    The object is believed to stand where it was known, with `LiftOptions.place_deviations`. From
    `begin` on, the links that touch it carry it along (`ContactOdometry`). Its pose is then
    corrected by where the estimate meets the contacts (`locate_in_hand`).
    """

    def __init__(self, scene: LiftingScene, setup: LiftSetup) -> None:
        self._scene, self._setup = scene, setup
        known = setup.estimate
        self._center = np.asarray(
            setup.grasp.contact_points.mean(axis=0) if known is None else known.bounds.mean(axis=0)
        )
        self._odometry: ContactOdometry | None = None
        self.is_lifted = False

    def begin(self) -> None:
        """Follow the object from now on: the hand is about to close."""
        self._odometry = ContactOdometry(self._scene.X_WH, np.eye(4), self._center)

    def update(self) -> None:
        """Follow the object to where the links are now, if it is followed."""
        if self._odometry is not None:
            scene = self._scene
            self._odometry.update(
                scene.X_WH, scene.X_WL, scene.contacts(), stands=not self.is_lifted
            )

    def pose(self) -> PoseInHand | None:
        """Return the pose of the object in the palm; None before the hand closes."""
        odometry = self._odometry
        if odometry is None:
            return None
        self.update()
        rng = np.random.default_rng(0)  # the same pose in equal lifts
        spread = odometry.covariance() + self._of_place(odometry.X_HO)
        felt = PoseInHand.normal(odometry.X_HO, self._center, spread, rng=rng)
        known, contacts = self._setup.estimate, self._scene.contacts()
        if known is None or not contacts:
            return felt
        X_WH = self._scene.X_WH
        points, normals = (np.array([getattr(c, n) for c in contacts]) for n in ("point", "normal"))
        in_hand = Contacts(apply_inverse(X_WH, points), rotate_back(X_WH, normals))
        return locate_in_hand(felt, in_hand, known, rng=rng)

    def errors(self, pose: PoseInHand) -> tuple[float, float]:
        """Return the distance [m] and the angle [rad] of a pose from the true one, now."""
        X_HO = inverse_pose(self._scene.X_WH) @ self._scene.X_WO @ inverse_pose(self._setup.X_WO)
        return pose.errors(X_HO)

    def _of_place(self, X_HO: FloatArray) -> FloatArray:
        """Return the covariance (6, 6) of the place before the lift, along the palm's axes."""
        aside, turn = self._setup.options.place_deviations
        in_W = np.diag(np.square([0.0, 0.0, turn, aside, aside, 0.0]))
        rotation = block_diag(X_HO[:3, :3], X_HO[:3, :3])
        return np.asarray(rotation @ in_W @ rotation.T)
