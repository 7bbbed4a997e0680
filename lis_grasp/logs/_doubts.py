"""Comparisons of a log's data with themselves: forces with motions, places with each other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lis_grasp.exceptions import InvalidInputError, note
from lis_grasp.exploration.touch_detection import (
    APPROACH_NOISE,
    FORCE_NOISE,
    TouchDetection,
    Touches,
)
from lis_grasp.io.units import LARGEST
from lis_grasp.logs.readers import RobotLog
from lis_grasp.surfaces.contact_places import SMALLEST
from lis_grasp.typing import FloatArray

_SURE = 3.0  # standard deviations of a mean beyond which a difference is not chance
_FEWEST = 3  # touches to compare


def require_places(places: FloatArray, advice: str) -> None:
    """Raise `InvalidInputError` if touches are all at one place, or farther apart than objects.

    `places` are (N, 3) [m], one of each touch.
    """
    extent = float(np.ptp(places, axis=0).max()) if len(places) > 1 else 1.0
    if extent <= SMALLEST:
        raise InvalidInputError(
            f"all {len(places)} touches are at one place: the poses do not change with time;"
            " check their topic and its times"
        )
    if extent > LARGEST:
        raise InvalidInputError(
            f"contacts must be within {LARGEST:g} m of each other; these are"
            f" {extent:.3g} m apart: {advice}"
        )


def question_force_frame(used: Touches, others: Mapping[str, Touches], *, stated: str) -> None:
    """Compare forces with the motions before the touches, in the frame used and in others.

    Raises `InvalidInputError` if they agree surely better in another frame; a note if the log
    itself states the frame.
    """
    for name, other in others.items():
        known = _directed(used) & _directed(other)
        if known.sum() < _FEWEST:
            continue
        ours, theirs = (_agreement(touches)[known] for touches in (used, other))
        gain = theirs - ours
        chance = _SURE * float(gain.std()) / np.sqrt(len(gain))
        if gain.mean() <= max(chance, FORCE_NOISE**2):
            continue
        angles = [np.degrees(np.median(np.arccos(np.clip(c, -1, 1)))) for c in (theirs, ours)]
        message = (
            f"the forces agree with the motions before the touches better in the frame '{name}'"
            f" (median angle {angles[0]:.0f} deg) than as they are taken ({angles[1]:.0f} deg):"
            f" give `force_frame` {name}, or "
        )
        if stated:
            note(f"{message}{stated} if the log, which states it, is right")
        else:
            raise InvalidInputError(f"{message}the frame that they are in")


def question_directions(touches: Touches, detection: TouchDetection) -> None:
    """Note forces that point across the motions before the touches."""
    known = _directed(touches)
    if known.sum() < _FEWEST:
        return
    cosines = _agreement(touches, detection.force_on)[known]
    angle = float(np.median(np.arccos(np.clip(cosines, -1.0, 1.0))))
    if angle > 2.0 * np.hypot(FORCE_NOISE, APPROACH_NOISE):
        note(
            f"the forces contradict the motions before the touches (median angle"
            f" {np.degrees(angle):.0f} deg): check `force_frame`, `tip_offset`, `tare` and"
            " `force_on`, or take `normals` approach"
        )


def question_object(log: RobotLog, touches: list[Touches]) -> None:
    """Note the poses of an object that moves but is taken as fixed."""
    used = {name for touch in touches for _, name, _ in touch.streams}
    for topic in log.topics:
        if topic.content == "pose" and topic.name not in used and "object" in topic.name.lower():
            positions = log.poses(topic.name).positions
            moved = float(np.ptp(positions, axis=0).max()) if len(positions) else 0.0
            if moved > 0.0:
                note(
                    f"{topic.name} moves by {1e3 * moved:.3g} mm, and the object is taken as fixed:"
                    f" give `object_pose` {topic.name}"
                )


def _directed(touches: Touches) -> np.ndarray:
    return np.any(touches.approach, axis=1) & np.any(touches.directions, axis=1)


def _agreement(touches: Touches, force_on: str | None = None) -> FloatArray:
    """Return cosines of the angle between the approach and the force on the object."""
    cosines = np.sum(touches.approach * touches.directions, axis=1)
    if force_on is None:
        return cosines if cosines.sum() > 0.0 else -cosines
    return cosines if force_on == "object" else -cosines
