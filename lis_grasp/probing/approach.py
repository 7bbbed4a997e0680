"""How a hand gets to where a probe starts: posture, pose and a straight way in, past the known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.exploration.probe import Probe
from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_parts import ProbePosture
from lis_grasp.typing import FloatArray

# Turns about the finger, +x, that are tried, (8, 3, 3).
_TURNS = Rotation.from_rotvec(np.pi / 4.0 * np.arange(8)[:, None] * np.eye(3)[0]).as_matrix()
# The hand is looked at in points this far apart at the most, at places this far apart on its way;
# links are thicker than either [m].
_POINT_SPACING, _WAY_SPACING = 0.015, 0.01

# Where else a finger may point than along the motion, +x: 45 and 90 degrees off, from all sides.
_AROUND = np.pi / 3.0 * np.arange(6)
_ASLANT = np.array(
    [
        [np.cos(off), np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)]
        for off in (np.pi / 4.0, np.pi / 2.0)
        for around in _AROUND
    ]
)

NO_FREE_START = "no finger and turn of the hand is free at the start"
NO_FREE_WAY = "no finger and turn of the hand has a straight way in past what is known"


@dataclass(frozen=True, slots=True, eq=False)
class Approach:
    """A hand at the start of a probe, and the way in that leads there.

    Parameters
    ----------
    posture
        The leading finger, and the positions of all joints.
    X_OH
        Shape (4, 4): the palm where the probe's motion starts.
    axis
        Shape (3,), unit, in O: where the finger points, and the way in.
    run_in
        Length of the way in [m].
    """

    posture: ProbePosture
    X_OH: FloatArray
    axis: FloatArray
    run_in: float

    @property
    def X_OH_outside(self) -> FloatArray:
        """Pose (4, 4) of the palm where the way in begins."""
        outside = self.X_OH.copy()
        outside[:3, 3] -= self.run_in * self.axis
        return outside


class ApproachPlanner:
    """Finds approaches of a hand to probes.

    A hand in a probe posture is one rigid body with a finger that leads, so its wrist's pose at a
    start follows in closed form from where the finger points, and the turn about the finger. The
    finger points and comes in along the probe's motion; where that is blocked, as in a bore, it
    comes in aslant or square to the motion, and touches with its side.

    Parameters
    ----------
    hand
        The hand; it needs a probe posture.
    finger
        The leading finger; None for the first that has an approach.

    Raises
    ------
    InvalidHandError
        If the hand has no probe posture (for that finger).
    """

    def __init__(self, hand: Hand, finger: str | None) -> None:
        postures = hand.probe_postures
        if not postures or finger not in (None, *postures):
            raise InvalidHandError(
                f"touching needs a probe posture; hand '{hand.name}' has"
                f" {', '.join(postures) or 'none'}: add {finger or 'one'} to its YAML"
            )
        chosen = tuple(postures.values()) if finger is None else (postures[finger],)
        self._bodies = [(posture, *_in_palm(hand, posture)) for posture in chosen]

    def plan(self, probe: Probe, known: KnownShape) -> Approach | None:
        """Return the first approach that keeps clear of what is known; None if there is none."""
        centers = [probe.start - posture.radius * probe.direction for posture, _, _ in self._bodies]
        if known.blocks(np.array(centers)).all():
            return None
        for axis in np.vstack([probe.direction, _ASLANT @ rotation_to_x(probe.direction)]):
            for posture, center_H, points_H in self._bodies:
                center = probe.start - posture.radius * probe.direction
                run_in = float(known.space.way_in(center, axis))
                turned = list(_turned(posture, center_H, probe, axis, run_in))
                X_OH = np.array([approach.X_OH for approach in turned])  # (R, 4, 4)
                points = points_H @ X_OH[:, :3, :3].transpose(0, 2, 1) + X_OH[:, None, :3, 3]
                for k in np.flatnonzero(~self._blocked(points, known)):
                    if not self._blocked_on_the_way(points[k], axis, run_in, known):
                        return turned[k]
        return None

    def starts(self, probe: Probe) -> Iterator[Approach]:
        """Yield every approach without a way in, whatever is known."""
        for posture, center_H, _ in self._bodies:
            yield from _turned(posture, center_H, probe, probe.direction, 0.0)

    def _blocked(self, points: FloatArray, known: KnownShape) -> npt.NDArray[np.bool_]:
        """Tell which places of the hand, points (R, P, 3), meet the known, shape (R,)."""
        blocked = known.blocks(points.reshape(-1, 3))
        return np.asarray(blocked.reshape(points.shape[:2]).any(axis=1))

    def _blocked_on_the_way(
        self, points: FloatArray, axis: FloatArray, run_in: float, known: KnownShape
    ) -> bool:
        """Tell whether the hand, with points (P, 3) at the start, meets the known before it."""
        back = np.arange(_WAY_SPACING, run_in + _WAY_SPACING, _WAY_SPACING)  # (S,)
        places = points - np.minimum(back, run_in)[:, None, None] * axis  # (S, P, 3)
        return bool(self._blocked(places, known).any())


def _turned(
    posture: ProbePosture, center_H: FloatArray, probe: Probe, axis: FloatArray, run_in: float
) -> Iterator[Approach]:
    """Yield approaches, one a turn about the axis: the leading point at the probe's start."""
    center_O = probe.start - posture.radius * probe.direction
    R_OX, R_XH = rotation_to_x(axis).T, rotation_to_x(posture.direction_H)
    for roll in _TURNS:
        X_OH = np.eye(4)
        X_OH[:3, :3] = R_OX @ roll @ R_XH
        X_OH[:3, 3] = center_O - X_OH[:3, :3] @ center_H
        yield Approach(posture, X_OH, axis, run_in)


def _in_palm(hand: Hand, posture: ProbePosture) -> tuple[FloatArray, FloatArray]:
    """Return the leading sphere's centre (3,) and points all over the hand (P, 3), in H [m]."""
    links = hand.forward_kinematics(np.eye(4), posture.joint_positions)
    X_HL = links[posture.link]
    points = []
    for geometry in hand.link_geometries:
        X_HG = links[geometry.link] @ geometry.X_LG
        fine = geometry.mesh.subdivide_to_size(_POINT_SPACING)
        points.append(np.asarray(fine.vertices) @ X_HG[:3, :3].T + X_HG[:3, 3])
    # One point for each cell of the spacing is as good as many.
    every = np.concatenate(points)
    _, first = np.unique(np.round(2.0 * every / _POINT_SPACING), axis=0, return_index=True)
    return X_HL[:3, :3] @ posture.center_L + X_HL[:3, 3], every[np.sort(first)]


def rotation_to_x(direction: FloatArray) -> FloatArray:
    """Return a rotation, shape (3, 3), that takes the unit `direction` to +x."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    y = np.cross(direction, helper)
    y /= np.linalg.norm(y)
    return np.vstack([direction, y, np.cross(direction, y)])
