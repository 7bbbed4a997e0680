"""Postures for touching by sampling: one fingertip ahead of the rest of the hand."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from lis_grasp.geometry import apply_inverse, apply_pose, rotate_back
from lis_grasp.records import read_only
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.draft._structure import link_points
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_bodies import fibonacci_directions, points_of_bodies
from lis_grasp.robots.robot_model import ProbePosture, joints_to, rigid_groups
from lis_grasp.typing import FloatArray

_SAMPLES = 300  # postures of each finger
_DIRECTIONS = 200  # in which a finger may lead
_LEAST_LEAD, _ENOUGH_LEAD = 0.021, 0.06  # of the tip over all else [m]
_TIP_RADII = (0.003, 0.008)  # [m]
_LEVEL = 0.002  # of the foremost points of a tip [m]
_PARTED, _PARTINGS = 8, 15  # directions whose collisions are resolved, and steps for each


def find_probe_postures(
    hand: Hand, checker: HandCollisionChecker, *, rng: np.random.Generator
) -> dict[str, ProbePosture]:
    """Return a posture by the name of the leading finger, for each finger that can lead.

    For each direction, a finger takes the sampled posture in which its tip is foremost, and every
    other finger the one in which it is farthest back. Of the directions
    with the largest lead the first without a collision is chosen. If all have one, fingers that
    collide take other sampled postures at random, one after the other, until none does (the
    min-conflicts heuristic; Minton et al., 1992).
    """
    search = _Search(hand, rng)
    found = {}
    for finger, pad in enumerate(hand.pads):
        free = (
            posture
            for posture in search.candidates(finger)
            if not checker.self_collisions(posture.joint_positions)
        )
        found[pad.finger] = next(free, None) or search.parted(finger, checker, rng)
    return {finger: posture for finger, posture in found.items() if posture is not None}


class _Search:
    """Extents of links along directions, for sampled postures of each finger."""

    def __init__(self, hand: Hand, rng: np.random.Generator) -> None:
        self._hand = hand
        self._points = link_points(hand)
        self._vertices = {
            link: points_of_bodies(hand.link_geometries, link) for link in self._points
        }
        self._groups = rigid_groups(hand)
        self._directions = fibonacci_directions(_DIRECTIONS)
        self._joints = [list(hand.finger_joints(pad.finger)) for pad in hand.pads]
        rest = np.clip(0.0, hand.lower, hand.upper)
        self._samples = []
        for joints in self._joints:
            q = np.tile(rest, (_SAMPLES, 1))
            fractions = rng.uniform(-0.25, 1.25, (_SAMPLES, len(joints))).clip(0.0, 1.0)
            low, high = hand.lower[joints], hand.upper[joints]
            q[:, joints] = low + fractions * (high - low)
            q[0] = rest
            self._samples.append(q)
        chains = [{j.name for j in joints_to(hand.joints, pad.link)} for pad in hand.pads]
        self._owned = [
            self._moved_by(chain - set().union(*chains[:f], *chains[f + 1 :]))
            if self._joints[f]
            else self._group(hand.pads[f].link)  # a fixed jaw, with its palm
            for f, chain in enumerate(chains)
        ]
        # Extents (S, D) of each finger's links, by finger and link.
        self._extents = [
            self._along(q, owned) for q, owned in zip(self._samples, self._owned, strict=True)
        ]

    def candidates(self, finger: int) -> Iterator[ProbePosture]:
        """Yield postures of a finger that leads, the largest lead first."""
        hand, own = self._hand, self._extents[finger]
        tips = self._group(hand.pads[finger].link)
        ahead = np.max([own[link] for link in own if link in tips], axis=0)  # (S, D)
        free = {
            other: sorted(set(self._joints[other]) - set(self._joints[finger]))
            for other in range(len(hand.pads))
            if other != finger
        }
        folded = {  # row of the sample of each direction, (D,), and its extent
            other: np.max(list(self._extents[other].values()), axis=0).argmin(axis=0)
            for other, joints in free.items()
            if joints
        }
        rivals = set(self._points) - tips - self._owned[finger]
        rivals -= set().union(*(self._owned[other] for other in folded))
        extents = [*self._along(self._samples[finger], rivals).values()]
        extents += [
            np.broadcast_to(self._folded(other, rows, np.arange(_DIRECTIONS)), ahead.shape)
            for other, rows in folded.items()
        ]
        lead = ahead - np.max(extents, axis=0)  # (S, D)
        best = lead.argmax(axis=0)
        largest = lead.max(axis=0)
        for d in np.argsort(-np.minimum(largest, _ENOUGH_LEAD), kind="stable"):
            if largest[d] < _LEAST_LEAD:
                return
            q = self._samples[finger][best[d]].copy()
            for other, rows in folded.items():
                q[free[other]] = self._samples[other][rows[d], free[other]]
            if self._lead(q, self._directions[d], tips) >= _LEAST_LEAD:
                yield self._posture(finger, q, self._directions[d])

    def parted(
        self, finger: int, checker: HandCollisionChecker, rng: np.random.Generator
    ) -> ProbePosture | None:
        """Return a posture of a finger that leads, found by parting fingers that collide."""
        tips = self._group(self._hand.pads[finger].link)
        for posture in islice(self.candidates(finger), _PARTED):
            q, direction = posture.joint_positions.copy(), posture.direction_H
            d = int(np.argmax(self._directions @ direction))
            front = max(e[0, d] for e in self._along(q[None], tips).values())
            for _ in range(_PARTINGS):
                colliding = {link for pair in checker.self_collisions(q) for link in pair}
                if not colliding:
                    return self._posture(finger, q, direction)
                others = [
                    f for f, owned in enumerate(self._owned) if f != finger and owned & colliding
                ]
                if not others:
                    break
                other = int(rng.choice(others))
                joints = sorted(set(self._joints[other]) - set(self._joints[finger]))
                behind = self._folded(other, np.arange(_SAMPLES), d) < front - _LEAST_LEAD
                if behind.any():
                    moved = q.copy()
                    moved[joints] = self._samples[other][rng.choice(np.flatnonzero(behind)), joints]
                    q = min(q, moved, key=lambda each: len(checker.self_collisions(each)))
        return None

    def _folded(self, finger: int, rows: np.ndarray, directions: np.ndarray | int) -> FloatArray:
        """Return the extents of a finger in sampled postures along directions [m]."""
        extent = np.max(list(self._extents[finger].values()), axis=0)
        return np.asarray(extent[rows, directions])

    def _posture(self, finger: int, q: FloatArray, direction: FloatArray) -> ProbePosture:
        """Return the posture with the sphere that fits the foremost part of the tip."""
        hand, pad = self._hand, self._hand.pads[finger]
        poses = hand.forward_kinematics(np.eye(4), q)
        placed = {
            link: apply_pose(poses[link], self._vertices[link])
            for link in sorted(self._group(pad.link))
        }
        foremost = max(placed, key=lambda link: float((placed[link] @ direction).max()))
        X_HL = poses[foremost]
        p_L = apply_inverse(X_HL, np.vstack(list(placed.values())))
        d_L = rotate_back(X_HL, direction)
        heights = p_L @ d_L
        top = p_L[heights > heights.max() - _LEVEL]
        middle = 0.5 * (top.min(axis=0) + top.max(axis=0))
        thickness = 0.5 * float(np.ptp(p_L, axis=0).min())
        radius = float(np.clip(min(thickness, pad.radius or np.inf), *_TIP_RADII))
        center = middle + (heights.max() - radius - middle @ d_L) * d_L
        return ProbePosture(
            pad.finger,
            read_only(q),
            read_only(direction.copy()),
            foremost,
            read_only(center),
            radius,
        )

    def _lead(self, q: FloatArray, direction: FloatArray, tips: set[str]) -> float:
        """Return the lead of the tip's links over all others in a posture [m]."""
        d = int(np.argmax(self._directions @ direction))
        extents = {k: e[0, d] for k, e in self._along(q[None], set(self._points)).items()}
        front = max(extents[link] for link in extents if link in tips)
        return float(front - max(extents[link] for link in extents if link not in tips))

    def _along(self, q: FloatArray, links: set[str]) -> dict[str, FloatArray]:
        """Return the largest coordinate of links along all directions, (S, D) [m], by link."""
        poses = self._hand.forward_kinematics(np.eye(4)[None].repeat(len(q), axis=0), q)
        return {
            link: np.max(apply_pose(poses[link], self._points[link]) @ self._directions.T, axis=1)
            for link in sorted(links)
        }

    def _moved_by(self, joints: set[str]) -> set[str]:
        """Return the links with bodies that any of the joints moves, side links too."""
        return {
            link
            for link in self._points
            if any(j.name in joints and j.index >= 0 for j in joints_to(self._hand.joints, link))
        }

    def _group(self, link: str) -> set[str]:
        """Return the links with bodies that are fixed to a link, and itself."""
        return {other for other in self._points if self._groups[other] == self._groups[link]}
