"""Types of the values in a line of a touch log."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from lis_grasp.exploration.probe import ProbeStatus
from lis_grasp.io.schemas import FileRecord, Number, Pose, Vector


class BeliefEntry(FileRecord):
    """A `PoseBelief`."""

    X_WE: Pose
    means: list[Vector]
    covariances: list[Annotated[list[Vector], Field(min_length=3, max_length=3)]]
    log_weights: list[Number]
    doubts: int
    repeated: bool
    suspicious: bool
    lost: bool


class TouchEntry(FileRecord):
    """A `ProbeOutcome`. Logs of older versions have neither poses nor radii."""

    target: Vector
    direction: Vector
    standoff: Number
    overshoot: Number
    status: ProbeStatus
    reason: str
    duration: Number
    moved: Number
    points: list[Vector]
    normals: list[Vector]
    forces: list[Number] | None
    fingers: list[str]
    times: list[Number] | None
    position_noise: list[Number | None] | None = None
    normal_noise: list[Number | None] | None = None
    free_points: list[Vector]
    free_radii: list[Number] = Field(default_factory=list)
    X_OH: Pose | None = None
    joint_positions: list[Number] | None = None
    simulated_pose: Pose | None = None
    tracked_pose: BeliefEntry | None = None
