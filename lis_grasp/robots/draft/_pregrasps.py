"""Opened postures of a hand, and the palm frame on the side on which the hand is most open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from lis_grasp.geometry import apply_pose, frame_along, make_pose, tangent_frame, unit
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.draft._structure import link_points
from lis_grasp.robots.hand import Hand, thumb_of
from lis_grasp.robots.link_bodies import fibonacci_directions
from lis_grasp.robots.robot_model import joints_to, rigid_groups
from lis_grasp.typing import FloatArray

RADII = (0.085, 0.07, 0.057, 0.046, 0.036, 0.027, 0.019, 0.012, 0.007)
"""Of the balls [m], from the widest opening to the narrowest."""

_FIRST = (0.036, 0.057, 0.027, 0.046, 0.019, 0.012)  # radii from which the search starts
_ROUNDS, _LEAST_GOOD = 8, 4  # random starts for each of them, and good openings that are enough
_HOME = 0.5  # fraction of starts near joint positions 0, as far as the limits allow
_RETRIES = (0.0, 0.02, 0.05, 0.1, 0.1, 0.15)  # spread of starts about a neighbour, of the range
_BISECTIONS = 4  # of the radius of the widest opening of a gripper
# Units of the residuals: [m], [-] (of unit vectors), [m] (of penetrations).
_POSITION, _AXIS, _BALANCE, _PENETRATION = 0.004, 0.5, 0.25, 0.003
_RANGE = 3.0  # fractions of a joint's range off its relaxed position
_CLEARANCE = 0.004  # of the ball from links without pads [m]
# A posture is accepted within these errors: pads off the ball [m], axes off its centre (chord of
# the angle), and the unbalanced fraction of the pads' forces.
_MOST_OFF, MOST_TURNED, _MOST_UNBALANCED = 0.006, 0.75, 0.35
_LEAST_WEIGHT = 0.2  # of a pad, of which the largest is 1
_SIDE_BY_SIDE = 0.022  # of pads, beyond which fingers do not hinder each other [m]
_MANY = 4  # number of fingers of which one may be off, as a little finger is

_ENOUGH = 0.04  # clearance that counts [m]
_FORWARD = 0.03  # weight of the direction from the palm [m]
_TURNS = 720  # directions across the closing one that are tried
_BESIDE = 0.02  # of the palm's points from the line through the ball [m]


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """A posture whose pads are round a ball."""

    radius: float  # of the ball [m]
    q: FloatArray  # (J,) [rad or m]
    center_H: FloatArray  # (3,) [m]: of the ball
    cost: float
    good: bool  # whether the errors are small and no links collide


def find_pregrasps(
    hand: Hand,
    checker: HandCollisionChecker,
    *,
    most_turned: float = MOST_TURNED,
    rng: np.random.Generator,
) -> list[Opening]:
    """Return openings of several sizes, the widest first; none if no opposed posture was found.

    The first is the best of many random starts for several radii; each other one starts from its
    neighbour, so that the fingers stay arranged alike. Minimises, by trust-region least squares
    (Branch, Coleman and Li, 1999), over joint positions, the ball's centre and the pads' fractions
    of the force: pads off the ball, axes off its centre, forces that do not balance, links in the
    ball, joints off a relaxed posture. `most_turned` is the largest error of a pad's axis that is
    accepted, as the length of a unit circle's chord.
    """
    problem = _Problem(hand, checker, most_turned)
    good: list[Opening] = []
    for _ in range(_ROUNDS):
        found = [problem.solve(radius, problem.random_start(rng)) for radius in _FIRST]
        good += [opening for opening in found if opening.good]
        if len(good) >= _LEAST_GOOD:
            break
    if not good:
        return []
    anchor = min(good, key=lambda opening: opening.cost)
    at = RADII.index(anchor.radius)
    openings = [anchor]
    for radii in (RADII[at + 1 :], RADII[:at][::-1]):
        last = anchor
        for radius in radii:
            following = problem.solve_near(last, radius, rng)
            if following is None:
                if len(hand.pads) == 2 and radius > last.radius:
                    widest = _widest(problem, last, radius, rng)
                    openings += [widest] if widest is not last else []
                break
            openings.append(following)
            last = following
    return sorted(openings, key=lambda opening: -opening.radius)


def _widest(problem: _Problem, last: Opening, failed: float, rng: np.random.Generator) -> Opening:
    """Return the widest opening of a gripper, by bisection between two radii, one that failed."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (last.radius + failed)
        opening = problem.solve_near(last, middle, rng)
        last, failed = (last, middle) if opening is None else (opening, failed)
    return last


