"""Checks of query points and options, and evaluation of long queries in blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import FARTHEST, Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError
from lis_grasp.guesses import Answering
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.underflow import methods_underflow

# Smaller blocks cost more by their number than they save.
_SMALL_BLOCK = 256

# Squares of larger coordinates [m] overflow.
_FARTHEST = 1e100

# Numbers of an array that a processor's cache holds, together with a few like it.
_CACHED = 2**16

# Cells along the side of the cube in which points are sorted: 2^10; and each number with
# two zeros after every bit, which is its binary digits read in base 8.
_BITS = 10
_SPREAD = np.array([int(f"{number:b}", base=8) for number in range(1 << _BITS)])

# Points evaluated at once: their number, and the largest size of their box in spacings.
_BLOCK, _BLOCK_EXTENT = 2048, 8.0


class Predicting(Answering):
    """Base of surfaces that are also queried in the words of scikit-learn.

    A subclass is an `ImplicitSurface`, whose protocol has none of this.
    """

    __slots__ = ()

    def __call__(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], as `evaluate` does."""
        return self.evaluate(points)

    @overload
    def predict(self, points: npt.ArrayLike) -> FloatArray: ...
    @overload
    def predict(
        self, points: npt.ArrayLike, return_std: bool
    ) -> FloatArray | tuple[FloatArray, FloatArray]: ...
    def predict(
        self: Any, points: npt.ArrayLike, return_std: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Return f at points of shape (..., 3) [m], and with `return_std` its `uncertainty` too.

        That is one standard deviation of the surface along its normal [m], not of f.
        """
        values = self.evaluate(points)
        return (values, self.uncertainty(points)) if return_std else values

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        raise NotImplementedError


@methods_underflow
class BlockwiseSurface(Predicting):
    """Base of estimators that average over the contacts near a point, block by block of points.

    A subclass has the contacts' `spacing` [m] and `_value_and_gradient`.
    """

    __slots__ = ()
    spacing: float

    def _value_and_gradient(
        self, points: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return f (P,) and its gradient (P, 3) at points close together."""
        raise NotImplementedError

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        return self._map(
            lambda x: self._value_and_gradient(x, with_gradient=False)[0], rows
        ).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the exact gradient of f at points of shape (..., 3) [m], shape (..., 3).

        Where f has a kink, one of its one-sided gradients, or their mean.
        """
        rows, shape = flat_points(points)
        gradients = self._map(
            lambda x: self._value_and_gradient(x, with_gradient=True)[1], rows, (3,)
        )
        return gradients.reshape(*shape, 3)

    def _map(
        self,
        function: Callable[[FloatArray], FloatArray],
        rows: FloatArray,
        width: tuple[int, ...] = (),
    ) -> FloatArray:
        """Apply a row-wise function to compact blocks of rows; return shape (len(rows), *width)."""
        results = np.empty((len(rows), *width))
        for index in compact_blocks(rows, _BLOCK, extent=_BLOCK_EXTENT * self.spacing):
            results[index] = function(rows[index])
        return results


def flat_points(points: npt.ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
    """Return query points as rows, shape (P, 3), and the shape (...) that results go back to."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        message = f"points must have shape (..., 3); they have shape {array.shape}"
        raise InvalidOptionError(message, option="points")
    farthest = np.abs(array).max(initial=0.0)
    if not farthest <= _FARTHEST:  # NaN, too
        message = f"points must be within {_FARTHEST:g} m of the origin; one is at {farthest:g} m"
        raise InvalidOptionError(message, option="points")
    return array.reshape(-1, 3), array.shape[:-1]


def map_rows(
    function: Callable[[FloatArray], FloatArray], rows: FloatArray, columns: int
) -> FloatArray:
    """Apply a row-wise function to blocks of rows whose arrays fit into the cache.

    `columns` is the width of its arrays; the results are joined.
    """
    count = max(1, _CACHED // columns)
    if len(rows) <= count:
        return function(rows)
    return np.concatenate([function(rows[i : i + count]) for i in range(0, len(rows), count)])


def compact_blocks(
    points: FloatArray, count: int, *, extent: float = np.inf
) -> Iterator[IndexArray]:
    """Yield index sets of at most `count` points that are close together (cells of an octree).

    Blocks of more than 256 points are also split until they are no larger than `extent` [m]: the
    cost of a block grows with the number of contacts near it.
    """
    if len(points) <= min(count, _SMALL_BLOCK):
        if len(points):
            yield np.arange(len(points))
        return
    side, codes = _morton_codes(points)
    order = np.argsort(codes)
    codes = codes[order]
    pending = [(0, len(points), 0, 3 * _BITS)]  # rows, the code of their cell, and its free bits
    while pending:
        start, stop, cell, bits = pending.pop()
        size = side * 2.0 ** (-_BITS + -(-bits // 3))
        if stop - start <= _SMALL_BLOCK or (stop - start <= count and size <= extent) or bits == 0:
            for first in range(start, stop, count):
                yield order[first : min(first + count, stop)]
            continue
        upper = cell + (1 << (bits - 1))
        middle = start + int(np.searchsorted(codes[start:stop], upper))
        pending += [(middle, stop, upper, bits - 1), (start, middle, cell, bits - 1)]


def _morton_codes(points: FloatArray) -> tuple[float, npt.NDArray[np.int64]]:
    """Return the side of the points' cube [m], and their places (P,) on the Z-order curve in it."""
    coordinates = np.ascontiguousarray(points.T)
    low = coordinates.min(axis=1, keepdims=True)
    side = float((coordinates.max(axis=1, keepdims=True) - low).max())
    scale = ((1 << _BITS) - 1) / side if side > 0.0 else 0.0
    cells = ((coordinates - low) * scale).astype(np.int64)
    x, y, z = _SPREAD[cells]
    return side, x << 2 | y << 1 | z


def require_contacts(contacts: Contacts) -> None:
    """Refuse an empty set of contacts."""
    if not len(contacts):
        raise InvalidContactsError(
            "a surface needs at least one contact; there are none: touch the object first"
        )


def require_range(name: str, value: float, *, unit: str = "", above_zero: bool = False) -> float:
    """Return a finite option of at least, or above, 0; refuse any other."""
    if not (0.0 <= value <= FARTHEST) or (above_zero and value == 0.0):
        required = f"{'above' if above_zero else 'at least'} 0 and at most {FARTHEST:g} {unit}"
        raise InvalidOptionError.out_of_range(name, value, required.strip())
    return float(value)
