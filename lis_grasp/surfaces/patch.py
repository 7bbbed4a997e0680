"""A patch: a smooth piece of a surface, blended from the quadrics of its contacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.surfaces.kernel_mean import LEAST_SHARE, KernelMean
from lis_grasp.surfaces.local_quadrics import LocalQuadrics
from lis_grasp.surfaces.queries import compact_blocks
from lis_grasp.typing import FloatArray, IndexArray

# Correlation of the errors of neighbours' quadrics, which see much the same contacts: measured on
# eight solids touched with noise, where 71 and 94 % of the surface lie within one and 1.96
# standard deviations.
_CORRELATION = 0.4

_BLOCK = 2048


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A smooth piece of the surface: the kernel-weighted mean of its contacts' quadrics.

    Parameters
    ----------
    members
        Shape (M,), its contacts.
    quadrics
        Of all contacts.
    mean
        Over the members.
    """

    members: IndexArray
    quadrics: LocalQuadrics
    mean: KernelMean

    @classmethod
    def of(cls, members: IndexArray, quadrics: LocalQuadrics, sigma: float) -> Patch:
        """Blend the members' quadrics by a kernel of width `sigma` [m]."""
        return cls(members, quadrics, KernelMean.of(quadrics.points[members], sigma))

    def evaluate(self, points: FloatArray, *, with_gradient: bool) -> tuple[FloatArray, FloatArray]:
        """Return the patch's function, shape (P,) [m], and gradient, (P, 3), at points near by."""

        def local(node: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            member = self.members[node]
            return self.quadrics.evaluate(member, points[seen], with_gradient=with_gradient)

        near, shares = self.mean.shares(points)
        return self.mean.superpose(points, near, shares, local, with_gradient=with_gradient)

    def variance(self, points: FloatArray) -> FloatArray:
        """Return the variance of the patch, shape (P,) [m^2]: that of a mean of quadrics."""

        def local(node: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            return self.quadrics.variance(self.members[node], points[seen]), points

        near, shares = self.mean.shares(points)
        mean, _ = self.mean.superpose(points, near, shares, local, with_gradient=False)
        alone = np.sum(shares**2, axis=0)  # 1 where a single quadric counts
        return mean * (_CORRELATION + (1.0 - _CORRELATION) * alone)


def values_of_patches(
    points: FloatArray,
    patches: tuple[Patch, ...],
    quadrics: LocalQuadrics,
    wanted: npt.NDArray[np.bool_],
) -> FloatArray:
    """Return the function of each of K patches at points, shape (P, K) [m].

    Only what is wanted, shape (P, K), is sure to be there; the rest may be NaN.
    """
    values = np.full((len(points), len(patches)), np.nan)
    for index in compact_blocks(points, _BLOCK):
        asked = np.flatnonzero(wanted[index].any(axis=0))
        if not len(asked):
            continue
        nodes, cells, weights = [], [], []
        for column, patch in enumerate(patches[k] for k in asked):
            near, shares = patch.mean.shares(points[index])
            node, row = np.nonzero(shares > LEAST_SHARE)
            nodes.append(patch.members[near[node]])
            cells.append(row * len(asked) + column)
            weights.append(shares[node, row])
        cell = np.concatenate(cells)
        terms = quadrics.values(np.concatenate(nodes), points[index][cell // len(asked)])
        terms *= np.concatenate(weights)
        sums = np.bincount(cell, terms, len(index) * len(asked))
        values[np.ix_(index, asked)] = sums.reshape(len(index), -1)
    return values