class _Problem:
    """Residuals over x = joint positions (J), the ball's centre (3), pads' weights (F)."""

    def __init__(self, hand: Hand, checker: HandCollisionChecker, most_turned: float) -> None:
        self._hand, self._checker, self._most_turned = hand, checker, most_turned
        self._count, self._fingers = len(hand.joint_names), len(hand.pads)
        self._radii = np.array([pad.radius for pad in hand.pads])
        points = link_points(hand)
        others = [link for link in points if link not in {pad.link for pad in hand.pads}]
        self._points = [(link, points[link]) for link in others]
        low, high = hand.lower, hand.upper
        self._apart = self._least_distances(np.clip(0.0, low, high))
        self._range = high - low
        self._home = zero = np.clip(0.0, low, high)
        longer = np.where(np.abs(high) >= np.abs(low), high, low)
        lopsided = np.abs(high + low) > 0.3 * self._range
        self._relaxed = np.where(lopsided, zero + 0.35 * (longer - zero), 0.5 * (low + high))
        size = max(float(np.abs(p).max()) for p in points.values()) + 0.3
        self._low = np.concatenate([low, np.full(3, -size), np.full(self._fingers, _LEAST_WEIGHT)])
        self._high = np.concatenate([high, np.full(3, size), np.ones(self._fingers)])

    def _least_distances(self, home: FloatArray) -> FloatArray:
        """Return the least distances (F, F) [m] of the pads' centres from each other.

        Fingers side by side need about the distance that they have at joint positions 0.
        """
        pads = self._hand.pad_centers(np.eye(4), home)
        between = np.linalg.norm(pads[:, None] - pads[None], axis=2)
        spheres = self._radii[:, None] + self._radii[None] + 0.002
        return np.maximum(spheres, np.minimum(between, _SIDE_BY_SIDE))

    def random_start(self, rng: np.random.Generator) -> FloatArray:
        about = self._home if rng.random() < _HOME else self._relaxed
        spread = rng.uniform(-0.35, 0.35, self._count) * self._range
        q = np.clip(about + spread, self._hand.lower, self._hand.upper)
        centers = self._hand.pad_centers(np.eye(4), q)
        return np.concatenate([q, centers.mean(axis=0), np.full(self._fingers, 0.6)])

    def solve_near(
        self, opening: Opening, radius: float, rng: np.random.Generator
    ) -> Opening | None:
        """Return a good opening of another radius, from starts about one; None if none is found."""
        for spread in _RETRIES:
            q = opening.q + spread * rng.uniform(-1.0, 1.0, self._count) * self._range
            start = np.concatenate([q, opening.center_H, np.full(self._fingers, 0.6)])
            found = self.solve(radius, start)
            if found.good:
                return found
        return None

    def solve(self, radius: float, start: FloatArray) -> Opening:
        inside = np.clip(start, self._low + 1e-9, self._high - 1e-9)
        scale = np.concatenate([self._range, np.full(3, 0.05), np.ones(self._fingers)])
        solved = least_squares(
            lambda x: self._residuals(x[None], radius)[0],
            inside,
            jac=lambda x: self._jacobian(x, radius),
            bounds=(self._low, self._high),
            x_scale=scale,
            max_nfev=60,
            ftol=1e-4,
            xtol=1e-5,
        )
        q, center = solved.x[: self._count], solved.x[self._count : self._count + 3]
        good = self._fits(solved.x, radius) and not self._checker.self_collisions(q)
        return Opening(radius, q, center, float(solved.cost), good)

    def _fits(self, x: FloatArray, radius: float) -> bool:
        off, turned, balance, inside, _ = self._errors(x[None], radius)
        on = np.abs(off[0]) <= _MOST_OFF
        facing = np.linalg.norm(turned[0], axis=1) <= self._most_turned
        idle = int(self._fingers >= _MANY)
        return bool(
            np.count_nonzero(on & facing) >= self._fingers - idle
            and np.linalg.norm(balance) <= _MOST_UNBALANCED
            and inside.max(initial=0.0) <= _CLEARANCE
        )

    def _errors(self, x: FloatArray, radius: float) -> tuple[FloatArray, ...]:
        """Return errors at points x (N, X): see `_residuals` for what they are."""
        count = self._count
        q, center, weights = x[:, :count], x[:, count : count + 3], x[:, count + 3 :]
        poses = np.eye(4)[None].repeat(len(x), axis=0)
        pads = self._hand.pad_centers(poses, q)  # (N, F, 3)
        axes = self._hand.pad_axes(poses, q)
        inward = center[:, None] - pads
        distance = np.linalg.norm(inward, axis=2)
        inward = inward / np.maximum(distance, 1e-6)[..., None]
        off = distance - radius - self._radii
        weights = weights / weights.sum(axis=1, keepdims=True)
        balance = (weights[..., None] * inward).sum(axis=1)
        links = self._hand.forward_kinematics(poses, q)
        gaps = [
            np.linalg.norm(apply_pose(links[link], p) - center[:, None], axis=2).min(axis=1)
            for link, p in self._points
        ]
        inside = np.maximum(radius + _CLEARANCE - np.array(gaps).T.reshape(len(x), -1), 0.0)
        i, j = np.triu_indices(self._fingers, 1)
        between = np.linalg.norm(pads[:, i] - pads[:, j], axis=2)
        least = np.maximum(self._apart[i, j], 0.25 * radius)
        return off, axes - inward, balance, inside, np.maximum(least - between, 0.0)

    def _residuals(self, x: FloatArray, radius: float) -> FloatArray:
        off, turned, balance, inside, crowded = self._errors(x, radius)
        strain = (x[:, : self._count] - self._relaxed) / (_RANGE * self._range)
        return np.column_stack(
            [
                off / _POSITION,
                turned.reshape(len(x), -1) / _AXIS,
                balance / _BALANCE,
                inside / _PENETRATION,
                crowded / _POSITION,
                strain,
            ]
        )

    def _jacobian(self, x: FloatArray, radius: float) -> FloatArray:
        step = 1e-6
        moved = np.vstack([x, x + step * np.eye(len(x))])
        values = self._residuals(moved, radius)
        return np.asarray((values[1:] - values[0]).T / step)


