"""Checks of query points and options, and the cutting of long queries into bounded pieces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import FARTHEST, Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError
from lis_grasp.typing import FloatArray, IndexArray

# Smaller blocks cost more by their number than they save.
_SMALL_BLOCK = 256

# Squares of larger coordinates [m] are no numbers any more.
_FARTHEST = 1e100


def flat_points(points: npt.ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
    """Return query points as rows, shape (P, 3), and the shape (...) that results go back to."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise InvalidOptionError(f"points must have shape (..., 3); they have shape {array.shape}")
    if not np.isfinite(array).all():
        raise InvalidOptionError(
            "points must be finite; at least one coordinate is NaN or infinite"
        )
    if np.abs(array).max(initial=0.0) > _FARTHEST:
        raise InvalidOptionError(
            f"points must be within {_FARTHEST:g} m of the origin; the farthest coordinate is"
            f" {np.abs(array).max():g} m"
        )
    return array.reshape(-1, 3), array.shape[:-1]


def map_rows(
    function: Callable[[FloatArray], FloatArray], rows: FloatArray, count: int
) -> FloatArray:
    """Apply a row-wise function to at most `count` rows at a time and join the results."""
    if len(rows) <= count:
        return function(rows)
    return np.concatenate([function(rows[i : i + count]) for i in range(0, len(rows), count)])


def compact_blocks(
    points: FloatArray, count: int, *, extent: float = np.inf
) -> Iterator[IndexArray]:
    """Yield index sets of at most `count` points that lie close together (recursive bisection).

    Blocks of more than 256 points are also split until they are no larger than `extent` [m]: what
    a block costs grows with the contacts that it sees.
    """
    pending = [np.arange(len(points))]
    while pending:
        index = pending.pop()
        chosen = points[index]
        spans = np.ptp(chosen, axis=0) if len(index) > _SMALL_BLOCK else np.zeros(3)
        axis = int(np.argmax(spans))
        if len(index) <= count and spans[axis] <= extent:
            if len(index):
                yield index
            continue
        half = len(index) // 2
        order = np.argpartition(chosen[:, axis], half)
        pending += [index[order[half:]], index[order[:half]]]


def map_blocks(
    function: Callable[[FloatArray], FloatArray],
    rows: FloatArray,
    count: int,
    extent: float,
    width: tuple[int, ...] = (),
) -> FloatArray:
    """Apply a row-wise function to the points of one compact block after the other.

    Returns what it gives for all rows, in their order, shape (len(rows), *width).
    """
    results = np.empty((len(rows), *width))
    for index in compact_blocks(rows, count, extent=extent):
        results[index] = function(rows[index])
    return results


def require_contacts(contacts: Contacts) -> None:
    """Refuse an empty set of contacts."""
    if not len(contacts):
        raise InvalidContactsError(
            "a surface needs at least one contact; there are none: touch the object first"
        )


def require_range(
    name: str,
    value: float,
    low: float,
    high: float = FARTHEST,
    *,
    unit: str = "",
    low_included: bool = True,
) -> float:
    """Return an option that lies in its range, refuse any other."""
    inside = low <= value if low_included else low < value
    if not (inside and value <= high and np.isfinite(value)):
        least = f"{'at least' if low_included else 'above'} {low:g}"
        most = f" and at most {high:g}"
        raise InvalidOptionError(
            f"{name} must be {least}{most}{unit and ' ' + unit}; {value!r} came"
        )
    return float(value)


def require_choice(name: str, value: str, choices: Sequence[str]) -> str:
    """Return an option that is one of its choices, refuse any other."""
    if value not in choices:
        raise InvalidOptionError(f"{name} must be one of {', '.join(choices)}; {value!r} came")
    return value
