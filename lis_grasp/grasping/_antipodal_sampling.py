"""Antipodal sampling of contact sets: a thumb against fingers in a row, or fingers in a ring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.geometry import cross, make_pose, unit
from lis_grasp.grasping._contact_samples import SEARCH_RADIUS, SurfaceSamples
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.robots.hand import Hand, thumb_of
from lis_grasp.robots.robot_model import GraspFamily
from lis_grasp.typing import BoolArray, FloatArray

# Sines of the thumb's largest angle with the horizontal: it pushes sideways, or is under a rim.
_STEEPEST, _RIM = np.sin(np.deg2rad(40.0)), np.sin(np.deg2rad(75.0))
_APPROACH_ANGLES = np.deg2rad([0.0, 0.0, -20.0, 20.0, -40.0, 40.0, -65.0, 65.0])
# Distances of the fingers beside each other, as fractions of those in the widest pregrasp.
_SPREADS, _NARROW_SPREADS = (0.55, 0.75, 1.0), (0.15, 0.25, 0.4)
# Limits of sets: spreads and steepest thumb. As a last resort, fingers are closer together, or
# walls are pinched at their rim, from above and below.
USUAL, NARROW, AT_RIMS = (_SPREADS, _STEEPEST), (_NARROW_SPREADS, _STEEPEST), (_SPREADS, _RIM)
# Rounded pads may touch beside their middle, so the palm may lean towards the thumb's side: a thumb
# that lies low under the palm then points down, and clears the support beside a low object.
_LEANS = np.deg2rad([0.0, 0.0, 10.0, 20.0])


@dataclass(frozen=True, slots=True, eq=False)
class _Opposition:
    """The pad that faces all others (the thumb), and their arrangement in the palm frame."""

    thumb: int
    others: tuple[int, ...]
    frame_H: FloatArray  # (3, 3), columns: approach, lateral, closing (thumb to others)
    lateral: FloatArray  # (F,) [m]: coordinates of the pads along the lateral axis
    outward_H: FloatArray  # (F, 3), unit or 0: against the pads' axes, across the approach
    is_ring: bool  # whether two of the others face each other too, instead of side by side


def sample_contact_sets(
    hand: Hand,
    samples: SurfaceSamples,
    *,
    count: int,
    limits: tuple[Sequence[float], float] = USUAL,
    rng: np.random.Generator,
) -> tuple[GraspBatch, dict[str, int]]:
    """Sample sets of contacts: one pad, the thumb, opposite to the other pads.

    1. The thumb's contact is a random sample of the surface.
    2. A line from it, along the inward normal or its horizontal part, leaves the object at the
       opposite point. Both contacts on a low object have normals that tilt upwards.
    3. The fingers' contacts are beside the opposite point, as far apart as the fingers are, times
       one of the spreads.
    4. Fingers in a ring face each other, and come closer together as they close. For half of their
       sets, lines from the middle of the first two points, against the pads' axes, leave the object
       at the fingers' contacts.

    A set is kept if the normals of thumb and fingers are opposed along the line, which makes force
    closure possible (Nguyen 1988). Force closure itself is checked later.

    Returns
    -------
    GraspBatch
        The sets, with initial postures for the inverse kinematics: the pregrasp with the narrowest
        opening that clears the contacts, the middle of its pads at the middle of the contacts.
    dict
        Number of failed draws by reason. ``steep``: all normals are far from the horizontal;
        ``no_opposing_surface``: there is no opposite point with an opposed normal;
        ``no_surface_for_a_finger``: a finger has no opposed surface beside that point.
    """
    opposition = _opposition(hand)
    pads = len(hand.pads)
    rejected = {"steep": 0, "no_opposing_surface": 0, "no_surface_for_a_finger": 0}
    sets: list[tuple[FloatArray, FloatArray, BoolArray, BoolArray, FloatArray]] = []
    level = np.flatnonzero(np.abs(samples.normals[:, 2]) <= limits[1])
    if not len(level):
        rejected["steep"] = count
    for _ in range(count if len(level) else 0):
        i = int(rng.choice(level))
        angle = float(rng.choice(_APPROACH_ANGLES))
        chosen = _choose_fingers(opposition, rng)
        spread = float(rng.choice(limits[0]))
        lean = float(rng.choice(_LEANS)) if _radii(hand).any() else 0.0
        p, n = samples.points[i], samples.normals[i]
        closing = -n if rng.random() < 0.5 else -unit(n * [1.0, 1.0, 0.0])
        across = _opposing_point(samples, p, closing)
        if across is None:
            rejected["no_opposing_surface"] += 1
            continue
        R_OH = _orientation(closing, angle, lean) @ opposition.frame_H.T
        if opposition.is_ring and rng.random() < 0.5:
            outward_O = opposition.outward_H[chosen] @ R_OH.T
            fingers = _contacts_around(samples, 0.5 * (p + across), outward_O)
        else:
            lateral_O = R_OH @ opposition.frame_H[:, 1]
            offsets = spread * (opposition.lateral[chosen] - opposition.lateral[chosen].mean())
            fingers = _finger_contacts(samples, across + offsets[:, None] * lateral_O, closing)
        if fingers is None:
            rejected["no_surface_for_a_finger"] += 1
            continue
        points, normals = np.zeros((pads, 3)), np.zeros((pads, 3))
        points[opposition.thumb], normals[opposition.thumb] = p, n
        points[chosen], normals[chosen], of_plane = fingers
        used, bent = np.zeros(pads, dtype=bool), np.zeros(pads, dtype=bool)
        used[[opposition.thumb, *chosen]], bent[chosen] = True, of_plane
        sets.append((points, normals, used, bent, R_OH))
    if not sets:
        return GraspBatch.empty(hand), rejected
    points, normals, used, bent, R_OH = (np.array(c) for c in zip(*sets, strict=True))
    points[bent], normals[bent] = samples.project(points[bent], normals[bent])
    X_OH, q = _initial_postures(hand, points + _radii(hand)[:, None] * normals, used, R_OH)
    return GraspBatch(points, normals, used, X_OH, q), rejected


def family_of(
    hand: Hand, X_OH: FloatArray, q: FloatArray, normals: FloatArray, support_height: float
) -> GraspFamily:
    """Return the family of a grasp with contact normals (C, 3), on a support at a height [m]."""
    if normals[:, 2].min() < -_STEEPEST and normals[:, 2].max() > _STEEPEST:
        return "rim"
    return "table" if hand.slides_at(X_OH, q, support_height) else "pinch"


def _radii(hand: Hand) -> FloatArray:
    return np.array([pad.radius for pad in hand.pads])


def _initial_postures(
    hand: Hand, targets: FloatArray, used: BoolArray, R_OH: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return palm poses (B, 4, 4) of orientations (B, 3, 3), and joint positions (B, J).

    `targets` (B, F, 3) [m] are the wanted centres of the `used` pads (B, F).
    """
    pregrasps = np.array(list(hand.pregrasps.values()))  # (G, J)
    centers_H = hand.pad_centers(np.eye(4), pregrasps)  # (G, F, 3)
    opposition, X_OH = _opposition(hand), make_pose(R_OH)
    thumb, chosen = opposition.thumb, np.empty(len(R_OH), dtype=np.intp)
    for b, places in enumerate(targets):
        others = [f for f in opposition.others if used[b, f]]
        width = np.linalg.norm(places[others].mean(axis=0) - places[thumb])
        gaps = np.linalg.norm(centers_H[:, others].mean(axis=1) - centers_H[:, thumb], axis=-1)
        excess = gaps - width
        chosen[b] = np.argmin(
            np.where(excess >= 0.0, excess, np.inf if excess.max() >= 0 else -excess)
        )
        pads_H = centers_H[chosen[b]]
        middle_H = 0.5 * (pads_H[thumb] + pads_H[others].mean(axis=0))
        middle_O = 0.5 * (places[thumb] + places[others].mean(axis=0))
        X_OH[b, :3, 3] = middle_O - R_OH[b] @ middle_H
    return X_OH, pregrasps[chosen]


