"""Structure of a described hand: its base, fingers and points, and links that collide by design."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.geometry import apply_pose, inverse_pose, rotate
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.kinematics import link_kinematics
from lis_grasp.robots.link_bodies import fibonacci_directions, points_of_bodies
from lis_grasp.robots.robot_model import (
    Joint,
    LinkGeometry,
    RobotModel,
    joints_to,
    rigid_groups,
)
from lis_grasp.typing import FloatArray

_KEPT = 60  # points of a body

MOST_FINGERS = 6  # of a hand
# Of leaf links that one motor moves, those that reach less far than this fraction of the farthest
# are parts of a linkage.
_LINKAGE = 0.85
_LEAST_MOTION = 0.006  # of a fingertip's middle over the ranges of its joints [m]
# What may follow the short name of a finger, as in "thdistal" or "rh_ff3"; not "three".
_PHALANX = "[^a-z]|$|tip|distal|middle|proximal|link|joint"
_MARK = 0.004  # size of a body up to which it marks a place, and is no fingertip [m]
_STEPS = 9  # positions of a joint at which that is measured
# A finger and the fixed jaw that it closes on [m]: length that counts, and their gap if closed.
_JAW_END, _CLOSED = 0.04, 0.03
_FLAT = 1e-4  # least size of a part of a body [m]

_ARM = 3  # movable joints before a hand, at least
_FINGER = 7  # movable joints of a finger, at most

_SAMPLES = 200  # postures in which collisions are counted
# A pair may touch if it collides in this fraction of random postures: near in the tree, and any.
_OFTEN_NEAR, _OFTEN = 0.1, 0.4
_NEAR = 3  # movable joints between two links that are near in the tree
_CHAINED = 2  # movable joints between two links of one chain whose limits keep them apart


def link_points(model: RobotModel) -> dict[str, FloatArray]:
    """Return by link some vertices of its bodies, (N, 3) [m], in the link frame.

    They are the outermost ones along directions spread over the sphere, so that extents along any
    direction are exact to a small fraction of a body's size.
    """
    points: dict[str, list[FloatArray]] = {}
    directions = fibonacci_directions(_KEPT)
    for body in model.link_geometries:
        p_L = points_of_bodies([body], body.link)
        if len(p_L) > _KEPT:
            p_L = p_L[np.unique(np.argmax(p_L @ directions.T, axis=0))]
        points.setdefault(body.link, []).append(p_L)
    return {link: np.vstack(parts) for link, parts in points.items()}


def reach(p_L: FloatArray, origin_L: FloatArray, axis_L: FloatArray) -> FloatArray:
    """Return the vector (3,) [m] from a joint to the points farthest from its axis, across it."""
    arms = p_L - origin_L
    arms = arms - np.outer(arms @ axis_L, axis_L)
    lengths = np.linalg.norm(arms, axis=1)
    return np.asarray(arms[lengths >= 0.9 * lengths.max()].mean(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class FingerBody:
    """One body of a fingertip's rigid group."""

    link: str
    X_LB: FloatArray  # (4, 4): pose of its link in the frame of the finger's link
    points_L: FloatArray  # (N, 3) [m], in the frame of the finger's link


@dataclass(frozen=True, slots=True, eq=False)
class DraftFinger:
    """A chain of joints from the palm to a fingertip."""

    name: str
    link: str  # the link of the tip whose body, if not a mark, reaches farthest
    bodies: tuple[FingerBody, ...]  # of the tip's rigid group
    joint: Joint  # the last one that moves the tip
    origin_L: FloatArray  # (3,) [m]: of that joint, in the link frame
    axis_L: FloatArray  # (3,), unit: its axis
    motors: tuple[int, ...]  # the actuated joints that move the tip, from the palm outwards

    @property
    def points_L(self) -> FloatArray:
        """Points (N, 3) [m] of all its bodies, in the frame of `link`."""
        return np.vstack([body.points_L for body in self.bodies])


