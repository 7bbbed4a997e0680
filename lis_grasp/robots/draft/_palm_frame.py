"""The palm frame of a drafted hand, on the side on which the hand is most open."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lis_grasp.geometry import apply_pose, frame_along, make_pose, tangent_frame, unit
from lis_grasp.robots.draft._pregrasps import Opening
from lis_grasp.robots.draft._structure import link_points
from lis_grasp.robots.draft._symmetry import symmetry_axis
from lis_grasp.robots.hand import Hand, thumb_of
from lis_grasp.robots.link_bodies import fibonacci_directions
from lis_grasp.robots.robot_model import joints_to, rigid_groups
from lis_grasp.typing import FloatArray

_ENOUGH = 0.04  # clearance that counts [m]
_FORWARD = 0.03  # weight of the direction from the palm [m]
_TURNS = 720  # directions across the closing one that are tried
_BESIDE = 0.02  # of the palm's points from the line through the ball [m]


def find_palm_frame(hand: Hand, opening: Opening) -> FloatArray:
    """Return the pose (4, 4) of H in the base link, with z along the approach.

    The ball of an opening leaves the hand along +z, the direction in which it passes the links at
    the largest distance, preferably away from the fingers' roots; of two fingers, the direction
    across the closing one in which the pads lead the palm most. The x axis points from the
    thumb to the other fingers, across z. The origin is on the palm, below the ball. Pads at equal
    angles about an axis have z and the origin on it. `hand` must have its palm frame at the base
    link.
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
    center = opening.center_H
    symmetry = symmetry_axis(hand, opening.q)
    if symmetry is not None:
        point, axis = symmetry
        approach = axis if axis @ approach > 0.0 else -axis
        center = point + (center - point) @ axis * axis
    origin = _on_palm(hand, points.get(hand.base_link, p_B), center, approach, palm)
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
