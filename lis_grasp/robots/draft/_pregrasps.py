"""Opened postures of a hand: its pads round balls of several sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from lis_grasp.geometry import apply_pose
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.draft._structure import link_points
from lis_grasp.robots.draft._symmetry import alike
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.schema import FEW_DIGITS
from lis_grasp.typing import FloatArray

RADII = (0.085, 0.07, 0.057, 0.046, 0.036, 0.027, 0.019, 0.012, 0.007)
"""Of the balls [m], from the widest opening to the narrowest."""

_FIRST = (0.036, 0.057, 0.027, 0.046, 0.019, 0.012)  # radii from which the search starts
_ROUNDS, _LEAST_GOOD = 8, 4  # random starts for each of them, and good openings that are enough
_HOME = 0.5  # fraction of starts near joint positions 0, as far as the limits allow
_RETRIES = (0.0, 0.02, 0.05, 0.1, 0.1, 0.15)  # spread of starts about a neighbour, of the range
_BISECTIONS = 4  # of the radius of the widest opening
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
                if _has_widest(hand) and radius > last.radius:
                    widest = _widest(problem, last, radius, rng)
                    openings += [widest] if widest is not last else []
                break
            openings.append(following)
            last = following
    openings.sort(key=lambda opening: -opening.radius)
    if _has_widest(hand) and len(openings) > 1:
        openings[0] = _at_limits(hand, problem, *openings[:2])
    return [_evened(hand, problem, opening) for opening in openings]


def _has_widest(hand: Hand) -> bool:
    """Return whether the limits say how wide a hand opens: a gripper, or a motor for a finger."""
    return len(hand.pads) == 2 or all(len(hand.finger_joints(f)) == 1 for f in hand.fingers)


def _widest(problem: _Problem, last: Opening, failed: float, rng: np.random.Generator) -> Opening:
    """Return the widest opening, by bisection between two radii, one that failed."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (last.radius + failed)
        opening = problem.solve_near(last, middle, rng)
        last, failed = (last, middle) if opening is None else (opening, failed)
    return last


def _at_limits(hand: Hand, problem: _Problem, widest: Opening, narrower: Opening) -> Opening:
    """Return the widest opening with its joints at the limits to which they open, if it is good."""
    opens = widest.q - narrower.q
    q = np.where(opens > FEW_DIGITS, hand.upper, np.where(opens < 0.0, hand.lower, widest.q))
    q = np.where(np.abs(opens) <= FEW_DIGITS, widest.q, q)
    opened = problem.with_joints(widest, q)
    return opened if opened.good else widest


def _evened(hand: Hand, problem: _Problem, opening: Opening) -> Opening:
    """Return an opening with equal fingers bent alike, if it is good: least squares leave errors.

    Where a ball may be anywhere between two jaws, the errors are large.
    """
    q = alike(hand, opening.q)
    if q is None:
        return opening
    evened = problem.with_joints(opening, q)
    return evened if evened.good else opening


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
        return self._opening(radius, solved.x, float(solved.cost))

    def with_joints(self, opening: Opening, q: FloatArray) -> Opening:
        """Return the opening of the same radius at joint positions (J,): only its ball moves."""
        start = np.concatenate([opening.center_H, np.full(self._fingers, 0.6)])
        low, high = self._low[self._count :], self._high[self._count :]
        solved = least_squares(
            lambda y: self._residuals(np.concatenate([q, y])[None], opening.radius)[0],
            np.clip(start, low + 1e-9, high - 1e-9),
            bounds=(low, high),
            x_scale=np.concatenate([np.full(3, 0.05), np.ones(self._fingers)]),
        )
        return self._opening(opening.radius, np.concatenate([q, solved.x]), float(solved.cost))

    def _opening(self, radius: float, x: FloatArray, cost: float) -> Opening:
        q, center = x[: self._count], x[self._count : self._count + 3]
        good = self._fits(x, radius) and not self._checker.self_collisions(q)
        return Opening(radius, q, center, cost, good)

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