def find_fingers(model: RobotModel, tips: Sequence[str] = ()) -> tuple[DraftFinger, ...]:
    """Return the fingers of a hand: one for each of the named tip links, else for each leaf.

    A leaf is a rigid group of links with bodies that moves and carries no other such group. If
    there is one, it closes on a fixed jaw, which is the second finger. Raises `InvalidHandError` if
    there are fewer than two, or more than a hand has.
    """
    groups = rigid_groups(model)
    for tip in tips:
        if tip not in groups:
            raise InvalidHandError(f"a fingertip must be a link; there is no link '{tip}'")
    leaves = [groups[tip] for tip in tips] if tips else leaf_groups(model)
    fingers = [_finger(model, groups, leaf) for leaf in leaves]
    if not tips:
        fingers = _without_linkages(model, _without_knobs(model, fingers))
    if not fingers:
        moving = ", ".join(joint.child for joint in model.joints if joint.kind != "fixed")
        raise InvalidHandError(
            f"fingers must have collision bodies or visual meshes; what moves ({moving}) has no"
            " bodies"
        )
    if len(fingers) == 1 and not tips:
        fingers = _jaws(model, groups, fingers[0])
    if not 2 <= len(fingers) <= MOST_FINGERS:
        found = ", ".join(finger.link for finger in fingers)
        raise InvalidHandError(
            f"a hand must have 2 to {MOST_FINGERS} fingers; the movable leaf links are {found}:"
            " name the link where the hand begins by `base`, or the fingertips' links by `tips`"
        )
    return tuple(_renamed(fingers))


def shared_joints(model: RobotModel, fingers: Sequence[DraftFinger]) -> list[Joint]:
    """Return the movable joints before all fingers, as in a wrist or an arm, in order."""
    chains = [{j.name for j in joints_to(model.joints, f.link) if j.index >= 0} for f in fingers]
    return [joint for joint in model.joints if all(joint.name in chain for chain in chains)]


def leaf_groups(model: RobotModel) -> list[str]:
    """Return the first links of the rigid groups with bodies that move and carry no other such."""
    groups = rigid_groups(model)
    solid = {groups[body.link] for body in model.link_geometries} - {groups[model.links[0]]}
    carriers = {
        groups[joint.parent]
        for leaf in solid
        for joint in joints_to(model.joints, leaf)
        if joint.kind != "fixed"
    }
    return [link for link in model.links if link in solid - carriers]


def _jaws(model: RobotModel, groups: Mapping[str, str], moving: DraftFinger) -> list[DraftFinger]:
    """Return the ends of a single finger and of the fixed jaw that it closes on.

    The fixed jaw is what of its carrier reaches as far out as the finger does. The finger is closed
    at the end of its range at which the two are nearest.
    """
    joint, carrier = moving.joint, groups[moving.joint.parent]
    own = [body for body in model.link_geometries if groups[body.link] == carrier]
    arm_L = reach(moving.points_L, moving.origin_L, moving.axis_L)
    length = float(np.linalg.norm(arm_L))
    least = length - min(_JAW_END, 0.5 * length)  # along the finger, from its joint
    found: list[tuple[float, DraftFinger]] = []
    for end in (model.lower, model.upper) if own and length else ():
        q = np.clip(0.0, model.lower, model.upper)
        q[joint.index] = end[joint.index]
        poses = link_kinematics(model).poses(np.eye(4), q)
        X = poses[moving.link]
        outward, start = rotate(X, arm_L / length), apply_pose(X, moving.origin_L)
        jaw = _finger(model, groups, carrier, own, joint)
        X_JB = inverse_pose(poses[jaw.link])
        jaw = _end_of(jaw, rotate(X_JB, outward), apply_pose(X_JB, start + least * outward))
        if jaw.bodies:
            p_B = apply_pose(poses[jaw.link], jaw.points_L)
            gaps, _ = cKDTree(p_B).query(apply_pose(X, moving.points_L))
            found.append((float(gaps.min()), jaw))
    gap, jaw = min(found, key=lambda each: each[0], default=(np.inf, moving))
    if gap > _CLOSED:
        raise InvalidHandError(
            f"a hand must have 2 to {MOST_FINGERS} fingers, or one against a fixed jaw; only"
            f" {moving.link} moves, and no body of {joint.parent} is opposite to it"
        )
    arm_L = arm_L / length
    return [_end_of(moving, arm_L, moving.origin_L + least * arm_L), jaw]