def find_palm_frame(hand: Hand, opening: Opening) -> FloatArray:
    """Return the pose (4, 4) of H in the base link, with z along the approach.

    The ball of an opening leaves the hand along +z, the direction in which it passes the links at
    the largest distance, preferably away from the fingers' roots; of two fingers, the direction
    across the closing one in which the pads lead the palm most. The x axis points from the
    thumb to the other fingers, across z. The origin is on the palm, below the ball. `hand` must
    have its palm frame at the base link.
    """
    links = hand.forward_kinematics(np.eye(4), opening.q)
    points = link_points(hand)
    p_B = np.vstack([apply_pose(links[k], p) for k, p in points.items()])
    arms = p_B - opening.center_H
    closing = _closing_direction(hand, opening.q)
    candidates = fibonacci_directions(1000)
    if len(hand.pads) == 2:  # open on all sides
        palm = points.get(hand.base_link, np.zeros((1, 3))).mean(axis=0)
        approach = _leading_direction(hand, closing, opening, points, links)
    else:
        palm = _finger_roots(hand, links).mean(axis=0)
        forward = unit(opening.center_H - palm, least=1e-9)
        ahead = arms @ candidates.T  # (P, D)
        across = np.sqrt(np.maximum((arms**2).sum(axis=1)[:, None] - ahead**2, 0.0))
        clearance = np.where(ahead > 0.0, across, np.inf).min(axis=0)
        scores = np.minimum(clearance, _ENOUGH) + _FORWARD * candidates @ forward
        approach = candidates[np.argmax(scores)]
    origin = _on_palm(hand, points.get(hand.base_link, p_B), opening.center_H, approach, palm)
    return make_pose(frame_along(approach, closing), origin)


def _leading_direction(
    hand: Hand,
    closing: FloatArray,
    opening: Opening,
    points: Mapping[str, FloatArray],
    links: Mapping[str, FloatArray],
) -> FloatArray:
    """Return the direction (3,) across the closing one in which the ball is most ahead of links.

    The fingertips do not count, nor does what is fixed to them.
    """
    groups = rigid_groups(hand)
    tips = {groups[pad.link] for pad in hand.pads}
    behind = [apply_pose(links[k], p) for k, p in points.items() if groups[k] not in tips]
    first, second = tangent_frame(closing)
    angles = np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
    around = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second)
    arms = np.vstack([np.zeros((1, 3)), *behind]) - opening.center_H
    return np.asarray(around[np.argmin((arms @ around.T).max(axis=0).round(6))])


def _finger_roots(hand: Hand, links: dict[str, FloatArray]) -> FloatArray:
    chains = (joints_to(hand.joints, pad.link) for pad in hand.pads)
    return np.array([links[next(j.child for j in c if j.index >= 0)][:3, 3] for c in chains])


def _closing_direction(hand: Hand, q: FloatArray) -> FloatArray:
    """Return the direction from the thumb's pad to the middle of the others, unit, (3,)."""
    axes, centers = hand.pad_axes(np.eye(4), q), hand.pad_centers(np.eye(4), q)
    thumb = thumb_of(axes)
    closing = np.delete(centers, thumb, axis=0).mean(axis=0) - centers[thumb]
    return unit(closing)


def _on_palm(
    hand: Hand, base: FloatArray, center: FloatArray, approach: FloatArray, palm: FloatArray
) -> FloatArray:
    behind = (base - center) @ approach
    beside = np.linalg.norm(base - center - np.outer(behind, approach), axis=1)
    below = behind[(beside < _BESIDE) & (behind < 0.0)]
    height = below.max() if len(below) else (palm - center) @ approach
    return np.asarray(center + height * approach)
