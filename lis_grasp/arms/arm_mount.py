"""Pose of a hand on an arm's flange: the hand's own, or its back on the flange."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.geometry import apply_pose, frame_along, inverse_pose, make_pose
from lis_grasp.records import read_only
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.body_pairs import BodyPairs
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_tree import links_fixed_to
from lis_grasp.typing import FloatArray

CLEARANCE = 0.005
"""Least distance of the hand, in all its postures, from the last two links of the arm [m]."""

# Lengths of an adapter between flange and hand that are tried [m].
_ADAPTERS = 0.005 * np.arange(21)
_BACK = 0.01  # of the hand's hindmost part, which is centred on the flange [m]
_TURNS = 8  # angles of the last joint that are checked


@dataclass(frozen=True, slots=True, eq=False)
class ArmMount:
    """A hand on an arm's flange."""

    X_FB: FloatArray  # (4, 4): the hand's base link in the flange frame
    adapter: float  # length of the spacer between flange and hand [m]; 0 for a hand's own mount


def mount_of(arm: Arm, hand: Hand) -> ArmMount:
    """Return the mount that the hand's file gives, else its back on the flange with an adapter.

    The adapter is the shortest that keeps the hand, in every pregrasp and probe posture, more than
    5 mm from the last two links of the arm. Links of the hand that are fixed to its base may touch
    those that are fixed to the flange.

    Raises
    ------
    InvalidHandError
        If the hand's own mount does not keep that distance, or no adapter of up to 10 cm does.
    """
    if hand.X_FB is not None:
        near = _nearest(arm, hand, hand.X_FB)
        if near is not None:
            raise InvalidHandError(
                f"mount must keep the hand {1e3 * CLEARANCE:g} mm from the last links of arm"
                f" {arm.name} in all pregrasps and probe postures; {near[0]} is within it of"
                f" {near[1]}: move the hand out of the flange by an adapter",
                key="mount",
            )
        return ArmMount(hand.X_FB, 0.0)
    flush = back_on_flange(hand)
    for adapter in _ADAPTERS:
        X_FB = flush.copy()
        X_FB[2, 3] += adapter
        near = _nearest(arm, hand, X_FB)
        if near is None:
            return ArmMount(read_only(X_FB), float(adapter))
    assert near is not None
    raise InvalidHandError(
        f"hand {hand.name} must fit on the flange of arm {arm.name}; even with an adapter of"
        f" {1e3 * _ADAPTERS[-1]:g} mm {near[0]} collides with {near[1]}: give its pose on the"
        " flange under mount in the hand's YAML",
        key="mount",
    )


def back_on_flange(hand: Hand) -> FloatArray:
    """Return the pose X_FB (4, 4) of a hand's base link with its back on the flange.

    The hand's approach is along the flange's +z, and the middle of its hindmost part on its axis.
    """
    approach = hand.approach_H
    posture = next(iter(hand.pregrasps.values()))
    links = hand.forward_kinematics(np.eye(4), posture)
    base = links_fixed_to(hand, hand.base_link)
    bodies = [g for g in hand.link_geometries if g.link in base] or list(hand.link_geometries)
    points = np.vstack(
        [
            apply_pose(X, np.asarray(g.mesh.vertices))
            for g in bodies
            for X in [links[g.link] @ g.X_LG]
        ]
    )
    # Fingers or, of a gripper, its opening along the flange's x.
    axis = next(e for e in np.eye(3)[[2, 0, 1]] if abs(e @ approach) < 0.7)
    R_HF = frame_along(approach, axis)
    in_flange = points @ R_HF
    lowest = in_flange[:, 2].min()
    hindmost = in_flange[in_flange[:, 2] < lowest + _BACK]
    center = 0.5 * (hindmost.min(axis=0) + hindmost.max(axis=0))
    X_HF = make_pose(R_HF, R_HF @ [center[0], center[1], lowest])
    return inverse_pose(hand.X_LH @ X_HF)


def _nearest(arm: Arm, hand: Hand, X_FB: FloatArray) -> tuple[str, str] | None:
    """Return links of hand and arm that are closer than the clearance; None if there are none."""
    order = arm.joints_before
    last = order[arm.flange]
    on_flange = arm.flange_links
    of_arm = [g for g in arm.link_geometries if order[g.link] >= last - 1]
    fixed = links_fixed_to(hand, hand.base_link)
    geometries = [*of_arm, *hand.link_geometries]
    pairs = [
        (i, len(of_arm) + j)
        for i, a in enumerate(of_arm)
        for j, h in enumerate(hand.link_geometries)
        if not (a.link in on_flange and h.link in fixed)
    ]
    bodies = BodyPairs(geometries, np.array(pairs, dtype=np.intp).reshape(-1, 2))
    postures = [
        *hand.pregrasps.values(),
        *(p.joint_positions for p in hand.probe_postures.values()),
    ]
    q = np.tile(arm.home, (_TURNS, 1))
    q[:, -1] = np.linspace(arm.lower[-1], arm.upper[-1], _TURNS)
    links = arm.forward_kinematics(np.eye(4), q)
    X_AF = arm.kinematics.flange_poses(q)
    for posture in postures:
        in_hand = hand.forward_kinematics(X_AF @ X_FB @ hand.X_LH, posture)
        poses = np.stack(
            [links[g.link] @ g.X_LG for g in of_arm]
            + [in_hand[g.link] @ g.X_LG for g in hand.link_geometries],
            axis=1,
        )
        near = bodies.may_touch(bodies.ball_centers(poses), margin=CLEARANCE)
        for turn in range(_TURNS):
            bodies.place(poses[turn])
            for pair in np.flatnonzero(near[turn]):
                if bodies.distance(int(pair)) < CLEARANCE:
                    i, j = bodies.pairs[pair]
                    return geometries[j].link, geometries[i].link
    return None
