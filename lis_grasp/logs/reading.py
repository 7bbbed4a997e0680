"""Options for what a robot's log does not say: orientations, times, units, topics, frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.touch_detection import TOUCHES
from lis_grasp.io.csv_tables import ANGLES
from lis_grasp.io.option import at_least, option, place, record_of_options
from lis_grasp.logs._column_names import ORIENTATIONS, Orientation

Clock = Literal["header", "recording"]
CLOCKS: tuple[str, ...] = get_args(Clock)

TOPICS = "topics; repeat the first three for several fingers"
PATCHES = "tactile patches (.npz)"
"""Groups of options in the help."""


@record_of_options
class LogReading:
    """Facts that a log does not state about itself."""

    orientation: Orientation | None = option(
        None,
        "what columns of an orientation are, if names do not say it; ignored: no turn",
        TOPICS,
        choices=ORIENTATIONS,
        words="asked for where it matters",
    )
    clock: Clock = option(
        "header", "times of messages: of their headers, or of the recording", TOPICS, choices=CLOCKS
    )
    angles: Literal["rad", "deg"] | None = option(
        None,
        "unit of joints that turn, and of angles whose columns state none",
        TOPICS,
        choices=tuple(ANGLES),
        words="rad, if limits of joints and numbers agree",
    )
    joint_states: tuple[str, ...] | None = option(
        None,
        "topics of joint states that are used",
        TOPICS,
        metavar="NAME",
        words="all, where each joint is on one",
    )


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
