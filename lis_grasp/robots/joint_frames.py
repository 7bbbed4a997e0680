"""Frames of a robot's links in a log, from its joint states and its description."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidInputError
from lis_grasp.logs.readers import FrameTree, RobotLog, TimedForces, TimedPoses, Topic
from lis_grasp.robots._build_model import pose_matrix, unit_axis
from lis_grasp.robots._description import DescriptionEdits, apply_edits, parse_description
from lis_grasp.robots._urdf import naming
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
    with naming(description):
        robot = apply_edits(parse_description(description), DescriptionEdits())
        leaders = {
            joint.name: joint.name if joint.mimic is None else joint.mimic.joint
            for joint in robot.joints
            if joint.type != "fixed"
        }
        logged = log.joints(tuple(dict.fromkeys(leaders.values())))
        if not logged:
            named = ", ".join(leaders) or "none"
            raise InvalidInputError(
                f"the log must have joint states of {description}, whose movable joints are"
                f" {named}; it has none of them"
            )
        frames = {}
        for joint in robot.joints:
            X_PJ, ends = pose_matrix(joint.origin), (joint.parent, joint.child)
            if joint.type == "fixed":
                frames[ends] = _timed(np.zeros(1), X_PJ[None], *ends)
            elif leaders[joint.name] in logged:
                times, positions = logged[leaders[joint.name]]
                if joint.mimic is not None:
                    ratio = 1.0 if joint.mimic.multiplier is None else joint.mimic.multiplier
                    positions = ratio * positions + (joint.mimic.offset or 0.0)
                along = positions[:, None] * unit_axis(joint)  # (T, 3)
                X_JC = np.tile(np.eye(4), (len(times), 1, 1))
                if joint.type == "prismatic":
                    X_JC[:, :3, 3] = along
                else:
                    X_JC[:, :3, :3] = Rotation.from_rotvec(along).as_matrix()
                frames[ends] = _timed(times, X_PJ @ X_JC, *ends)
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
