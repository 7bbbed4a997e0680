"""Detection of touches in forces and poses over time, and the contacts that they give."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.option import (
    FRACTION,
    POSITIVE,
    at_least,
    option,
    record_of_options,
)
from lis_grasp.surfaces import estimate_normals
from lis_grasp.typing import BoolArray, FloatArray

NormalSource = Literal["estimate", "force", "approach"]
NORMAL_SOURCES: tuple[str, ...] = get_args(NormalSource)
ForceOn = Literal["tip", "object"]
FORCES_ON: tuple[str, ...] = get_args(ForceOn)
TOUCHES = "touches"
"""Group of the options in the help."""

# Standard deviations of each component of a normal [rad]: of the inward direction of a force in a
# friction cone with coefficient 0.5, and of an approach with the cosine law (a mean square sine of
# a half in two components).
FORCE_NOISE, APPROACH_NOISE = 0.25, 0.5

# The approach is the motion over this last length before contact [m]; it is unknown on a path
# shorter than a fifth of it.
_APPROACH = 0.005
# Recorded free tips are this far apart, and between these distances from contacts [m].
_FREE_STEP, _FREE_FROM, _FREE_TO = 0.005, 0.005, 0.05


@record_of_options
class TouchDetection:
    """Options that decide when a fingertip touches, and where the surface is."""

    threshold: float = option(
        1.0, "force at which a touch begins", TOUCHES, metavar="NEWTONS", check=POSITIVE
    )
    release: float = option(
        0.5,
        "fraction of the threshold at which it ends",
        TOUCHES,
        metavar="FRACTION",
        check=FRACTION,
    )
    tip_radius: float = option(
        0.0, "radius of the spherical tip", TOUCHES, metavar="METRES", check=at_least(0)
    )
    spacing: float | None = option(
        None,
        "another contact whenever a touch has slid so far",
        TOUCHES,
        metavar="METRES",
        words="one for each touch",
        check=POSITIVE,
    )
    normals: NormalSource = option(
        "estimate",
        "estimated from all contacts with force or approach as evidence, or one of these alone",
        TOUCHES,
        choices=NORMAL_SOURCES,
    )
    force_on: ForceOn | None = option(
        None,
        "on what the reported force acts",
        TOUCHES,
        choices=FORCES_ON,
        words="what agrees with the approach",
    )


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """Touches of one finger. `detect_touches` makes them; all are in the object frame O."""

    finger: str
    centers: FloatArray  # (N, 3) [m], of the tip
    times: FloatArray  # (N,) [s]
    forces: FloatArray  # (N,) [N], magnitudes
    approach: FloatArray  # (N, 3) unit, direction of the tip's motion; 0 where unknown
    directions: FloatArray  # (N, 3) unit, of the measured force; 0 where unknown
    free: FloatArray  # (K, 3) [m], centres of the tip without contact
    unposed: int  # touches whose pose is unknown
    streams: tuple[tuple[str, str, str], ...] = ()  # role, topic or frame, use


def detect_touches(
    times: FloatArray,
    forces: FloatArray,
    tips: FloatArray,
    detection: TouchDetection,
    *,
    finger: str = "",
    directed: BoolArray | None = None,
) -> Touches:
    """Find the touches of one finger.

    A touch begins when the force reaches the threshold, and ends when it falls below the release
    fraction of it. A log that begins in contact gives no touch before the first release.

    Parameters
    ----------
    times
        Shape (T,) [s], of the samples, not decreasing.
    forces
        Shape (T, 3) [N] in O, or magnitudes (T, 1).
    tips
        Shape (T, 3) [m], the tip's centre in O; NaN where unknown.
    detection
        Thresholds and the tip.
    finger
        Its name.
    directed
        Shape (T,): whether the direction of the force in O is known; None for all.
    """
    magnitudes = np.linalg.norm(forces, axis=1)
    off = detection.release * detection.threshold
    intervals = _intervals(magnitudes, detection.threshold, off)
    posed = np.all(np.isfinite(tips), axis=1)
    rows: list[int] = []
    approach: list[FloatArray] = []
    unposed = 0
    released = 0
    for begin, end in intervals:
        if not posed[begin]:
            unposed += 1
        else:
            rows.append(begin)
            approach.append(_approach(tips[released : begin + 1]))
            for row in _slides(tips[begin:end], detection.spacing):
                rows.append(begin + row)
                approach.append(np.zeros(3))
        released = end
    directions = np.zeros((len(rows), 3))
    if forces.shape[1] == 3:
        directions = forces[rows] / np.maximum(magnitudes[rows], 1e-300)[:, None]
        if directed is not None:
            directions[~directed[rows]] = 0.0
    centers = tips[rows].reshape(-1, 3)
    return Touches(
        finger=finger,
        centers=centers,
        times=times[rows],
        forces=magnitudes[rows],
        approach=np.array(approach).reshape(-1, 3),
        directions=directions,
        free=_free(tips[(magnitudes < off) & posed], centers),
        unposed=unposed,
    )


def contacts_of_touches(fingers: list[Touches], detection: TouchDetection) -> Contacts:
    """Return the contacts of all fingers, in time order, in the object frame O.

    Raises `InvalidOptionError` if normals are to come from forces without directions, and
    `InvalidContactsError`, `EstimationError` if normals cannot be estimated, see
    `estimate_normals`.
    """
    order = np.argsort(np.concatenate([touch.times for touch in fingers]), kind="stable")
    joined = {
        name: np.concatenate([getattr(touch, name) for touch in fingers])[order]
        for name in ("centers", "times", "forces", "approach", "directions")
    }
    inward = detection.force_on == "object"
    if detection.force_on is None:
        inward = bool(np.sum(joined["directions"] * joined["approach"]) > 0.0)
    outward = -joined["directions"] if inward else joined["directions"]
    radius = detection.tip_radius
    free = np.vstack([touch.free for touch in fingers])
    has_force = np.any(outward, axis=1)
    if detection.normals == "force" and not np.any(has_force):
        raise InvalidOptionError(
            "normals from forces need the three components of each force; the log has magnitudes:"
            " take the normals from the approach, or estimate them",
            option="normals",
            value=detection.normals,
        )
    if detection.normals == "estimate":
        contacts = estimate_normals(
            joined["centers"],
            approach=-outward if has_force.any() else joined["approach"],
            approach_noise=FORCE_NOISE if has_force.any() else None,
            free_points=free,
            free_radii=np.full(len(free), radius),
            fingertip_radius=radius,
        )
        kept: BoolArray = np.ones(len(order), dtype=np.bool_)
    else:
        normals = outward if detection.normals == "force" else -joined["approach"]
        kept = np.any(normals, axis=1)
        noise = FORCE_NOISE if detection.normals == "force" else APPROACH_NOISE
        contacts = Contacts(
            joined["centers"] - radius * normals,
            np.where(kept[:, None], normals, [0.0, 0.0, 1.0]),
            free_points=free,
            free_radii=np.full(len(free), radius),
            normal_noise=np.full(len(order), noise),
        )
    names = [touch.finger for touch in fingers for _ in touch.times]
    return replace(
        contacts,
        forces=joined["forces"],
        times=joined["times"],
        fingers=tuple(names[i] for i in order) if any(names) else (),
    ).subset(kept)


def _intervals(magnitudes: FloatArray, on: float, off: float) -> list[tuple[int, int]]:
    """Return first and past-the-last sample of each touch that begins within the samples."""
    intervals = []
    begin: int | None = None
    armed = False  # below the release at least once: else the log begins in contact
    for row, force in enumerate(magnitudes):
        if begin is None:
            if force < off:
                armed = True
            elif force >= on and armed:
                begin, armed = row, False
        elif force < off:
            intervals.append((begin, row))
            begin, armed = None, True
    if begin is not None:
        intervals.append((begin, len(magnitudes)))
    return intervals


def _approach(path: FloatArray) -> FloatArray:
    """Return the unit direction of the last motion along a path (P, 3) to its end; 0 if unknown."""
    offsets = path[-1] - path
    distances = np.nan_to_num(np.linalg.norm(offsets, axis=1))
    far = np.flatnonzero(distances >= _APPROACH)
    row = int(far[-1]) if len(far) else int(np.argmax(distances))
    if distances[row] < 0.2 * _APPROACH:
        return np.zeros(3)
    return np.asarray(offsets[row] / distances[row])


def _slides(path: FloatArray, spacing: float | None) -> list[int]:
    """Return samples at which the tip has moved by another spacing along the surface."""
    rows: list[int] = []
    last = path[0]
    for row in range(1, len(path) if spacing is not None else 0):
        if np.linalg.norm(path[row] - last) >= (spacing or 0.0):  # False for NaN
            rows.append(row)
            last = path[row]
    return rows


def _free(path: FloatArray, centers: FloatArray) -> FloatArray:
    """Return tips without contact, thinned, at a distance from all contacts, shape (K, 3)."""
    if not len(centers) or not len(path):
        return np.empty((0, 3))
    distances, _ = cKDTree(centers).query(path)
    path = path[(distances >= _FREE_FROM) & (distances <= _FREE_TO)]
    _, first = np.unique(np.round(path / _FREE_STEP), axis=0, return_index=True)
    kept: BoolArray = np.zeros(len(path), dtype=np.bool_)
    kept[first] = True
    return path[kept]
