"""Forces and poses of a finger in a log, brought to the same times and to the object frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from lis_grasp.exceptions import InvalidInputError
from lis_grasp.exploration.touch_detection import TouchDetection, Touches, detect_touches
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.io.option import LARGEST_NUMBER
from lis_grasp.logs._streams import Content, FrameTree, TimedForces
from lis_grasp.logs.readers import RobotLog
from lis_grasp.logs.reading import Finger, LogFrames
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class AlignedLog:
    """Forces and poses of a finger at the same times. Made by `align`.

    Attributes
    ----------
    finger, topic, tip_topic
        The finger, and the topics of its force and tip.
    times
        Shape (T,) [s].
    forces
        Shape (T, 3) [N] in their own frame, or magnitudes (T, 1).
    tips
        Shape (T, 3) [m], centre of the tip in O; NaN where unknown.
    turns
        Whether the tip's frame ever turns in that of its poses.
    frames
        Rotations (T, 3, 3) to O: of `tip`, of `base`, and of `given`, if it is known.
    given
        Frame of the forces, as the user or the log states it; empty if neither does.
    """

    finger: Finger
    topic: str
    tip_topic: str
    times: FloatArray
    forces: FloatArray
    tips: FloatArray
    turns: bool
    frames: dict[str, FloatArray]
    given: str

    @property
    def has_directions(self) -> bool:
        """Whether forces are vectors."""
        return self.forces.shape[1] == 3

    def touches(self, detection: TouchDetection, frame: str) -> Touches:
        """Return the touches with the forces in a frame of `frames`."""
        R_OF = self.frames[frame]
        turned, known = self.forces.copy(), np.isfinite(R_OF[:, 0, 0])
        if self.has_directions:
            # A rotation that is unknown must not hide a touch.
            turned[known] = np.einsum("tij,tj->ti", R_OF[known], self.forces[known])
        return detect_touches(
            self.times, turned, self.tips, detection, finger=self.finger.name, directed=known
        )


def align(log: RobotLog, finger: Finger, frames: LogFrames) -> AlignedLog:
    """Return the forces and poses of a finger; poses are interpolated at the times of forces.

    Raises `InvalidInputError` if a topic is missing, ambiguous or unrelated to the others.
    """
    topic = choose_topic(log, "force", finger.force, "force")
    measured = log.forces(topic)
    valid = np.all(np.abs(measured.forces) < LARGEST_NUMBER, axis=1)  # False for NaN
    valid &= np.isfinite(measured.times)
    if not valid.any():
        raise InvalidInputError(
            f"the force must have numbers; {topic} has none: choose another by `force`, or record"
            " it again"
        )
    measured = replace(measured, times=measured.times[valid], forces=measured.forces[valid])
    times = measured.times
    base, X_PT, tip = _pose_of(log, finger.tip, frames, times, "tip")
    if frames.object_pose is None:
        fixed = np.eye(4) if frames.object_frame is None else np.array(frames.object_frame)
        X_PO = np.tile(fixed, (len(times), 1, 1))
    else:
        other, X_BO, _ = _pose_of(log, frames.object_pose, None, times, "object_pose", near=base)
        X_PO = _related(log, base, other, times) @ X_BO
    X_OP = inverse_pose(X_PO)
    X_OT = X_OP @ X_PT
    given = frames.force_frame or measured.frame
    R_OF = _named_frame(given, log, base, tip, times, X_OP, X_OT)
    posed = X_PT[np.isfinite(X_PT[:, 0, 0]), :3, :3]
    return AlignedLog(
        finger,
        topic,
        finger.tip or choose_topic(log, "pose", None, "tip", frames.object_pose or ""),
        times,
        _conditioned(measured, frames),
        apply_pose(X_OT, np.asarray(frames.tip_offset, dtype=np.float64)),
        bool(len(posed)) and float(np.ptp(posed, axis=0).max()) > 0.0,
        {
            "tip": X_OT[:, :3, :3],
            "base": X_OP[:, :3, :3],
            **({} if R_OF is None else {given: R_OF}),
        },
        given,
    )


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
    if not others:
        ways = (
            "record one, or give `urdf` and a link of it by `tip`"
            if option == "tip"
            else "record one"
        )
        raise InvalidInputError(
            f"the log must have a topic of content '{content}' for `{option}`; it has"
            f" {known}: {ways}"
        )
    if len(others) != 1:
        raise InvalidInputError(
            f"the log has {len(others)} topics of content '{content}' to choose from"
            f" ({known}): choose one by `{option}`"
        )
    return others[0]


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
    tree = log.frames()
    if "" in (base, other) and not tree.transforms:
        other = base
    if base != other and not base:
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
    if not name:
        return None
    if name in (base, "base") and (name, tip) != ("base", "base"):
        return X_OP[:, :3, :3]
    if name in (tip, "tip"):
        return X_OT[:, :3, :3]
    tree = log.frames()
    if {name, base} <= set(tree.frames):
        return (X_OP @ tree.pose(base, name, times))[:, :3, :3]
    return None


def _conditioned(measured: TimedForces, frames: LogFrames) -> FloatArray:
    """Return the forces without their offset, smoothed."""
    forces = measured.forces.copy()
    if frames.tare > 0.0:
        forces -= forces[measured.times <= measured.times[0] + frames.tare].mean(axis=0)
    step = float(np.median(np.diff(measured.times))) if len(forces) > 1 else 0.0
    if frames.smoothing > step > 0.0:
        forces = uniform_filter1d(forces, round(frames.smoothing / step), axis=0, mode="nearest")
    return forces