def _opposition(hand: Hand) -> _Opposition:
    q = next(iter(hand.pregrasps.values()))
    centers, axes = hand.pad_centers(np.eye(4), q), hand.pad_axes(np.eye(4), q)
    thumb = thumb_of(axes)
    others = tuple(f for f in range(len(hand.pads)) if f != thumb)
    approach = hand.approach_H
    closing = centers[list(others)].mean(axis=0) - centers[thumb]
    if len(others) > 1:
        spread = centers[others[0]] - centers[others[-1]]
        closing = closing - spread * (closing @ spread) / (spread @ spread)
    if hand.fixed_fingers:  # the motion is oblique, the hand straight
        approach = unit(approach - unit(closing) * (approach @ unit(closing)))
    closing = closing - approach * (closing @ approach)
    closing = unit(closing)
    lateral = cross(closing, approach)
    frame = np.column_stack([approach, lateral, closing])
    outward = unit(np.outer(axes @ approach, approach) - axes, least=np.finfo(float).tiny)
    is_ring = bool((outward[list(others)] @ outward[list(others)].T < 0.0).any())
    return _Opposition(thumb, others, frame, centers @ lateral, outward, is_ring)


def _choose_fingers(opposition: _Opposition, rng: np.random.Generator) -> list[int]:
    """Draw fingers to use: all of them half of the time, else neighbours or, of four, any."""
    others = sorted(opposition.others, key=lambda f: opposition.lateral[f])
    if len(others) < 3 or rng.random() < 0.5:
        return others
    if len(others) > 3:  # a wide spread resists more torque
        count = int(rng.integers(2, len(others)))
        return [others[i] for i in sorted(rng.choice(len(others), size=count, replace=False))]
    start = int(rng.integers(len(others) - 1))
    return others[start : start + 2]


