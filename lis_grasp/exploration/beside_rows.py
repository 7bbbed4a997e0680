"""Rows of a touch log about known bodies: their contacts, and probes that no finger reaches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import Field

from lis_grasp.exploration.neighbours import BodyTouch
from lis_grasp.exploration.observations import Observation
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.io.schemas import FileRecord, Number, Vector


class BodyTouchEntry(FileRecord):
    """A `BodyTouch`."""

    body: str
    point: Vector
    normal: Vector

    def touch(self) -> BodyTouch:
        """Return the record."""
        return BodyTouch(self.body, np.array(self.point), np.array(self.normal))


class RefusedEntry(FileRecord):
    """A probe that was refused."""

    target: Vector
    direction: Vector
    standoff: Number
    overshoot: Number
    reason: str
    slides: list[Vector] = Field(default_factory=list)

    def outcome(self) -> ProbeOutcome:
        """Return the record."""
        motion = np.array(self.target), np.array(self.direction), self.standoff, self.overshoot
        probe = Probe(*motion, np.array(self.slides).reshape(-1, 3))
        return ProbeOutcome(probe, "blocked", reason=self.reason)


def beside_rows(observation: Observation) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of an observation about known bodies; empty without any."""
    touches = [
        {"body": one.body, "point": one.point.tolist(), "normal": one.normal.tolist()}
        for one in observation.beside
    ]
    refused = [_refused_row(outcome) for outcome in observation.refused]
    return {name: rows for name, rows in (("beside", touches), ("refused", refused)) if rows}


def with_rows(
    observation: Observation, beside: Sequence[BodyTouchEntry], refused: Sequence[RefusedEntry]
) -> Observation:
    """Return an observation with what its rows say about known bodies."""
    return Observation(
        observation.outcome,
        observation.belief,
        observation.dropped,
        tuple(entry.touch() for entry in beside),
        tuple(entry.outcome() for entry in refused),
    )


def _refused_row(outcome: ProbeOutcome) -> dict[str, Any]:
    probe = outcome.probe
    row = {"target": probe.target.tolist(), "direction": probe.direction.tolist()}
    row |= {"standoff": probe.standoff, "overshoot": probe.overshoot, "reason": outcome.reason}
    return row | ({"slides": probe.slides.tolist()} if len(probe.slides) else {})
