"""Values of several patches at the same points, in one computation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.surfaces._patch import Patch
from lis_grasp.surfaces.kernel_expansion import KernelExpansion
from lis_grasp.surfaces.quadric_trend import about_origin, value_rows
from lis_grasp.typing import FloatArray, IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class JoinedPatches:
    """The functions of K patches in one coordinate system.

    The nodes of all patches are those of one expansion; the sum over each patch's own is its value.
    """

    spacing: float  # [m], the unit of length
    center: FloatArray  # (3,) [m], origin of the coordinates
    coefficients: FloatArray  # (K, 10) of the trends
    residual: KernelExpansion  # of the nodes of all patches, patch by patch
    starts: IndexArray  # (K + 1,): patch k owns the nodes starts[k]:starts[k + 1]

    @classmethod
    def of(cls, patches: Sequence[Patch]) -> JoinedPatches:
        """Join patches of the same spacing; at least one."""
        spacing, center = patches[0].spacing, patches[0].center
        offsets = [(patch.center - center) / spacing for patch in patches]
        pairs = list(zip(patches, offsets, strict=True))
        nodes = np.concatenate([patch.residual.nodes + offset for patch, offset in pairs])
        weights = np.concatenate([patch.residual.weights for patch in patches])
        counts = [len(patch.residual.nodes) for patch in patches]
        return cls(
            spacing,
            center,
            np.stack([about_origin(patch.coefficients, offset) for patch, offset in pairs]),
            KernelExpansion(patches[0].residual.kernel, nodes, weights),
            np.cumsum([0, *counts]),
        )

    def some(self, chosen: IndexArray) -> JoinedPatches:
        """Return some of the patches, (C,)."""
        if len(chosen) == len(self.coefficients):
            return self
        ranges = [np.arange(self.starts[k], self.starts[k + 1]) for k in chosen]
        rows, of_all = np.concatenate(ranges), self.residual
        residual = KernelExpansion(of_all.kernel, of_all.nodes[rows], of_all.weights[rows])
        starts = np.cumsum([0, *map(len, ranges)])
        return JoinedPatches(self.spacing, self.center, self.coefficients[chosen], residual, starts)

    def values(self, points: FloatArray) -> FloatArray:
        """Return the value of each patch (`Patch.value`) at points (P, 3) [m], (K, P) [m]."""
        scaled = (points - self.center) / self.spacing
        values = np.add.reduceat(self.residual.terms(scaled), self.starts[:-1], axis=0)
        values += self.coefficients @ value_rows(scaled).T
        values *= self.spacing
        return np.asarray(values)