def _orientation(closing: FloatArray, angle: float, lean: float) -> FloatArray:
    """Return columns (approach, lateral, closing) in O: downwards, turned by `angle`.

    The hand closes along `closing`, or `lean` off it about the lateral axis.
    """
    down = np.array([0.0, 0.0, -1.0])
    approach = down - closing * (down @ closing)
    approach = unit(approach)
    approach = np.cos(angle) * approach + np.sin(angle) * cross(closing, approach)
    lateral = cross(closing, approach)
    leaning = np.cos(lean) * approach - np.sin(lean) * closing
    return np.column_stack([leaning, lateral, cross(leaning, lateral)])


def _opposing_point(
    samples: SurfaceSamples, p: FloatArray, closing: FloatArray
) -> FloatArray | None:
    """Return the last exit of the line from p along `closing`; None without an opposed normal."""
    relative = samples.points - p
    depth = relative @ closing  # (S,)
    beside = np.linalg.norm(relative - depth[:, None] * closing, axis=1)
    opposed = (samples.normals @ closing > 0.0) & (beside < SEARCH_RADIUS) & (depth > 0.0)
    if not opposed.any():
        return None
    return samples.intersect(p, closing, int(np.argmax(np.where(opposed, depth, 0.0))))


def _contacts_around(
    samples: SurfaceSamples, center: FloatArray, outward: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray] | None:
    """Return the contacts of `_finger_contacts` where lines from a point, outward (K, 3), exit."""
    exits = [_opposing_point(samples, center, direction) for direction in outward]
    met = [point for point in exits if point is not None]
    return _finger_contacts(samples, np.array(met), outward) if len(met) == len(exits) else None


def _finger_contacts(
    samples: SurfaceSamples, points: FloatArray, closing: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray] | None:
    """Return contacts and normals (K, 3) on lines through points along `closing`, or None.

    `closing` has the shape (3,), or (K, 3) with a direction for each.

    Also which (K,) are on tangent planes of flat surroundings, still to be projected. None if one
    of the lines meets no opposed surface near its point.
    """
    closing = np.broadcast_to(closing, points.shape)
    nearest = samples.query(points, closing)
    normals = samples.normals[nearest]
    if ((normals * closing).sum(axis=1) <= 0.0).any():
        return None
    lines = zip(points, closing, nearest, strict=True)
    met = np.array([samples.intersect(p, direction, j) for p, direction, j in lines])
    if np.linalg.norm(met - samples.points[nearest], axis=1).max() > SEARCH_RADIUS:
        return None
    return met, normals, samples.flat[nearest]
