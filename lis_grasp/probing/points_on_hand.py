"""Points all over the bodies of a hand in a probe posture, for collision checks."""

from __future__ import annotations

import numpy as np

from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_parts import ProbePosture
from lis_grasp.typing import FloatArray

# Spacing of the points; links are thicker [m].
_SPACING = 0.015


class PointsOnHand:
    """Points on the surfaces of a hand's bodies, at most 15 mm apart."""

    def __init__(self, hand: Hand) -> None:
        self._hand = hand
        self._points_L: list[tuple[str, FloatArray]] = []  # (P, 3) [m] of each body, and its link
        for geometry in hand.link_geometries:
            points = np.asarray(geometry.mesh.subdivide_to_size(_SPACING).vertices)
            R_LG, p_LG = geometry.X_LG[:3, :3], geometry.X_LG[:3, 3]
            self._points_L.append((geometry.link, points @ R_LG.T + p_LG))

    def on_all_links(self, posture: ProbePosture) -> FloatArray:
        """Return points on all links, (P, 3), in H [m]."""
        return self._points(posture, frozenset())

    def on_inner_links(self, posture: ProbePosture) -> FloatArray:
        """Return points on the links that are no fingertips, (P, 3), in H [m]."""
        return self._points(posture, self._hand.fingertip_links)

    def _points(self, posture: ProbePosture, left_out: frozenset[str]) -> FloatArray:
        links = self._hand.forward_kinematics(np.eye(4), posture.joint_positions)
        points = [np.empty((0, 3))]
        for link, points_L in self._points_L:
            if link not in left_out:
                points.append(points_L @ links[link][:3, :3].T + links[link][:3, 3])
        # One point in each cell of half the spacing is enough.
        every = np.concatenate(points)
        _, first = np.unique(np.round(2.0 * every / _SPACING), axis=0, return_index=True)
        return every[np.sort(first)]