def _end_of(finger: DraftFinger, outward_L: FloatArray, point_L: FloatArray) -> DraftFinger:
    """Return a finger whose one body is the hull of what is beyond a plane: it meets flat objects.

    Without anything beyond the plane it has no bodies.
    """
    hulls = [trimesh.convex.convex_hull(body.points_L) for body in finger.bodies]
    points = np.vstack([hull.slice_plane(point_L, outward_L).vertices for hull in hulls])
    if len(points) <= 3 or np.linalg.matrix_rank(points - points.mean(axis=0), tol=_FLAT) < 3:
        return replace(finger, bodies=())
    hull = trimesh.convex.convex_hull(points)
    return replace(finger, bodies=(FingerBody(finger.link, np.eye(4), np.asarray(hull.vertices)),))


def _finger(
    model: RobotModel,
    groups: Mapping[str, str],
    leaf: str,
    bodies: Sequence[LinkGeometry] | None = None,
    joint: Joint | None = None,
) -> DraftFinger:
    """Return the finger of a leaf; a fixed jaw has some `bodies` and the `joint` of the other."""
    members = [link for link in model.links if groups[link] == leaf]
    X_GL = {leaf: np.eye(4)}  # poses of the group's links in the first one
    for fixed in model.joints:
        if fixed.child in members and fixed.kind == "fixed" and fixed.parent in X_GL:
            X_GL[fixed.child] = X_GL[fixed.parent] @ fixed.X_PJ
    chain = joints_to(model.joints, leaf)
    last = joint or chain[-1]
    solid = model.link_geometries if bodies is None else bodies
    parts = [
        (body.link, points_of_bodies([body], body.link)) for body in solid if body.link in X_GL
    ]
    if not parts:
        raise InvalidHandError(f"the fingertip '{leaf}' must have a body; it has none")
    large = [np.ptp(p, axis=0).max() > _MARK for _, p in parts]
    arms = [
        float(np.linalg.norm(apply_pose(X_GL[k], p), axis=1).max()) * (is_large or not any(large))
        for (k, p), is_large in zip(parts, large, strict=True)
    ]
    link = parts[int(np.argmax(arms))][0]
    X_LG = inverse_pose(X_GL[link])
    placed = [FingerBody(k, X_LG @ X_GL[k], apply_pose(X_LG @ X_GL[k], p)) for k, p in parts]
    motors = tuple(dict.fromkeys(joint.index for joint in chain if joint.index >= 0))
    return DraftFinger(
        name=link,
        link=link,
        bodies=tuple(placed),
        joint=last,
        origin_L=np.array(X_LG[:3, 3], np.float64),
        axis_L=rotate(X_LG, last.axis_J),
        motors=motors,
    )


def _without_knobs(model: RobotModel, fingers: Sequence[DraftFinger]) -> list[DraftFinger]:
    """Leave out what turns in place, as a wheel, a knob or a motor's horn; all stay if all do."""
    kinematics = link_kinematics(model)
    shared = {joint.index for joint in shared_joints(model, fingers)} if fingers else set()

    def moved_by(motor: int, finger: DraftFinger) -> float:
        middle_L = 0.5 * (finger.points_L.min(axis=0) + finger.points_L.max(axis=0))
        q = np.tile(np.clip(0.0, model.lower, model.upper), (_STEPS, 1))
        q[:, motor] = np.linspace(model.lower[motor], model.upper[motor], _STEPS)
        X = kinematics.poses(np.broadcast_to(np.eye(4), (_STEPS, 4, 4)), q)[finger.link]
        return float(np.linalg.norm(np.ptp(apply_pose(X, middle_L), axis=0)))

    moved = [sum(moved_by(m, f) for m in set(f.motors) - shared) for f in fingers]
    kept = [f for f, way in zip(fingers, moved, strict=True) if way > _LEAST_MOTION]
    return kept or list(fingers)


def _without_linkages(model: RobotModel, fingers: Sequence[DraftFinger]) -> list[DraftFinger]:
    """Leave out bars of linkages: they move with the same motor as a tip, and reach less far.

    The reach is measured from the first joint that this motor moves.
    """
    poses = link_kinematics(model).poses(np.eye(4), np.clip(0.0, model.lower, model.upper))
    reached = {}
    for f in fingers:
        first = next(j for j in joints_to(model.joints, f.link) if j.index == f.motors[-1])
        points = apply_pose(poses[f.link], f.points_L)
        arms = np.linalg.norm(points - poses[first.child][:3, 3], axis=1)
        reached[f.link] = float(arms.max())
    farthest = {
        motor: max(reached[f.link] for f in fingers if f.motors[-1] == motor)
        for motor in {f.motors[-1] for f in fingers}
    }
    return [f for f in fingers if reached[f.link] >= _LINKAGE * farthest[f.motors[-1]]]


