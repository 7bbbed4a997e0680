"""Streams of a robot's log: topics, and forces over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from lis_grasp.typing import FloatArray

Content = Literal["force", "pose", "transforms", "other"]


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a log: its name, type, number of messages, and what it contains."""

    name: str
    type: str
    messages: int
    content: Content


@dataclass(frozen=True, slots=True, eq=False)
class TimedForces:
    """Forces over time.

    Attributes
    ----------
    times
        Shape (T,) [s], not decreasing.
    forces
        Shape (T, 3) [N], or (T, 1) where only the magnitude is known.
    frame
        Name of the frame in which vectors are given; empty if unknown.
    """

    times: FloatArray
    forces: FloatArray
    frame: str = ""
