"""A hand on the flange of an arm: its mount, the table, and kinematics of the palm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidHandError, InvalidOptionError
from lis_grasp.geometry import (
    apply_pose,
    as_pose,
    cross,
    frame_along,
    inverse_pose,
    make_pose,
    require_pose,
    rotate,
)
from lis_grasp.records import read_only
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.body_pairs import BodyPairs
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.pose_ik import ArmSolutions
from lis_grasp.robots.robot_model import links_fixed_to
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.world import Table

CLEARANCE = 0.005
"""Least distance of the hand, in all its postures, from the last two links of the arm [m]."""

# Lengths of an adapter between flange and hand that are tried [m].
_ADAPTERS = 0.005 * np.arange(21)
_BACK = 0.01  # of the hand's hindmost part, which is centred on the flange [m]
_TURNS = 8  # angles of the last joint that are checked

_Mounted = TypeVar("_Mounted", bound="MountedHand")


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

    Raises `InvalidHandError` if the hand's own mount does not keep that distance, or no adapter of
    up to 10 cm does.
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


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class MountedHand:
    """A hand on an arm, which is on its base at a table.

    Frames: W world, in which the object is estimated and grasps are planned; A the arm's base
    link, F its flange, B the hand's base link, H the palm. J joints of the arm.

    Raises `InvalidOptionError` if the base is not a pose, or is inside the table.
    """

    arm: Arm
    hand: Hand
    X_WA: FloatArray  #: (4, 4), pose of the arm's base
    mount: ArmMount  #: of the hand on the flange
    table: Table | None = None

    @classmethod
    def make(
        cls: type[_Mounted],
        arm: Arm,
        hand: Hand,
        X_WA: npt.ArrayLike,
        *,
        table: Table | None = None,
    ) -> _Mounted:
        """Return an arm with a hand, the hand mounted as by `mount_of`."""
        return cls(arm, hand, as_pose(X_WA), mount_of(arm, hand), table)

    def __post_init__(self) -> None:
        X_WA = require_pose("X_WA", self.X_WA)
        object.__setattr__(self, "X_WA", X_WA)
        table = self.table
        if table is not None:
            aside = np.abs(X_WA[:2, 3] - table.center).max() > table.half_width
            if not aside and X_WA[2, 3] < table.height - 1e-6:
                raise InvalidOptionError(
                    f"the arm's base must be on the table, {table.height:g} m high, or beside it;"
                    f" it is {X_WA[2, 3]:g} m high in its middle",
                    option="base",
                    value=self.X_WA,
                )

    def __repr__(self) -> str:
        place = ", ".join(f"{x:g}" for x in self.X_WA[:3, 3])
        return f"{type(self).__name__}({self.arm.name} with {self.hand.name}, base at ({place}))"

    def moved(self: _Mounted, X_WA: npt.ArrayLike) -> _Mounted:
        """Return the same arm and hand with its base at another pose (4, 4)."""
        return replace(self, X_WA=as_pose(X_WA))

    def in_frame(self: _Mounted, X_WF: FloatArray) -> _Mounted:
        """Return the same in a frame F, whose pose in the present W is `X_WF` (4, 4)."""
        table = None if self.table is None else self.table.in_frame(X_WF)
        return replace(self, X_WA=as_pose(inverse_pose(X_WF) @ self.X_WA), table=table)

    @cached_property
    def X_FH(self) -> FloatArray:
        """The palm in the flange frame, shape (4, 4)."""
        return read_only(self.mount.X_FB @ self.hand.X_LH)

    def palm_poses(self, q: npt.ArrayLike) -> FloatArray:
        """Return the palm's poses X_WH, (..., 4, 4), at the arm's positions q (..., J)."""
        return np.asarray(self.X_WA @ self.arm.kinematics.flange_poses(q) @ self.X_FH)

    def jacobians(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the palm's poses X_WH (..., 4, 4) and Jacobians (..., 6, J).

        Rows 0 to 2 are the velocity of the palm's origin along W's axes, 3 to 5 its angular
        velocity, for each joint's rate.
        """
        X_AF, of_flange = self.arm.kinematics.jacobians(q)
        R_WA = self.X_WA[:3, :3]
        linear, angular = R_WA @ of_flange[..., :3, :], R_WA @ of_flange[..., 3:, :]
        # The palm's origin moves with the flange, and about it.
        lever = rotate(self.X_WA @ X_AF, self.X_FH[:3, 3])[..., None, :]  # (..., 1, 3)
        about = cross(np.swapaxes(angular, -1, -2), lever)
        linear = linear + np.swapaxes(about, -1, -2)
        return self.X_WA @ X_AF @ self.X_FH, np.concatenate([linear, angular], axis=-2)

    def solve_ik(
        self, X_WH: npt.ArrayLike, *, seeds: int = 8, first: FloatArray | None = None
    ) -> ArmSolutions:
        """Return the arm's positions for palm poses X_WH (N, 4, 4), as `ArmIK.solve`."""
        return self.arm.ik.solve(self._flange_targets(X_WH), seeds=seeds, first=first)

    def follow(self, q: npt.ArrayLike, X_WH: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return positions near q (B, J) for palm poses (B, 4, 4), and which were found, (B,)."""
        return self.arm.ik.follow(np.asarray(q, np.float64), self._flange_targets(X_WH))

    def _flange_targets(self, X_WH: npt.ArrayLike) -> FloatArray:
        to_base, to_flange = inverse_pose(self.X_WA), inverse_pose(self.X_FH)
        return np.asarray(to_base @ as_pose(X_WH) @ to_flange)
