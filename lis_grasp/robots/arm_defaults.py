"""What an arm's file leaves out: the flange frame, links that may touch, the home posture."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from lis_grasp.geometry import apply_pose, axis_across, frame_along, inverse_pose, make_pose, rotate
from lis_grasp.robots.body_pairs import BodyPairs, pairs_of_bodies
from lis_grasp.robots.kinematics import ArmKinematics, body_poses, link_kinematics
from lis_grasp.robots.pose_ik import ArmIK
from lis_grasp.robots.robot_model import RobotModel, joints_before, joints_to
from lis_grasp.typing import BoolArray, FloatArray

BEYOND = 0.03
"""Bodies of the last link may be as far beyond the flange frame [m]: mounts and their covers."""

_ALONG = 0.999  # cosine of the angle between axes that are parallel

_SAMPLES = 120  # postures that are compared if no flange can point down at home

# Places of the flange at home, as fractions of the reach: ahead of the base and above it.
_AHEAD, _ABOVE = 0.5, (0.5, 0.4, 0.6)


def flange_frame(model: RobotModel, flange: str) -> FloatArray:
    """Return the flange frame F in the flange's link, X_LF (4, 4), from the bodies about it.

    A flange points along the axis of the last joint, to the side where the last link reaches beyond
    the link before. F is the link's frame if its +z does, else a frame at the same place that does.
    If bodies of the last link are more than 3 cm beyond F, it is moved out to their end.
    """
    order = joints_before(model)
    last = order[flange]
    middle = np.clip(0.0, model.lower, model.upper)
    links = link_kinematics(model).poses(np.eye(4), middle)
    X_LA = inverse_pose(links[flange])

    def corners(number: int) -> FloatArray:
        return np.vstack(
            [np.zeros((1, 3))]
            + [
                apply_pose(X, np.asarray(g.mesh.vertices))
                for g in model.link_geometries
                if order[g.link] == number
                for X in [X_LA @ links[g.link] @ g.X_LG]
            ]
        )

    joint = next(j for j in reversed(joints_to(model.joints, flange)) if j.kind != "fixed")
    axis = rotate(X_LA @ links[joint.child], joint.axis_J)
    sides = np.array([axis, -axis])
    own = (corners(last) @ sides.T).max(axis=0)  # (2,)
    side = int(np.argmax(own - (corners(last - 1) @ sides.T).max(axis=0)))
    out = sides[side]
    R_LF = frame_along(out, axis_across(out)) if out[2] < _ALONG else np.eye(3)
    return make_pose(R_LF, own[side] * out if own[side] > BEYOND else np.zeros(3))


def find_arm_exclusions(model: RobotModel) -> frozenset[tuple[str, str]]:
    """Return the pairs of links that may touch, each sorted: one movable joint or none is between.

    Other pairs that touch by design are named in the arm's file.
    """
    order = joints_before(model)
    links = dict.fromkeys(g.link for g in model.link_geometries)
    pairs = ((min(pair), max(pair)) for pair in combinations(links, 2))
    return frozenset((a, b) for a, b in pairs if abs(order[a] - order[b]) <= 1)


def find_home(
    model: RobotModel, kinematics: ArmKinematics, exclusions: frozenset[tuple[str, str]]
) -> FloatArray:
    """Return a posture (J,) with the flange ahead of the base, above it, and pointing down.

    Of the postures that do not collide, it is one far from joint limits, with high links and small
    joint positions. An arm that cannot point down gets the free posture nearest to it.
    """
    ik = ArmIK(kinematics, model.lower, model.upper)
    middle, reach = kinematics.reach(ik.postures)
    targets = np.tile(make_pose(np.diag([1.0, -1.0, -1.0]), middle), (len(_ABOVE), 1, 1))
    targets[:, 0, 3] += _AHEAD * reach
    targets[:, 2, 3] = np.array(_ABOVE) * reach
    zero = np.clip(0.0, model.lower, model.upper)
    solutions = ik.solve(targets, first=zero)
    q = solutions.q[solutions.solved]
    if not len(q):  # no flange can point down: the nearest to it
        poses = kinematics.flange_poses(ik.postures)
        ahead_above = np.minimum(poses[:, 0, 3], 0.1) + np.minimum(poses[:, 2, 3], 0.1)
        q = ik.postures[np.argsort(poses[:, 2, 2] - ahead_above)[:_SAMPLES]]
    free = _free(model, exclusions, q)
    q = q[free] if free.any() else q
    half = 0.5 * (model.upper - model.lower)
    margin = (1.0 - np.abs(q - model.lower - half) / half).min(axis=1)
    height = body_poses(model, q)[:, :, 2, 3].mean(axis=1) / reach
    turned = np.abs(q - zero).mean(axis=1)
    return np.asarray(q[np.argmax(margin + 0.5 * height - 0.2 * turned)])


def _free(model: RobotModel, exclusions: frozenset[tuple[str, str]], q: FloatArray) -> BoolArray:
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