def _renamed(fingers: Sequence[DraftFinger]) -> list[DraftFinger]:
    """Name fingers as people do where the names of links say so, else by the links."""
    words = ("thumb", "index", "middle", "ring", "little", "pinky", "left", "right")
    short = {"th": "thumb", "ff": "index", "mf": "middle", "rf": "ring", "lf": "little"}
    short |= {"rf": "right", "lf": "left"} if len(fingers) == 2 else {}  # of a gripper
    names = []
    for finger in fingers:
        low = finger.link.lower()
        found = [word for word in words if word in low] or [
            word for key, word in short.items() if re.match(rf"(.*[^a-z])?{key}({_PHALANX})", low)
        ]
        names.append(found[0] if found else finger.link)
    if len(set(names)) < len(names):
        names = [finger.link for finger in fingers]
    return [replace(finger, name=name) for finger, name in zip(fingers, names, strict=True)]


def find_hand_bases(model: RobotModel) -> tuple[str, ...]:
    """Return the links where the hands of a whole robot begin; none for a hand alone.

    Each is the first link of a leaf's chain that carries several leaves, has three movable joints
    or more before it, and no more than seven after it.
    """
    groups = rigid_groups(model)
    chains = [
        [groups[j.parent] for j in joints_to(model.joints, leaf) if j.kind != "fixed"] + [leaf]
        for leaf in leaf_groups(model)
    ]
    bases = []
    for chain in chains:
        for before, group in enumerate(chain[:-1]):
            after = [c[c.index(group) + 1 :] for c in chains if group in c]
            forks = len({rest[0] for rest in after}) > 1
            if before >= _ARM and forks and max(map(len, after)) <= _FINGER:
                bases.append(group)
                break
    return tuple(dict.fromkeys(bases))


def find_exclusions(
    hand: Hand, checker: HandCollisionChecker, *, rng: np.random.Generator
) -> frozenset[tuple[str, str]]:
    """Return the pairs of links that collide so often that they must do so by design.

    These are pairs that collide in 40 % of random postures, and in 10 % if at most three movable
    joints are between them. Links of one chain with two joints between them may touch wherever they
    do: the limits of two joints keep the real links apart, so that only their hulls overlap. Of a
    hand with two fingers every pair that collides at all counts,
    since its fingers close on each other and its linkages overlap.
    """
    q = rng.uniform(hand.lower, hand.upper, size=(_SAMPLES, len(hand.joint_names)))
    q[0] = np.clip(0.0, hand.lower, hand.upper)
    ends = rng.spawn(1)[0].uniform(-0.5, 1.5, size=q.shape).clip(0.0, 1.0)  # many at limits
    excluded = {
        pair
        for posture in hand.lower + ends * (hand.upper - hand.lower)
        for pair in checker.self_collisions(posture)
        if _are_chained(hand, *pair)
    }
    found = Counter(pair for posture in q for pair in checker.self_collisions(posture))
    at_rest = checker.self_collisions(q[0])
    for pair, count in found.items():
        joints_between = _movers(hand, pair[0]) ^ _movers(hand, pair[1])
        often = _OFTEN_NEAR if len(joints_between) <= _NEAR else _OFTEN
        if len(hand.pads) == 2 or count >= often * _SAMPLES or pair in at_rest:
            excluded.add(pair)
    return frozenset(excluded)


def _are_chained(hand: Hand, first: str, second: str) -> bool:
    """Return whether one link carries the other, with two movable joints between them at most."""
    movers = _movers(hand, first), _movers(hand, second)
    in_one_chain = movers[0] <= movers[1] or movers[1] <= movers[0]
    return in_one_chain and len(movers[0] ^ movers[1]) <= _CHAINED


def _movers(hand: Hand, link: str) -> set[str]:
    return {joint.name for joint in joints_to(hand.joints, link) if joint.index >= 0}
