"""Touches in a robot's log, and what of the log they are made of."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    InvalidInputError,
    InvalidOptionError,
    LisGraspWarning,
    listed,
)
from lis_grasp.exploration.touch_detection import TouchDetection, Touches, contacts_of_touches
from lis_grasp.logs._aligned import AlignedLog, align
from lis_grasp.logs._doubts import (
    question_answers,
    question_directions,
    question_object,
    require_places,
)
from lis_grasp.logs._streams import LONGEST_GAP
from lis_grasp.logs.readers import RobotLog
from lis_grasp.logs.reading import Finger, LogFrames

__all__ = ["Finger", "LogAccount", "LogFrames", "account_of", "contacts_from_log"]


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
    moves = frames.object_pose is not None
    reach = np.inf if moves else log.reach + float(np.linalg.norm(frames.tip_offset))
    require_places(centers, log.unit_advice, reach)
    if not moves:
        question_object(log, touches)
    return contacts, touches


def _slow_topics(log: RobotLog) -> str:
    """Return which topics of poses and frames are too slow to be interpolated; empty for none."""
    timed = {topic.name: log.poses(topic.name) for topic in log.topics if topic.content == "pose"}
    timed |= {f"the frame {ends[1]}": poses for ends, poses in log.frames().transforms.items()}
    steps = {n: float(np.median(np.diff(p.times))) for n, p in timed.items() if len(p.times) > 1}
    slow = [f"{n} has a pose every {s:.2g} s" for n, s in steps.items() if s > LONGEST_GAP]
    return f"; one every {LONGEST_GAP:g} s is needed: {', '.join(slow)}" if slow else ""


def _touches(
    log: RobotLog, finger: Finger, frames: LogFrames, detection: TouchDetection
) -> Touches:
    aligned = align(log, finger, frames)
    is_known = aligned.given in aligned.frames
    if frames.force_frame and not is_known:
        raise InvalidOptionError(
            f"force_frame must be tip, base, or a frame of the log; it is '{frames.force_frame}'",
            option="force_frame",
            value=frames.force_frame,
        )
    frame = aligned.given if is_known else "tip"
    used = aligned.touches(detection, frame)
    directed = aligned.has_directions and detection.normals != "approach"
    others = _other_answers(log, aligned, frames, detection, frame)
    question_answers(used, others, directed=directed, is_answered=is_known)
    if directed:
        question_directions(used, detection)
    taken = f"in the frame {frame}" if is_known else "taken in the tip's frame"
    streams = (
        ("force", aligned.topic, taken if aligned.has_directions else "magnitudes"),
        ("tip", aligned.tip_topic, "" if aligned.turns else "never turned"),
        *(() if frames.object_pose is None else (("object", frames.object_pose, ""),)),
    )
    return replace(used, streams=streams)


def _other_answers(
    log: RobotLog, aligned: AlignedLog, frames: LogFrames, detection: TouchDetection, frame: str
) -> dict[str, Touches]:
    """Return the touches with other frames of the forces and other orientations, by their options.

    Those that change least come first.
    """
    logs = {"": aligned}
    if aligned.tip_topic in {topic.name for topic in log.topics}:
        with warnings.catch_warnings():  # they were said of the log as it was read
            warnings.simplefilter("ignore", LisGraspWarning)
            others = log.other_readings().items()
            logs |= {advice: align(other, aligned.finger, frames) for advice, other in others}
    names = dict.fromkeys((frame, "tip", "base") if aligned.has_directions else (frame,))
    found = {}
    for advice, each in logs.items():
        for name in names:
            words = [advice] if advice else []
            words += [] if name == frame else [f"give `force_frame` {name}"]
            if words:
                found[" and ".join(words)] = each.touches(detection, name)
    return found


@dataclass(frozen=True, slots=True)
class LogAccount:
    """The used and the unused parts of a log.

    Attributes
    ----------
    used
        The topics or frames of forces, tips and the object, each with its use.
    unused
        Topics and columns that no contact depends on.
    """

    used: tuple[str, ...]
    unused: tuple[str, ...]

    def __str__(self) -> str:
        """Return one line."""
        rest = f"; not used: {listed(self.unused)}" if self.unused else ""
        return f"used: {'; '.join(self.used)}{rest}"


def account_of(log: RobotLog, used: Iterable[tuple[str, str, str]]) -> LogAccount:
    """Return the account of a log.

    Parameters
    ----------
    log
        The log.
    used
        Role, topic or frame, and use of each stream.
    """
    streams = list(dict.fromkeys(used))
    kinds = {topic.name: topic.type for topic in log.topics}
    lines = []
    for role, name, taken in streams:
        kind = f" ({kinds[name]})" if name in kinds else " (a frame)"
        lines.append(f"{role} {name}{kind}{f', {taken}' if taken else ''}")
    names = {name for _, name, _ in streams}
    if not names <= kinds.keys():
        sources = log.frames().sources
        lines.append(f"frames of {', '.join(sources)}")
        names |= set(sources)
    unused = (*(topic.name for topic in log.topics), *log.unused)
    return LogAccount(tuple(lines), tuple(name for name in unused if name not in names))
