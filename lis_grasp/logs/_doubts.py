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

_SURE = 2.0  # standard deviations of a mean beyond which a difference is not chance
_FEWEST = 3  # touches to compare
_SEEN = 1e-3  # [m] of a mean height beyond errors of poses
_LESS = 0.7  # ratio of misfit and scatter below which places fit better
_EQUAL = 0.02  # fraction of a gain by which two readings are equally good


def require_places(places: FloatArray, advice: str, reach: float = np.inf) -> None:
    """Raise `InvalidInputError` if touches are all at one place, or too far apart.

    `places` are (N, 3) [m], one of each touch. They must be as close as those of an object, and of
    an arm that reaches so far [m].
    """
    extent = float(np.ptp(places, axis=0).max()) if len(places) > 1 else 1.0
    if extent <= SMALLEST:
        raise InvalidInputError(
            f"all {len(places)} touches are at one place: the poses do not change with time;"
            " check their topic and its times"
        )
    if extent > min(LARGEST, 2.0 * reach):
        robot = f", and a robot that reaches {reach:.3g} m" if 2.0 * reach < LARGEST else ""
        raise InvalidInputError(
            f"contacts must be within {min(LARGEST, 2.0 * reach):.3g} m of each other{robot};"
            f" these are {extent:.3g} m apart: {advice}"
        )


def question_answers(
    used: Touches, others: Mapping[str, Touches], *, directed: bool, is_answered: bool
) -> None:
    """Compare the touches with those of other frames of the forces and other orientations.

    `others` has them by the options that give them, those that change least first. Forces, if
    `directed`, are compared with the motions before the touches, places with each other.

    Raises `InvalidInputError` if the forces agree surely better in another frame, and nobody has
    stated theirs; a note if another answer is surely better than a given one.
    """
    better = _better_directions(used, others) if directed else {}
    seen = "forces and the motions before the touches differ by {:.0f} deg (median), not {:.0f} deg"
    if not better:
        better = _better_places(used, others)
        seen = "touches stand before the surfaces that others touch by {:.2g} mm (mean), not {:.2g}"
    if not better:
        return
    best = max(gain for gain, _, _ in better.values())
    advice, (_, theirs, ours) = next(
        item for item in better.items() if item[1][0] >= best - _EQUAL * abs(best)
    )
    if not is_answered and advice.startswith("give `force_frame`"):
        raise InvalidInputError(
            f"the frame of the forces must be known: {advice}, in which "
            f"{seen.format(theirs, ours)}, or the frame that they are in"
        )
    note(
        f"the log contradicts how it is read: {advice}, with which {seen.format(theirs, ours)},"
        " unless it is surely right as it is"
    )


def _better_directions(
    used: Touches, others: Mapping[str, Touches]
) -> dict[str, tuple[float, float, float]]:
    """Return readings whose forces agree better with the motions: gain, and angles [deg]."""
    better = {}
    for advice, other in others.items():
        if len(other.times) != len(used.times):
            continue
        known = _directed(used) & _directed(other)
        if known.sum() < _FEWEST:
            continue
        ours, theirs = (_agreement(touches)[known] for touches in (used, other))
        gain = theirs - ours
        chance = _SURE * float(gain.std()) / np.sqrt(len(gain))
        if gain.mean() > max(chance, FORCE_NOISE**2):
            angles = [np.degrees(np.median(np.arccos(np.clip(c, -1, 1)))) for c in (theirs, ours)]
            better[advice] = float(gain.mean()), float(angles[0]), float(angles[1])
    return better


def _better_places(
    used: Touches, others: Mapping[str, Touches]
) -> dict[str, tuple[float, float, float]]:
    """Return readings whose places contradict each other less: gain, and heights [mm].

    A touch before the surface that another one touched, seen along its approach, is possible on
    concave objects alone, and an offset that is turned wrongly scatters the places.
    """
    better = {}
    own, spread = _misfit(used)
    if own > _SEEN and len(used.times) >= _FEWEST:
        for advice, other in others.items():
            theirs, narrow = _misfit(other)
            same = len(other.times) == len(used.times)
            ratio = theirs * narrow / (own * spread)
            if same and theirs < own and narrow < spread and ratio < _LESS:
                better[advice] = 1.0 - ratio, 1e3 * theirs, 1e3 * own
    return better


def _misfit(touches: Touches) -> tuple[float, float]:
    """Return how far touches stand before the places of others, and their scatter, means [m]."""
    known = np.any(touches.approach, axis=1)
    centers, outward = touches.centers[known], -touches.approach[known]
    if not len(centers):
        return 0.0, 0.0
    heights = np.einsum("nmi,ni->nm", centers[None] - centers[:, None], outward)  # (N, N)
    scatter = np.linalg.norm(centers - centers.mean(axis=0), axis=1)
    return float(np.maximum(heights, 0.0).mean()), float(scatter.mean())


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
