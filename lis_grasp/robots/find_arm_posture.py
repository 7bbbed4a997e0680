"""Home posture of an arm, and pairs of its links that touch by design, found by sampling."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from lis_grasp.robots.arm_ik import ArmIK
from lis_grasp.robots.arm_kinematics import ArmKinematics
from lis_grasp.robots.body_pairs import BodyPairs, pairs_of_bodies
from lis_grasp.robots.hand_parts import joints_to
from lis_grasp.robots.link_tree import HandModel, link_kinematics
from lis_grasp.typing import BoolArray, FloatArray

_SAMPLES = 120
# A pair of links may touch if it collides in this fraction of random postures.
_OFTEN = 0.5

# Places of the flange at home, as fractions of the reach: ahead of the base and above it.
_AHEAD, _ABOVE = (0.5, 0.4, 0.6), (0.5, 0.4, 0.6)
_YAWS = 8
_SEEDS = 4
# A joint as far from its limits as this fraction of half its range is no closer than it should be.
_FAR = 0.3


def joints_before(model: HandModel) -> Mapping[str, int]:
    """Return the number of movable joints from the base to each link, by its name."""
    return {
        link: sum(joint.kind != "fixed" for joint in joints_to(model.joints, link))
        for link in model.links
    }


def body_poses(model: HandModel, q: FloatArray) -> FloatArray:
    """Return the poses of all bodies in the base link, (N, G, 4, 4), at postures q (N, J)."""
    kinematics = link_kinematics(model)
    links = kinematics.poses(np.eye(4), q)
    return np.stack([links[g.link] @ g.X_LG for g in model.link_geometries], axis=1)


def find_arm_exclusions(model: HandModel) -> frozenset[tuple[str, str]]:
    """Return the pairs of links that may touch, each sorted: neighbours, and pairs that often do.

    Neighbours are links that one movable joint or none separates. Pairs that collide in half of the
    random postures must do so by design: an elbow that folds on itself collides in a tenth.
    """
    order = joints_before(model)
    links = dict.fromkeys(g.link for g in model.link_geometries)
    pairs = [(min(p), max(p)) for p in combinations(links, 2)]
    excluded = {(a, b) for a, b in pairs if abs(order[a] - order[b]) <= 1}
    bodies = BodyPairs(model.link_geometries, pairs_of_bodies(model, frozenset(excluded)))
    q = np.random.default_rng(0).uniform(
        np.maximum(model.lower, -np.pi),
        np.minimum(model.upper, np.pi),
        (_SAMPLES, len(model.lower)),
    )
    counts: dict[tuple[str, str], int] = {}
    poses = body_poses(model, q)
    for posture, near in zip(poses, bodies.may_touch(bodies.ball_centers(poses)), strict=True):
        bodies.place(posture)
        hits = {
            tuple(sorted(bodies.geometries[k].link for k in bodies.pairs[pair]))
            for pair in bodies.touching(np.flatnonzero(near))
        }
        for a, b in hits:
            counts[a, b] = counts.get((a, b), 0) + 1
    for (a, b), count in counts.items():
        if count >= _OFTEN * _SAMPLES:
            excluded.add((a, b))
    return frozenset(excluded)


def find_home(
    model: HandModel, kinematics: ArmKinematics, exclusions: frozenset[tuple[str, str]]
) -> FloatArray:
    """Return a posture (J,) with the flange ahead of the base, above it, and pointing down.

    Of the postures that do not collide, it is one far from joint limits, with high links and small
    joint positions. An arm that cannot point down gets the free posture nearest to it.
    """
    ik = ArmIK(kinematics, model.lower, model.upper)
    targets, reach = _targets_above(ik, kinematics)
    zero = np.clip(0.0, model.lower, model.upper)
    found = ik.solve(targets, seeds=_SEEDS, first=zero)
    q = found.q[found.solved]
    if not len(q):
        q = _pointing_down(ik, kinematics)
    free = _free(model, exclusions, q)
    q = q[free] if free.any() else q
    middle, half = 0.5 * (model.lower + model.upper), 0.5 * (model.upper - model.lower)
    margin = (1.0 - np.abs(q - middle) / half).min(axis=1)
    height = body_poses(model, q)[:, :, 2, 3].mean(axis=1) / reach
    turned = np.abs(q - zero).mean(axis=1)
    return np.asarray(q[np.argmax(np.minimum(margin, _FAR) + 0.5 * height - 0.2 * turned)])


def _targets_above(ik: ArmIK, kinematics: ArmKinematics) -> tuple[FloatArray, float]:
    middle, reach = kinematics.reach(ik.postures)
    yaw = 2.0 * np.pi * np.arange(_YAWS) / _YAWS
    down = np.zeros((_YAWS, 3, 3))
    down[:, 0, 0], down[:, 0, 1] = np.cos(yaw), np.sin(yaw)
    down[:, 1, 0], down[:, 1, 1] = np.sin(yaw), -np.cos(yaw)
    down[:, 2, 2] = -1.0
    targets = np.tile(np.eye(4), (len(_AHEAD), len(_ABOVE), _YAWS, 1, 1))
    targets[..., :3, :3] = down
    targets[..., 0, 3] = middle[0] + reach * np.array(_AHEAD)[:, None, None]
    targets[..., 1, 3] = middle[1]
    targets[..., 2, 3] = reach * np.array(_ABOVE)[:, None]
    return targets.reshape(-1, 4, 4), reach


def _pointing_down(ik: ArmIK, kinematics: ArmKinematics) -> FloatArray:
    poses = kinematics.flange_poses(ik.postures)
    ahead_above = np.minimum(poses[:, 0, 3], 0.1) + np.minimum(poses[:, 2, 3], 0.1)
    return ik.postures[np.argsort(poses[:, 2, 2] - ahead_above)[:_SAMPLES]]


def _free(model: HandModel, exclusions: frozenset[tuple[str, str]], q: FloatArray) -> BoolArray:
    """Return which postures neither collide nor have a link below the base, beyond the first."""
    bodies = BodyPairs(model.link_geometries, pairs_of_bodies(model, exclusions))
    poses = body_poses(model, q)
    centers = bodies.ball_centers(poses)
    near = bodies.may_touch(centers)
    order = joints_before(model)
    far = np.array([order[bodies.geometries[b].link] > 1 for b in bodies.body], dtype=bool)
    free = ((centers[..., 2] > 0.0) | ~far).all(axis=1)
    for n in np.flatnonzero(free):
        bodies.place(poses[n])
        free[n] = next(bodies.touching(np.flatnonzero(near[n])), None) is None
    return np.asarray(free)
