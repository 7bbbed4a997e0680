"""Types of the facts that the header of a results file records."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from lis_grasp.io.schemas import Count, FileRecord, Number, Pose

_Name = Annotated[str, Field(min_length=1)]
_Lengths = Annotated[list[Number], Field(min_length=3, max_length=3)]
# Only types are checked; null is refused where it is no value. A default is not checked; one
# `Field` for all facts would give them one type in pydantic 2.10.
_ABSENT: Any = None


class RecordedFacts(FileRecord):
    """Facts by name; each may be absent. Ranges are checked where a fact is used."""

    version: str | None = _ABSENT
    object: _Name = _ABSENT
    size: Number | None = _ABSENT
    units: str = _ABSENT
    hand: _Name = _ABSENT
    estimator: _Name = _ABSENT
    prober: str = _ABSENT
    fingers: str = _ABSENT
    pose: str | None = _ABSENT
    region: _Lengths | None = _ABSENT
    free: bool = _ABSENT
    policy: _Name = _ABSENT
    until_success: Number | None = _ABSENT
    until_coverage: Number | None = _ABSENT
    until_uncertainty: Number | None = _ABSENT
    max_seconds: Number | None = _ABSENT
    position_noise: Number = _ABSENT
    normal_noise: Number = _ABSENT
    force_threshold: Number = _ABSENT
    taxel_pitch: Number = _ABSENT
    free_space: bool = _ABSENT
    cloud: str | None = _ABSENT
    touches: Count = _ABSENT
    seed: Count = _ABSENT
    mass: Number | None = _ABSENT
    friction: Number = _ABSENT
    load: str = _ABSENT
    simulator: str = _ABSENT
    arm: str | None = _ABSENT
    base: _Lengths | None = _ABSENT
    grasps: Count = _ABSENT
    attempts: Count = _ABSENT
    support_height: Number = _ABSENT
    X_WO: Pose | None = _ABSENT
    X_EO: Pose | None = _ABSENT
    X_EA: Pose | None = _ABSENT
    X_FB: Pose | None = _ABSENT
