"""Radial covariance functions, with the derivatives that gradient observations need.

A radial kernel k(r) of the offset d = u - v, r = |d|, needs two more functions of r for the
covariances with partial derivatives (Rasmussen and Williams 2006, section 9.4):

    first(r)  = -k'(r) / r                      cov(f(u), grad f(v))      = first d
    second(r) = (k''(r) - k'(r) / r) / r^2      cov(grad f(u), grad f(v)) = first I - second d d^T

Both are finite at r = 0 for the kernels here, or nearly: the second of the thin plate grows like
1/r, and is multiplied by d d^T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.typing import FloatArray


class RadialKernel:
    """Base of covariances that depend on distance only; distances of any shape in, that shape out.

    A subclass has `value_and_first` and `second`.
    """

    __slots__ = ()

    def value(self, r: FloatArray) -> FloatArray:
        """Return k(r)."""
        return self.value_and_first(r)[0]

    def first(self, r: FloatArray) -> FloatArray:
        """Return -k'(r) / r."""
        return self.value_and_first(r)[1]

    def value_and_first(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return k(r) and -k'(r) / r, in less time than one by one."""
        raise NotImplementedError

    def second(self, r: FloatArray) -> FloatArray:
        """Return (k''(r) - k'(r) / r) / r^2."""
        raise NotImplementedError

    def combined(self, squares: FloatArray, values: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return values k(r) - slopes k'(r) / r from squares of r; the arguments are overwritten.

        `squares` and `slopes` have the result's shape (N, P), `values` (N, 1).
        """
        value, first = self.value_and_first(np.sqrt(squares, out=squares))
        slopes *= first
        slopes += values * value
        return slopes


@dataclass(frozen=True, slots=True)
class SquaredExponential(RadialKernel):
    """exp(-r^2 / (2 length^2)): Ottenhaus et al. 2016, eq. 6 (whose sigma is this length)."""

    length: float

    def value_and_first(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return k(r) and -k'(r) / r."""
        value = np.exp(-0.5 * (r / self.length) ** 2)
        return value, value / self.length**2

    def second(self, r: FloatArray) -> FloatArray:
        """Return (k''(r) - k'(r) / r) / r^2."""
        return self.value(r) / self.length**4


@dataclass(frozen=True, slots=True)
class Matern52(RadialKernel):
    """(1 + q + q^2 / 3) exp(-q), q = sqrt(5) r / length: Rasmussen and Williams 2006, eq. 4.17."""

    length: float

    def _scaled(self, r: FloatArray) -> FloatArray:
        return np.sqrt(5.0) * r / self.length

    def value_and_first(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return k(r) and -k'(r) / r."""
        q = self._scaled(r)
        decay = np.exp(-q)
        linear = (1.0 + q) * decay
        q *= q
        q *= decay
        q /= 3.0
        q += linear
        linear *= 5.0 / (3.0 * self.length**2)
        return q, linear

    def combined(self, squares: FloatArray, values: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return values k(r) - slopes k'(r) / r; squares and slopes are overwritten."""
        # exp(-q) ((1 + q) (values + 5 / (3 length^2) slopes) + q^2 / 3 values)
        squares *= 5.0 / self.length**2
        slopes *= 5.0 / (3.0 * self.length**2)
        slopes += values
        q = np.sqrt(squares)
        squares *= values / 3.0
        squares += slopes
        slopes *= q
        squares += slopes
        np.negative(q, out=q)
        squares *= np.exp(q, out=q)
        return squares

    def second(self, r: FloatArray) -> FloatArray:
        """Return (k''(r) - k'(r) / r) / r^2."""
        return 25.0 / (3.0 * self.length**4) * np.exp(-self._scaled(r))


@dataclass(frozen=True, slots=True)
class Matern72(RadialKernel):
    """(1 + q + 2 q^2 / 5 + q^3 / 15) exp(-q), q = sqrt(7) r / length: eq. 4.14 there, nu = 7/2."""

    length: float

    def value_and_first(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return k(r) and -k'(r) / r."""
        q = np.sqrt(7.0) * r / self.length
        decay = np.exp(-q)
        first = (1.0 + q + q * q / 3.0) * decay  # times 5 length^2 / 7
        return first + q * q * (1.0 + q) / 15.0 * decay, 7.0 / (5.0 * self.length**2) * first

    def combined(self, squares: FloatArray, values: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return values k(r) - slopes k'(r) / r; squares and slopes are overwritten."""
        # exp(-q) ((1 + q + q^2 / 3) (values + 7 / (5 length^2) slopes) + (1 + q) q^2 / 15 values)
        squares *= 7.0 / self.length**2
        slopes *= 7.0 / (5.0 * self.length**2)
        slopes += values
        q = np.sqrt(squares)
        total = squares * (values / 15.0)
        total += slopes
        total *= 1.0 + q
        squares *= slopes
        squares /= 3.0
        total += squares
        np.negative(q, out=q)
        total *= np.exp(q, out=q)
        return total

    def second(self, r: FloatArray) -> FloatArray:
        """Return (k''(r) - k'(r) / r) / r^2."""
        q = np.sqrt(7.0) * r / self.length
        return 49.0 / (15.0 * self.length**4) * (1.0 + q) * np.exp(-q)


@dataclass(frozen=True, slots=True)
class ThinPlate(RadialKernel):
    """(2 r^3 - 3 R r^2 + R^3) / R^3: Williams and Fitzgibbon 2007; a covariance for r up to R.

    Eq. 2 of Ottenhaus et al. 2016 has other signs and powers, which grow with distance and are no
    covariance. R (`length`) must exceed the largest distance between any two points, by about a
    third with gradient observations. Divided by R^3, so that k(0) = 1 as for other kernels: this
    changes nothing but the unit of noise.
    """

    length: float

    def value_and_first(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return k(r) and -k'(r) / r."""
        q = r / self.length
        return 2.0 * q**3 - 3.0 * q**2 + 1.0, 6.0 * (1.0 - q) / self.length**2

    def second(self, r: FloatArray) -> FloatArray:
        """Return (k''(r) - k'(r) / r) / r^2."""
        # Floored: at r = 0 it is multiplied by d d^T = 0, to which rounding adds some 1e-16.
        return 6.0 / (self.length**3 * np.maximum(r, 1e-8 * self.length))


SMOOTH = Matern52(0.8)
"""Covariance of `gpis`, in largest distances between two contacts."""

MISFIT = (0.001, 0.1)
"""Noise of `gpis` for edges that no smooth f can follow, of values and slopes."""
