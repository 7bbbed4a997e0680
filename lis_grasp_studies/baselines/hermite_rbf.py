"""Hermite RBF implicit surface: exact interpolation of values and gradients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, solve

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.queries import flat_points, map_rows
from lis_grasp.typing import FloatArray
from lis_grasp_studies.baselines._support import BaselineSurface, Support

# Numbers held at once by an evaluation.
_CHUNK = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class HermiteRBFSurface(BaselineSurface):
    """The smoothest function that is 0 with the normal as gradient at every contact.

    f(x) = sum_j a_j phi(x - c_j) - b_j . grad phi(x - c_j) + p(x),   phi = r^3, p linear

    with coefficients that make f(c_i) = 0 and grad f(c_i) = n_i, and are orthogonal to linear
    functions (Wendland 2005, chapter 16; Macedo, Gois and Velho 2011). It interpolates unless it is
    given a smoothing or noise. Near contacts f is about metric [m].
    """

    error: ClassVar[float] = 0.16
    support: Support
    _nodes: FloatArray  # (N, 3)
    _values: FloatArray  # (N,) a
    _slopes: FloatArray  # (N, 3) b
    _linear: FloatArray  # (4,) p

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        smoothing: tuple[float, float] = (0.0, 0.0),
        position_noise: float = 0.0,
        normal_noise: float = 0.0,
    ) -> HermiteRBFSurface:
        """Interpolate at least one contact; EstimationError if the equations are singular.

        Parameters
        ----------
        contacts
            Measured on the object; duplicates are merged first.
        smoothing
            Deviations of values (in extents of the contacts) and of normals [rad] that are
            permitted without noise, for regularisation.
        position_noise, normal_noise
            Standard deviations of positions [m] and normals [rad]. The squares of both kinds of
            deviation are added to the diagonal, as those of a Gaussian process with this kernel.
        """
        support = Support.of(contacts)
        points, normals = support.contacts.points, support.contacts.normals
        nodes = support.scaled(points)
        count = len(nodes)
        size = 4 * count
        matrix = np.zeros((size + 4, size + 4))
        matrix[:size, :size] = _interactions(nodes, nodes).reshape(size, size)
        values = smoothing[0] ** 2 + (position_noise / support.scale) ** 2
        slopes = smoothing[1] ** 2 + normal_noise**2
        matrix[np.arange(size), np.arange(size)] += np.tile([values, *[slopes] * 3], count)
        linear = _linear_rows(nodes).reshape(size, 4)
        matrix[:size, size:], matrix[size:, :size] = linear, linear.T
        if count < 4:  # too few contacts to determine the linear part: take the smallest
            matrix[size:, size:] = -1e-9 * np.eye(4)
        wanted = np.zeros(size + 4)
        wanted[:size] = np.column_stack([np.zeros(count), normals]).ravel()
        try:
            solution = solve(matrix, wanted, assume_a="sym")
        except LinAlgError as error:
            raise EstimationError(
                f"the interpolation's equations are singular ({error}): remove contacts at the"
                " same place with different normals"
            ) from None
        coefficients = solution[:size].reshape(count, 4)
        return cls(support, nodes, coefficients[:, 0], coefficients[:, 1:], solution[size:])

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = flat_points(points)
        return self.support.scale * self._value_and_gradient(rows)[:, 0].reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = flat_points(points)
        return self._value_and_gradient(rows)[:, 1:].reshape(*shape, 3)

    def _value_and_gradient(self, rows: FloatArray) -> FloatArray:
        """Return f and its gradient, scaled, at rows (P, 3) [m], shape (P, 4)."""
        scaled = self.support.scaled(rows)
        return map_rows(self._interpolate, scaled, max(1, _CHUNK // (16 * len(self._nodes))))

    def _interpolate(self, queries: FloatArray) -> FloatArray:
        coefficients = np.column_stack([self._values, self._slopes])
        answers = np.einsum("pinj,nj->pi", _interactions(queries, self._nodes), coefficients)
        return np.asarray(answers + _linear_rows(queries) @ self._linear)


def _interactions(queries: FloatArray, nodes: FloatArray) -> FloatArray:
    """Return the kernel blocks (P, 4, N, 4) from value and slopes of nodes to those of queries.

    With phi = r^3: grad phi = 3 r d, its derivative 3 (r I + d d^T / r).
    """
    d = queries[:, None] - nodes  # (P, N, 3)
    r = np.linalg.norm(d, axis=2)
    blocks = np.empty((len(queries), 4, len(nodes), 4))
    blocks[:, 0, :, 0] = r**3
    slopes = 3.0 * r[:, :, None] * d
    blocks[:, 0, :, 1:] = -slopes
    blocks[:, 1:, :, 0] = np.moveaxis(slopes, 2, 1)
    outer = d[:, :, :, None] * d[:, :, None] / np.where(r > 0.0, r, 1.0)[:, :, None, None]
    bends = 3.0 * (r[:, :, None, None] * np.eye(3) + outer)
    blocks[:, 1:, :, 1:] = -np.moveaxis(bends, 2, 1)
    return blocks


def _linear_rows(points: FloatArray) -> FloatArray:
    """Return the matrices from a linear function's coefficients to value and slopes, (P, 4, 4)."""
    rows = np.zeros((len(points), 4, 4))
    rows[:, 0, 0] = 1.0
    rows[:, 0, 1:] = points
    rows[:, 1:, 1:] = np.eye(3)
    return rows
