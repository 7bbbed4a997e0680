"""Frames of a robot's links in a log, from its joint states and its description."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidInputError, listed, note
from lis_grasp.logs._column_names import COMMANDS
from lis_grasp.logs.readers import FrameTree, JointSeries, RobotLog, TimedPoses
from lis_grasp.logs.reading import LogReading
from lis_grasp.robots.described_joints import reach_of, read_joints
from lis_grasp.typing import FloatArray

# A joint may be this far outside of its limits [rad or m], because calibrations differ.
_BEYOND = 0.1
_LATEST = 0.5  # [s] that a robot may be behind its commands


def with_link_frames(
    log: RobotLog,
    description: Path,
    reading: LogReading = LogReading(),
    *,
    xacro_args: Mapping[str, str] = MappingProxyType({}),
) -> RobotLog:
    """Return a log whose frames include the links of a robot.

    Each joint that the log's joint states name gives the transform from its parent link to its
    child; joints that mimic another follow it. A pose beyond a joint whose position is unknown,
    or contradictory, is refused, with the reason, when it is requested.

    Parameters
    ----------
    log
        A log with joint states, such as ``/joint_states``, or columns with the joints' names.
    description
        URDF, SDF or MJCF of the robot. Its meshes are not needed.
    reading
        The unit of joints that turn.
    xacro_args
        Arguments of a xacro file, by name.

    Raises
    ------
    InvalidInputError
        If the log has no joint of the robot.
    InvalidFileError, InvalidHandError
        If the description cannot be read.
    """
    joints = read_joints(description, xacro_args)
    moving = [joint for joint in joints if not joint.is_fixed]
    found = log.joints(tuple(dict.fromkeys(joint.leader for joint in moving)))
    logged, others = (
        {name: [s for s in series if s.is_left_out == out] for name, series in found.items()}
        for out in (False, True)
    )
    if not any(logged.values()):
        named = ", ".join(dict.fromkeys(joint.joint.name for joint in moving)) or "none"
        raise InvalidInputError(
            f"the log must have joint states of {description}, whose movable joints are"
            f" {named}; it has none of them{_others(log)}"
        )
    tracks = {
        joint.leader: _one_track(joint.joint, logged, log, reading)
        for joint in moving
        if joint.leader == joint.joint.name
    }
    if reading.angles == "deg":
        _question_degrees(tracks, {joint.joint.name: joint.joint for joint in moving})
    _question_commands(tracks, others)
    frames, unknown = {}, {}
    still = JointSeries("", np.zeros(1), np.zeros(1))
    for joint in joints:
        missing = f"the description has no joint {joint.leader}"
        track = still if joint.is_fixed else tracks.get(joint.leader, missing)
        if isinstance(track, str):
            unknown[joint.ends] = track
        else:
            X_PC = joint.poses(track.positions)
            frames[joint.ends] = _timed(track.times, X_PC, *joint.ends)
    edges = [*frames, *unknown]
    base = min({parent for parent, _ in edges} - {child for _, child in edges})
    own = log.frames()
    sources = {track.source for track in tracks.values() if not isinstance(track, str)}
    tree = FrameTree(
        {**own.transforms, **frames},
        {**own.unknown, **unknown},
        (*own.sources, *sorted(sources)),
    )
    return log.with_links(tree, base, reach_of(joints))


def _one_track(
    joint: Any, logged: Mapping[str, list[JointSeries]], log: RobotLog, reading: LogReading
) -> JointSeries | str:
    """Return the positions of a joint from its sources, or why they cannot be used."""
    name, series = joint.name, logged.get(joint.name, [])
    whole = max(float(np.ptp(each.times)) for found in logged.values() for each in found)
    if not series:
        return f"the log has no joint state of {name}{_others(log)}"
    moving = [each for each in series if np.ptp(each.positions) > 0.0]
    if len(series) > 1 and moving and len(moving) < len(series):
        still = [each for each in series if np.ptp(each.positions) == 0.0]
        places = ", ".join(f"{each.positions[0]:g} ({each.source})" for each in still)
        note(f"joint {name}: positions that never change are left out, others do: {places}")
        series = moving
    sources = sorted({each.source for each in series})
    if len(sources) > 1:
        in_topics = {*sources} <= {topic.name for topic in log.topics if topic.content == "joints"}
        advice = "name the one to use by `joint_states`" if in_topics else "keep one column"
        return f"the joint {name} is in {' and '.join(sources)}: {advice}"
    times = np.concatenate([each.times for each in series])
    joined = JointSeries(sources[0], times, np.concatenate([each.positions for each in series]))
    positions = joined.positions
    if len(series) > 1 and _travel(positions) > 2.0 * sum(_travel(s.positions) for s in series):
        return (
            f"the joint {name} of {sources[0]} has two positions at nearly one time, of two"
            " publishers: record them on topics of their own"
        )
    if len(np.unique(times)) < 2 and whole > 0.0:
        return (
            f"the log has one state of the joint {name} in {whole:.3g} s, {positions[0]:g}: record"
            " all, or make the joint fixed in the description, its origin at this position and not"
            " at 0"
        )
    if joint.type == "revolute" and reading.angles == "deg":
        positions = np.radians(positions)
    if reading.angles is None and (reason := _beyond_limits(joint, positions)):
        return reason
    return replace(joined, positions=positions)


def _question_degrees(tracks: Mapping[str, JointSeries | str], joints: Mapping[str, Any]) -> None:
    """Note that positions taken as degrees would be within the limits in rad as well."""
    turning = {
        name: np.degrees(track.positions)
        for name, track in tracks.items()
        if not isinstance(track, str) and joints[name].type == "revolute"
    }
    if turning and not any(_beyond_limits(joints[name], q) for name, q in turning.items()):
        farthest = max(float(np.nanmax(np.abs(q))) for q in turning.values())
        note(
            f"positions of {listed(sorted(turning))} reach {farthest:.3g}, within their limits in"
            " rad as well: give `angles` deg only if they are in degrees"
        )


def _question_commands(
    tracks: Mapping[str, JointSeries | str], others: Mapping[str, list[JointSeries]]
) -> None:
    """Note positions that stand still, lead or are named otherwise than those that are left out.

    Such are commands, on which no contact may depend.
    """
    for name, track in tracks.items():
        for other in others.get(name, ()):
            if isinstance(track, str):
                break
            lead = _lead(track, other)
            if not np.ptp(track.positions) and np.ptp(other.positions):
                seen = f"never changes in {track.source}, and does in {other.source}"
            elif lead:
                seen = f"is {lead:.2g} s earlier in {track.source} than in {other.source}"
            elif _is_command(track.source) and not _is_command(other.source):
                seen = f"is in {track.source}, named as commands, and in {other.source}"
            else:
                continue
            note(
                f"the joint {name} {seen}: if the first has commands and not measurements, give"
                f" `joint_states` {other.source}"
            )
            return


def _is_command(topic: str) -> bool:
    return bool(COMMANDS & set(re.split(r"[^a-z]+", topic.lower())))


def _lead(track: JointSeries, other: JointSeries) -> float:
    """Return how much earlier a joint moves in one series than in another [s]; 0 if it does not.

    The series are shifted until they agree; they must agree twice as well as unshifted.
    """
    times, positions = other.times, other.positions
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if not step or not np.ptp(track.positions):
        return 0.0
    shifts = step * np.arange(int(_LATEST / step) + 1)
    apart = []
    for shift in shifts:
        moved = np.interp(times - shift, track.times, track.positions)
        apart.append(float(np.sqrt(np.mean((moved - positions) ** 2))))
    best = int(np.argmin(apart))
    return float(shifts[best]) if best > 1 and 2.0 * apart[best] < apart[0] else 0.0


def _travel(positions: FloatArray) -> float:
    return float(np.abs(np.diff(positions)).sum())


def _beyond_limits(joint: Any, positions: FloatArray) -> str:
    """Return how positions of a joint contradict its limits; empty if they do not."""
    limit = joint.limit
    if limit is None or limit.lower is None or limit.upper is None or joint.type == "continuous":
        return ""
    low, high = float(np.nanmin(positions)), float(np.nanmax(positions))
    if limit.lower >= limit.upper or (
        limit.lower - _BEYOND <= low and high <= limit.upper + _BEYOND
    ):
        return ""
    ways = "if they are in degrees, give `angles` deg; else"
    return (
        f"positions of the joint {joint.name} are from {low:.4g} to {high:.4g}, and its limits"
        f" {limit.lower:g} to {limit.upper:g}: {ways if joint.type == 'revolute' else ''} correct"
        " the limits, or give `angles` rad to leave them unchecked"
    )


def _others(log: RobotLog) -> str:
    names = log.joint_names()
    return f"; it has {', '.join(names)}" if names else ""


def _timed(times: FloatArray, X: FloatArray, parent: str, child: str) -> TimedPoses:
    values = np.hstack([X[:, :3, 3], Rotation.from_matrix(X[:, :3, :3]).as_quat()])
    return TimedPoses.collect(times, values, parent, child, f"{parent} to {child}")
