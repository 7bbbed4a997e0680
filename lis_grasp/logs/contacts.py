"""Touches in a robot's log: forces, tip and object brought to the same times and frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidInputError, InvalidOptionError
from lis_grasp.exploration.touch_detection import (
    TOUCHES,
    TouchDetection,
    Touches,
    contacts_of_touches,
    detect_touches,
)
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.io.option import LARGEST_NUMBER, at_least, option, place, record_of_options
from lis_grasp.logs._doubts import (
    question_directions,
    question_force_frame,
    question_object,
    require_places,
)
from lis_grasp.logs._streams import LONGEST_GAP, Content, FrameTree, TimedForces
from lis_grasp.logs.readers import RobotLog
from lis_grasp.logs.reading import TOPICS
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True)
class Finger:
    """A finger of the log.

    Parameters
    ----------
    force
        Topic of its force; None takes the only one of the log.
    tip
        Topic or frame of its tip's pose; None takes the only topic of poses beside the object's.
    name
        Name of the finger in the contacts.
    """

    force: str | None = None
    tip: str | None = None
    name: str = ""


@record_of_options
class LogFrames:
    """Frames of a log, and the object's; conditioning of the forces.

    In Python, `object_frame` is a (4, 4) matrix or its rows.
    """

    object_pose: str | None = option(
        None,
        "topic or transform frame of the object's pose",
        TOPICS,
        metavar="NAME",
        words="it is fixed",
    )
    object_frame: tuple[tuple[float, ...], ...] | None = option(
        None,
        "fixed pose of the object, X Y Z [QX QY QZ QW], in the frame of the tip's poses",
        TOPICS,
        metavar="NUMBER",
        words="that frame is the object's",
    )
    tip_frame: str | None = option(
        None, "frame of the tip's poses, if not in LOG", TOPICS, metavar="FRAME"
    )
    force_frame: str | None = option(
        None,
        "frame of the force: tip, base (of the tip's poses), or a frame of LOG",
        TOPICS,
        metavar="FRAME",
        words="as LOG says, else the tip's",
    )
    tip_offset: tuple[float, float, float] = option(
        (0.0, 0.0, 0.0),
        "centre of the tip in the frame of its pose [m]",
        TOUCHES,
        metavar=("X", "Y", "Z"),
        words="0 0 0",
        check=place,
    )
    tare: float = option(
        0.0,
        "subtract the mean force of the first seconds",
        TOUCHES,
        metavar="SECONDS",
        check=at_least(0),
    )
    smoothing: float = option(
        0.0,
        "length of a moving mean of the forces",
        TOUCHES,
        metavar="SECONDS",
        check=at_least(0),
    )

    def __post_init__(self) -> None:
        if self.object_pose is not None and self.object_frame is not None:
            raise InvalidOptionError(
                "the object's pose is either a topic or fixed; both are given: give one"
            )


def contacts_from_log(
    log: RobotLog, fingers: list[Finger], frames: LogFrames, detection: TouchDetection
) -> tuple[Contacts, list[Touches]]:
    """Detect the touches in a log; return the contacts in the object frame O, and the touches.

    Poses are interpolated at the times of the forces. A force whose frame the log does not know is
    taken to turn with the tip.

    Raises `InvalidInputError` if a topic is missing, ambiguous or unrelated to the others, or there
    is no touch.
    """
    touches = [_touches(log, finger, frames, detection) for finger in fingers]
    if not any(len(touch.times) for touch in touches):
        unposed = sum(touch.unposed for touch in touches)
        raise InvalidInputError(
            f"all {unposed} touches are at times without a pose of tip and object: check that the"
            f" topics overlap in time{_slow_topics(log)}"
            if unposed
            else f"no force rises from below {detection.release * detection.threshold:g} N to"
            f" {detection.threshold:g} N: lower the threshold, or subtract the sensor's offset"
            " with `tare`"
        )
    contacts = contacts_of_touches(touches, detection)
    centers = np.concatenate([touch.centers for touch in touches])
    require_places(centers, "if its positions are in millimetres, name the columns x_mm,y_mm,z_mm")
    if frames.object_pose is None:
        question_object(log, touches)
    return contacts, touches


def _slow_topics(log: RobotLog) -> str:
    """Return which topics of poses and frames are too slow to be interpolated; empty for none."""
    timed = {topic.name: log.poses(topic.name) for topic in log.topics if topic.content == "pose"}
    timed |= {f"the frame {ends[1]}": poses for ends, poses in log.frames().transforms.items()}
    slow = []
    for name, poses in timed.items():
        step = float(np.median(np.diff(poses.times))) if len(poses.times) > 1 else 0.0
        slow += [f"{name} has a pose every {step:.2g} s"] if step > LONGEST_GAP else []
    needed = f"; one every {LONGEST_GAP:g} s is needed: " if slow else ""
    return needed + ", ".join(slow)


def choose_topic(log: RobotLog, content: Content, given: str | None, option: str, *but: str) -> str:
    """Return the given topic, or the only one with the content, except those in `but`.

    Raises `InvalidInputError` if it is not there, or there is not exactly one.
    """
    names = [topic.name for topic in log.topics if topic.content == content]
    known = ", ".join(names) or "none"
    if given is not None:
        if given not in names:
            raise InvalidInputError(
                f"{option} must be a topic of content '{content}'; '{given}' is not: the log has"
                f" {known}"
            )
        return given
    others = [name for name in names if name not in but]
    if len(others) != 1:
        raise InvalidInputError(
            f"the log has {len(others) or 'no'} topics of content '{content}' to choose from"
            f" ({known}): choose one by `{option}`"
        )
    return others[0]


def _touches(
    log: RobotLog, finger: Finger, frames: LogFrames, detection: TouchDetection
) -> Touches:
    topic = choose_topic(log, "force", finger.force, "force")
    measured = log.forces(topic)
    valid = np.all(np.abs(measured.forces) < LARGEST_NUMBER, axis=1)  # False for NaN
    valid &= np.isfinite(measured.times)
    if not valid.any():
        raise InvalidInputError("the topic of the force has no messages: choose another")
    measured = replace(measured, times=measured.times[valid], forces=measured.forces[valid])
    times = measured.times
    base, X_PT, tip = _pose_of(log, finger.tip, frames, times, "tip")
    but = frames.object_pose or ""
    tip_name = finger.tip or choose_topic(log, "pose", None, "tip", but)
    if frames.object_pose is None:
        fixed = np.eye(4) if frames.object_frame is None else np.array(frames.object_frame)
        X_PO = np.tile(fixed, (len(times), 1, 1))
    else:
        other, X_BO, _ = _pose_of(log, frames.object_pose, None, times, "object_pose", near=base)
        X_PO = _related(log, base, other, times) @ X_BO
    X_OP = inverse_pose(X_PO)
    X_OT = X_OP @ X_PT
    forces = _conditioned(measured, frames)
    tips = apply_pose(X_OT, np.asarray(frames.tip_offset, dtype=np.float64))

    def touches_in(R_OF: FloatArray) -> Touches:
        turned, known = forces.copy(), np.isfinite(R_OF[:, 0, 0])
        if forces.shape[1] == 3:
            # A rotation that is unknown must not hide a touch.
            turned[known] = np.einsum("tij,tj->ti", R_OF[known], forces[known])
        return detect_touches(times, turned, tips, detection, finger=finger.name, directed=known)

    given = frames.force_frame or measured.frame
    R_OF = _named_frame(given, log, base, tip, times, X_OP, X_OT)
    if R_OF is None and frames.force_frame:
        raise InvalidOptionError(
            f"force_frame must be tip, base, or a frame of the log; it is '{frames.force_frame}'",
            option="force_frame",
            value=frames.force_frame,
        )
    touches = touches_in(X_OT[:, :3, :3] if R_OF is None else R_OF)
    taken = "magnitudes"
    if forces.shape[1] == 3:
        taken = f"in the frame {given}" if R_OF is not None else "taken in the tip's frame"
        if not frames.force_frame and detection.normals != "approach":
            others = {"base": X_OP[:, :3, :3], "tip": X_OT[:, :3, :3]}
            found = {name: touches_in(R) for name, R in others.items()}
            question_force_frame(touches, found, stated=measured.frame if R_OF is not None else "")
        if detection.normals != "approach":
            question_directions(touches, detection)
    posed = X_PT[np.isfinite(X_PT[:, 0, 0]), :3, :3]
    turns = bool(len(posed)) and float(np.ptp(posed, axis=0).max()) > 0.0
    streams = [
        ("force", topic, taken),
        ("tip", tip_name, "" if turns else "never turned"),
    ]
    if frames.object_pose is not None:
        streams.append(("object", frames.object_pose, ""))
    return replace(touches, streams=tuple(streams))


def _pose_of(
    log: RobotLog,
    given: str | None,
    frames: LogFrames | None,
    times: FloatArray,
    option: str,
    near: str = "",
) -> tuple[str, FloatArray, str]:
    """Return base frame, poses (T, 4, 4) in it, and child frame of a topic or frame.

    `near` is the base of a frame in the log's transforms, if it is one.
    """
    frame = None if given is None else given.lstrip("/")
    named = (frames.tip_frame or "").lstrip("/") if frames is not None else ""
    topics = {topic.name for topic in log.topics if topic.content == "pose"}
    if given is not None and given not in topics:
        tree = log.frames()
        if frame in tree.frames:
            base = named or (near if near in tree.frames else _root(tree))
            return base, tree.pose(base, frame, times), frame
        raise InvalidInputError(
            f"{option} must be a topic of poses or a frame; '{given}' is not: the log has the"
            f" topics {', '.join(sorted(topics)) or 'none'} and the frames"
            f" {', '.join(tree.frames) or 'none'}"
        )
    but = frames.object_pose if frames is not None and frames.object_pose else ""
    poses = log.poses(choose_topic(log, "pose", given, option, but))
    return named or poses.parent, poses.at(times), poses.child


def _root(tree: FrameTree) -> str:
    edges = (*tree.transforms, *tree.unknown)
    roots = sorted({parent for parent, _ in edges} - {child for _, child in edges})
    if len(roots) != 1:
        raise InvalidInputError(
            f"the log's transforms have {len(roots)} root frames ({', '.join(roots)}): name the"
            " base frame by `tip_frame`"
        )
    return roots[0]


def _related(log: RobotLog, base: str, other: str, times: FloatArray) -> FloatArray:
    """Return poses of the object's base frame in the tip's, (T, 4, 4)."""
    if base == other:
        return np.tile(np.eye(4), (len(times), 1, 1))
    tree = log.frames()
    if not tree.transforms and "" in (base, other):
        return np.tile(np.eye(4), (len(times), 1, 1))
    if not base:
        raise InvalidInputError(
            f"the tip's poses have no frame, the object's are in '{other}': name the tips' frame"
            f" by `tip_frame`, one of {', '.join(tree.frames)}"
        )
    return tree.pose(base, other, times)


def _named_frame(
    name: str,
    log: RobotLog,
    base: str,
    tip: str,
    times: FloatArray,
    X_OP: FloatArray,
    X_OT: FloatArray,
) -> FloatArray | None:
    """Return rotations (T, 3, 3) of a frame in O: `tip`, `base` or the log's; None if unknown."""
    name = name.lstrip("/")
    if name and name in (base, "base") and not (name == "base" and tip == "base"):
        return X_OP[:, :3, :3]
    if name and name in (tip, "tip"):
        return X_OT[:, :3, :3]
    tree = log.frames() if name else FrameTree({})
    if name and {name, base} <= set(tree.frames):
        return (X_OP @ tree.pose(base, name, times))[:, :3, :3]
    return None


def _conditioned(measured: TimedForces, frames: LogFrames) -> FloatArray:
    """Return the forces without their offset, smoothed."""
    forces = measured.forces.copy()
    if frames.tare > 0.0:
        first = measured.times <= measured.times[0] + frames.tare
        forces -= forces[first].mean(axis=0)
    step = float(np.median(np.diff(measured.times))) if len(forces) > 1 else 0.0
    if frames.smoothing > step > 0.0:
        count = round(frames.smoothing / step)
        forces = uniform_filter1d(forces, count, axis=0, mode="nearest")
    return forces
