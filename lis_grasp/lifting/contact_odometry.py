"""Motion of an object in the hand by the motion of the links that touch it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import (
    apply_inverse,
    apply_pose,
    cross_matrix,
    inverse_pose,
    make_pose,
    rotate,
    rotate_back,
    unit,
)
from lis_grasp.lifting.scene import HandContact
from lis_grasp.typing import FloatArray

# Deviations of an object's motion from that of a link that touches it, along the normal and across
# [m]; and of its motion by itself [rad, m].
_ALONG, _ACROSS = 0.0003, 0.0006
_TURNING, _FREE = 0.08, 0.004
# Weight of the latter while the links move it, so that no motion that they determine is shortened.
_WEAK = 0.01
_LEAST_FORCE = 1e-6  # [N], so that contacts without a force have no weight

_OWN_INFORMATION = np.diag(1.0 / np.repeat([_TURNING, _FREE], 3) ** 2)  # (6, 6)


@dataclass(frozen=True, slots=True, eq=False)
class _Touches:
    """C contacts: the links, the points fixed on them in L and in H [m], the normals in H."""

    links: tuple[str, ...]
    p_L: FloatArray  # (C, 3)
    points: FloatArray  # (C, 3)
    normals: FloatArray  # (C, 3)
    grips: FloatArray  # (C,): forces as fractions of the largest


class ContactOdometry:
    """Tracks the pose of an object in the palm by the motion of the links that touch it.

    Where a link touches, the object moves as the link does: along the normal, and across it if the
    contact sticks or rolls (Murray, Li & Sastry 1994, ch. 5). Between two updates, its motion is
    the one that fits this best, with weights; by itself the object stays where it was, on its table
    or, lifted, in the palm.

    Parameters
    ----------
    X_WH, X_WO
        Shape (4, 4): palm and object before the hand touches it.
    center
        Shape (3,): the object's centre, in O [m].
    """

    def __init__(self, X_WH: FloatArray, X_WO: FloatArray, center: FloatArray) -> None:
        self.X_HO = inverse_pose(X_WH) @ X_WO
        self._center = center
        self._X_WH = X_WH
        self._touches: _Touches | None = None

    def update(
        self,
        X_WH: FloatArray,
        X_WL: Callable[[str], FloatArray],
        contacts: Sequence[HandContact],
        *,
        stands: bool,
    ) -> None:
        """Move the object with the links since the last update.

        `X_WL` gives the pose of a link, `contacts` are those now, in W, and `stands` says whether
        the object is still on the table.
        """
        X_HW = inverse_pose(X_WH)
        alone = X_HW @ self._X_WH if stands else np.eye(4)
        self.X_HO, self._X_WH = alone @ self.X_HO, X_WH
        before = self._touches
        if before is not None:
            start, middle = apply_pose(alone, before.points), apply_pose(self.X_HO, self._center)
            at = [X_WL(link) for link in before.links]
            in_world = [apply_pose(X, p) for X, p in zip(at, before.p_L, strict=True)]
            moved = apply_pose(X_HW, np.array(in_world)) - start
            # What slides over the object pushes it less than what holds it.
            weights = before.grips[:, None, None] * _weights(rotate(alone, before.normals))
            rows = _rows(start - middle)
            information = np.einsum("cki,ckl,clj->ij", rows, weights, rows)
            information += _WEAK * _OWN_INFORMATION
            pushed = np.einsum("cki,ckl,cl->i", rows, weights, moved)
            twist = np.linalg.solve(information, pushed)
            R = Rotation.from_rotvec(twist[:3]).as_matrix()
            self.X_HO = make_pose(R, middle + twist[3:] - R @ middle) @ self.X_HO
        self._touches = None
        if contacts:
            forces = np.array([contact.strength for contact in contacts])
            self._touches = _Touches(
                tuple(contact.link for contact in contacts),
                np.array([apply_inverse(X_WL(each.link), each.point) for each in contacts]),
                apply_pose(X_HW, np.array([contact.point for contact in contacts])),
                rotate_back(X_WH, np.array([contact.normal for contact in contacts])),
                forces / max(forces.max(), _LEAST_FORCE),
            )

    def covariance(self) -> FloatArray:
        """Return the covariance (6, 6) of turn [rad] and displacement of the centre [m], in H.

        Contacts limit it; where none does, the object may have moved by itself.
        """
        information = _OWN_INFORMATION.copy()
        if (now := self._touches) is not None:
            # A contact turns about its normal unnoticed, so each link counts as one point.
            each = [np.array(now.links) == link for link in dict.fromkeys(now.links)]
            points = np.array([now.points[one].mean(axis=0) for one in each])
            normals = unit(np.array([now.normals[one].sum(axis=0) for one in each]), least=1e-9)
            rows = _rows(points - apply_pose(self.X_HO, self._center))
            information += np.einsum("cki,ckl,clj->ij", rows, _weights(normals), rows)
        return np.asarray(np.linalg.inv(information))


def _weights(normals: FloatArray) -> FloatArray:
    """Return the inverse covariances (C, 3, 3) of motions over links, by normals (C, 3)."""
    along = normals[:, :, None] * normals[:, None, :]
    return np.asarray(along / _ALONG**2 + (np.eye(3) - along) / _ACROSS**2)


def _rows(arms: FloatArray) -> FloatArray:
    """Return how a twist moves points at arms (C, 3) from the centre, shape (C, 3, 6)."""
    return np.concatenate([-cross_matrix(arms), np.broadcast_to(np.eye(3), (len(arms), 3, 3))], 2)
