"""Patch implicit surfaces: smooth patches with local quadrics, joined at sharp edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.contact_merging import merge_duplicates, padded_bounds, spacing_of
from lis_grasp.surfaces.kernel_mean import KernelMean, density_weights
from lis_grasp.surfaces.local_quadrics import LocalQuadrics
from lis_grasp.surfaces.patch import Patch, values_of_patches
from lis_grasp.surfaces.patch_csg import EdgePairs, Expression, build_expressions
from lis_grasp.surfaces.patch_segmentation import REACH, ContactPairs, find_patches
from lis_grasp.surfaces.queries import BlockwiseSurface, flat_points, require_range
from lis_grasp.typing import FloatArray, IndexArray

# Widths of the kernels that blend quadrics in a patch, and expressions of contacts, in spacings.
_PATCH_SIGMA = 0.4
_SIGMA = 0.2

# Default noise of contacts: a good tactile sensor's.
_POSITION_NOISE = 0.01  # in spacings
_NORMAL_NOISE = 0.05  # [rad]

# More patches fit no object and take minutes; of many contacts, this fraction may be isolated (1 %
# on a sphere). Values of all patches at all contacts must fit into memory.
_MOST_PATCHES, _MOST_PATCHES_OF_CONTACTS = 1000, 0.02
_MOST_VALUES = 200_000_000


@dataclass(frozen=True, slots=True, eq=False)
class PatchImplicitSurface(BlockwiseSurface):
    """Smooth patches of local quadrics, joined at sharp edges by CSG expressions.

    Contacts on one smooth surface make a patch, whose function blends their quadrics. Round each
    contact the solid is a CSG expression: a union (min, concave edges) of intersections (max,
    convex edges) of patches. f is the kernel-weighted mean of the expressions, as in eq. 7 of
    Ottenhaus et al. 2016 with planes y_i replaced by expressions, and beta_i = 1.

    Exact for solids of planes, spheres and cylinders if every edge is distinguished from every
    bend. Near the surface f is a distance to first order; far from it only its sign counts.

    Made by `from_contacts`.
    """

    points: FloatArray  #: (N, 3) [m], contacts without duplicates, in O
    normals: FloatArray  #: (N, 3), unit, outward
    patches: tuple[Patch, ...]  #: the smooth patches
    expressions: tuple[Expression, ...]  #: the distinct CSG expressions
    expression_of: IndexArray  #: (N,), index of each contact's expression
    mean: KernelMean  #: kernel-weighted mean over contacts
    spacing: float  #: of the contacts [m]
    bounds: FloatArray  #: (2, 3) [m]

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        position_noise: float | None = None,
        normal_noise: float = _NORMAL_NOISE,
    ) -> PatchImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Parameters
        ----------
        contacts
            Measured on the object; duplicates are merged first.
        position_noise
            One standard deviation of a contact along its normal [m]; None takes 0.01 of the
            contacts' spacing.
        normal_noise
            One standard deviation of each component of the normals [rad].

        Raises
        ------
        InvalidContactsError
            If there is no contact.
        InvalidOptionError
            If an option is outside its range.
        EstimationError
            If contacts contradict each other so much that they have hardly a patch in common.
        """
        merged = merge_duplicates(contacts, position_noise)
        points, normals, spacing = merged.points, merged.normals, spacing_of(merged)
        if position_noise is None:
            position_noise = _POSITION_NOISE * spacing
        require_range("position_noise", position_noise, unit="m")
        require_range("normal_noise", normal_noise, unit="rad")
        noise = {"position_noise": position_noise, "normal_noise": normal_noise}

        pairs = ContactPairs.within(points, normals, REACH * spacing)
        patch_of = find_patches(pairs, len(points), **noise)
        separate = int(patch_of.max()) + 1
        most = _most_patches(len(points))
        if separate > most:
            raise EstimationError(
                f"{len(points)} contacts form {separate} smooth patches, more than {most}: check"
                " whether each normal belongs to its point, and give the noise"
            )
        on_one_patch = pairs.on_one_patch(patch_of)
        quadrics = LocalQuadrics.fit(points, normals, on_one_patch, spacing, **noise)
        patches = tuple(
            Patch.of(np.flatnonzero(patch_of == p), quadrics, _PATCH_SIGMA * spacing)
            for p in range(separate)
        )
        edges = EdgePairs.of(pairs, patch_of, spacing)
        values = values_of_patches(points, patches, quadrics, edges.needed_values()[patch_of])
        expressions = build_expressions(pairs, edges, values, spacing)
        distinct = sorted(set(expressions))
        number = {expression: k for k, expression in enumerate(distinct)}
        sigma = _SIGMA * spacing
        return cls(
            points=points,
            normals=normals,
            patches=patches,
            expressions=tuple(distinct),
            expression_of=np.array([number[expression] for expression in expressions]),
            mean=KernelMean.of(points, sigma, density_weights(points, sigma)),
            spacing=spacing,
            bounds=padded_bounds(merged, spacing),
        )

    def value_and_gradient(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return f at points of shape (P, 3) [m] and its gradient, (P,) and (P, 3), at once."""

        def both(rows: FloatArray) -> FloatArray:
            return np.column_stack(self._value_and_gradient(rows, with_gradient=True))

        answers = self._map(both, points, (4,))
        return answers[:, 0], answers[:, 1:]

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The posterior standard deviation of the quadrics that make the surface there: it grows with
        the given noise, and away from contacts with the open curvature. A misread edge is not
        included.
        """
        rows, shape = flat_points(points)
        return np.sqrt(self._map(self._variance, rows)).reshape(shape)

    def _value_and_gradient(
        self, points: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        near, weights = self.mean.weights(points)
        fields = self._fields(near, lambda p: p.evaluate(points, with_gradient=with_gradient))

        def local(node: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            values, gradients = fields[self.expression_of[node]]
            return values[seen], gradients[seen]

        return self.mean.average(points, near, weights, local, with_gradient=with_gradient)

    def _variance(self, points: FloatArray) -> FloatArray:
        """Return the variance of the surface, shape (P,) [m^2], at points close together."""
        near, weights = self.mean.weights(points)

        def value_and_variance(patch: Patch) -> tuple[FloatArray, FloatArray]:
            values, _ = patch.evaluate(points, with_gradient=False)
            return values, patch.variance(points)[:, None]

        fields = self._fields(near, value_and_variance)
        variances = np.stack([fields[k][1][:, 0] for k in self.expression_of[near]])  # (M, P)
        return np.asarray(np.einsum("mp,mp->p", weights, variances))

    def _fields(
        self, near: IndexArray, evaluate: Callable[[Patch], tuple[FloatArray, FloatArray]]
    ) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Evaluate contacts' expressions; values (P,) and attributes (P, K), as from `evaluate`."""
        used = sorted({int(k) for k in self.expression_of[near]})
        terms = sorted({term for k in used for term in self.expressions[k]})
        involved = sorted({p for term in terms for p in term})
        evaluated = [evaluate(self.patches[p]) for p in involved]
        values = np.stack([value for value, _ in evaluated])  # (patches, P)
        attributes = np.stack([attribute for _, attribute in evaluated])  # (patches, P, K)
        place = {p: row for row, p in enumerate(involved)}
        columns = np.arange(values.shape[1])

        # Active is the largest patch of the smallest intersection; ties to the first.
        active = np.empty((len(terms), len(columns)), dtype=np.intp)
        for row, term in enumerate(terms):
            rows = np.array([place[p] for p in term])
            active[row] = rows[values[rows].argmax(axis=0)]
        heights = values[active, columns]  # (terms, P)
        number = {term: row for row, term in enumerate(terms)}
        fields = {}
        for k in used:
            rows = np.array([number[term] for term in self.expressions[k]])
            patch = active[rows[heights[rows].argmin(axis=0)], columns]
            fields[k] = values[patch, columns], attributes[patch, columns]
        return fields


def _most_patches(contacts: int) -> int:
    """Return the largest number of patches that so many contacts may form."""
    most = max(_MOST_PATCHES, int(_MOST_PATCHES_OF_CONTACTS * contacts))
    return min(most, _MOST_VALUES // contacts)
