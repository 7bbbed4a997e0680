"""Options for what a robot's log does not say: orientations, times, units, topics."""

from __future__ import annotations

from typing import Literal, get_args

from lis_grasp.io.csv_tables import ANGLES
from lis_grasp.io.option import option, record_of_options
from lis_grasp.logs._columns import ORIENTATIONS, Orientation

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
        "unit of the positions of joints that turn",
        TOPICS,
        choices=tuple(ANGLES),
        words="rad, compared with the limits of the joints",
    )
    joint_states: tuple[str, ...] | None = option(
        None,
        "topics of joint states that are used",
        TOPICS,
        metavar="NAME",
        words="all, where each joint is on one",
    )
