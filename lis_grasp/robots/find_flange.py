"""Flange frame of an arm whose file gives the flange's link only."""

from __future__ import annotations

import numpy as np

from lis_grasp.geometry import apply_pose, axis_across, frame_along, inverse_pose, make_pose, rotate
from lis_grasp.robots.find_arm_posture import joints_before
from lis_grasp.robots.hand_parts import joints_to
from lis_grasp.robots.link_tree import HandModel, link_kinematics
from lis_grasp.typing import FloatArray

BEYOND = 0.03
"""Bodies of the last link may be as far beyond the flange frame [m]: mounts and their covers."""

_ALONG = 0.999  # cosine of the angle between axes that are parallel


def flange_frame(model: HandModel, flange: str) -> FloatArray:
    """Return the flange frame F in the flange's link, X_LF (4, 4), from the bodies about it.

    A flange points along the axis of the last joint, to the side where the last link reaches beyond
    the link before. F is the link's frame if its +z does, else a frame at the same place that does.
    If bodies of the last link are more than 3 cm beyond F, it is moved out to their end.
    """
    order = joints_before(model)
    last = order[flange]
    middle = np.clip(0.0, model.lower, model.upper)
    kinematics = link_kinematics(model)
    links = kinematics.poses(np.eye(4), middle)
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
