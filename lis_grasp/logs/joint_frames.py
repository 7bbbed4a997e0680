"""Frames of a robot's links in a log, from its joint states and its description."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidInputError
from lis_grasp.logs.readers import FrameTree, RobotLog, TimedForces, TimedPoses, Topic
from lis_grasp.robots.described_joints import read_joints
from lis_grasp.typing import FloatArray


def with_link_frames(log: RobotLog, description: Path) -> RobotLog:
    """Return a log whose frames include the links of a robot.

    Each joint that the log's joint states name gives the transform from its parent link to its
    child; joints that mimic another follow it. Links beyond other joints have no pose.

    Parameters
    ----------
    log
        A log with joint states, such as ``/joint_states``, or columns with the joints' names.
    description
        URDF, SDF or MJCF of the robot. Its meshes are not needed.

    Raises
    ------
    InvalidInputError
        If the log has no joint of the robot.
    InvalidFileError, InvalidHandError
        If the description cannot be read.
    """
    joints = read_joints(description)
    logged = log.joints(tuple(dict.fromkeys(j.leader for j in joints if not j.is_fixed)))
    if not logged:
        named = ", ".join(dict.fromkeys(j.joint.name for j in joints if not j.is_fixed)) or "none"
        raise InvalidInputError(
            f"the log must have joint states of {description}, whose movable joints are"
            f" {named}; it has none of them"
        )
    frames = {}
    for joint in joints:
        if joint.is_fixed:
            still = np.zeros(1)
            frames[joint.ends] = _timed(still, joint.poses(still), *joint.ends)
        elif joint.leader in logged:
            times, positions = logged[joint.leader]
            frames[joint.ends] = _timed(times, joint.poses(positions), *joint.ends)
    base = min({parent for parent, _ in frames} - {child for _, child in frames})
    return _LogWithLinks(log, FrameTree({**log.frames().transforms, **frames}), base)


def _timed(times: FloatArray, X: FloatArray, parent: str, child: str) -> TimedPoses:
    values = np.hstack([X[:, :3, 3], Rotation.from_matrix(X[:, :3, :3]).as_quat()])
    return TimedPoses.collect(times, values, parent, child, f"{parent} to {child}")


@dataclass(frozen=True, slots=True)
class _LogWithLinks(RobotLog):
    """A log with the frames of a robot; poses without a frame are in the frame of its base."""

    log: RobotLog
    tree: FrameTree
    base: str

    @property
    def topics(self) -> tuple[Topic, ...]:  # type: ignore[override]
        return self.log.topics

    def forces(self, topic: str) -> TimedForces:
        return self.log.forces(topic)

    def poses(self, topic: str) -> TimedPoses:
        poses = self.log.poses(topic)
        return poses if poses.parent else replace(poses, parent=self.base)

    def joints(self, names: tuple[str, ...]) -> dict[str, tuple[FloatArray, FloatArray]]:
        return self.log.joints(names)

    def frames(self) -> FrameTree:
        return self.tree
