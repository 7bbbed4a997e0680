"""Types of the facts that the header of a results file records."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from lis_grasp.io.schemas import Count, FileRecord, Number, Pose

_Name = Annotated[str, Field(min_length=1)]
_Lengths = Annotated[list[Number], Field(min_length=3, max_length=3)]


class RecordedFacts(FileRecord):
    """Facts by name; each may be absent. Ranges are checked where a fact is used."""

    version: str | None = None
    object: _Name = "box"
    size: Number | None = None
    units: str = "m"
    hand: _Name = "allegro"
    estimator: _Name = "blend"
    prober: str = "dynamic"
    fingers: str = "one"
    pose: str | None = None
    region: _Lengths | None = None
    free: bool = False
    policy: _Name = "spread"
    until_success: Number | None = None
    until_coverage: Number | None = None
    until_uncertainty: Number | None = None
    max_seconds: Number | None = None
    position_noise: Number = 0.0
    normal_noise: Number = 0.0
    force_threshold: Number = 0.0
    taxel_pitch: Number = 0.0
    free_space: bool = True
    cloud: str | None = None
    touches: Count = 0
    seed: Count = 0
    mass: Number | None = None
    friction: Number = 0.8
    load: str = "known"
    simulator: str = "drake"
    arm: str | None = None
    base: _Lengths | None = None
    grasps: Count = 1
    attempts: Count = 1
    support_height: Number = 0.0
    X_WO: Pose | None = None
    X_EO: Pose | None = None
    X_EA: Pose | None = None
    X_FB: Pose | None = None
