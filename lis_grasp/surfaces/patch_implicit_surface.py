"""Patch implicit surfaces: smooth Gaussian processes, joined at sharp edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.records import short_repr
from lis_grasp.surfaces.contact_merging import merge_duplicates, padded_bounds, spacing_of
from lis_grasp.surfaces.contact_noise import noise_of
from lis_grasp.surfaces.contact_pairs import ContactPairs
from lis_grasp.surfaces.contact_places import ContactPlaces
from lis_grasp.surfaces.contact_thinning import thin_contacts
from lis_grasp.surfaces.kernel_mean import KernelMean, density_weights
from lis_grasp.surfaces.noise_estimation import noise_or_estimate
from lis_grasp.surfaces.patch import Patch, noise_variances
from lis_grasp.surfaces.patch_csg import EdgePairs, Expression, build_expressions
from lis_grasp.surfaces.patch_segmentation import segment
from lis_grasp.surfaces.queries import BlockwiseSurface, flat_points
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Width of the kernel that blends expressions of contacts, in spacings.
_SIGMA = 0.2

# Least noise of contacts, in spacings and rad: no surface is exactly a quadric or a process.
_LEAST_NOISE = (0.003, 0.015)

# More contacts are thinned, for time and memory. More patches fit no object.
MOST_CONTACTS = 400
_MOST_PATCHES = 200


@dataclass(frozen=True, slots=True, eq=False)
class PatchImplicitSurface(BlockwiseSurface):
    """Smooth patches, each a Gaussian process, joined at sharp edges by CSG expressions.

    Contacts on one smooth surface make a patch: a Gaussian process with a quadric trend through
    their points and normals (`patch`). Which contacts do is decided by marginal likelihood
    (`patch_segmentation`). Round each contact the solid is a CSG expression: a union (min, concave
    edges) of intersections (max, convex edges) of patches. f is the kernel-weighted mean of the
    expressions, as in eq. 7 of Ottenhaus et al. 2016 with planes y_i replaced by expressions, and
    beta_i = 1.

    Exact for solids of planes, spheres and cylinders if every edge is distinguished from every
    bend. Near the surface f is a distance to first order; far from it only its sign counts.

    Made by `from_contacts`.
    """

    points: FloatArray  #: (N, 3) [m], contacts without duplicates, in O
    normals: FloatArray  #: (N, 3), unit, outward
    patch_of: IndexArray  #: (N,) index of the patch of each contact
    position_noise: FloatArray  #: (N,) [m], one standard deviation along the normal
    normal_noise: FloatArray  #: (N,) [rad], one of each component of the normal
    patches: tuple[Patch, ...]  #: the smooth patches
    expressions: tuple[Expression, ...]  #: the distinct CSG expressions
    expression_of: IndexArray  #: (N,), index of each contact's expression
    mean: KernelMean  #: kernel-weighted mean over contacts
    spacing: float  #: between places of contacts [m]
    bounds: FloatArray  #: (2, 3) [m]

    __repr__ = short_repr

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        position_noise: float | None = None,
        normal_noise: float | None = None,
    ) -> PatchImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        More than 400 contacts are replaced by 400 means of neighbouring ones (`thin_contacts`).

        Parameters
        ----------
        contacts
            Measured on the object; duplicates are merged first.
        position_noise, normal_noise
            One standard deviation along the normal [m] and of each component of the normal [rad],
            for contacts whose own noise is unknown. None estimates it from the contacts.

        Raises
        ------
        InvalidContactsError
            If there is no contact.
        InvalidOptionError
            If an option is outside its range.
        EstimationError
            If contacts contradict each other so much that they have hardly a patch in common.
        """
        merged = merge_duplicates(contacts, position_noise, normal_noise)
        merged = thin_contacts(merged, MOST_CONTACTS)
        points, normals = merged.points, merged.normals
        spacing = ContactPlaces.of(points).spacing
        pairs = ContactPairs.within(points, normals, spacing)
        estimated = noise_or_estimate(merged, position_noise, normal_noise)
        least = noise_of(
            merged,
            _LEAST_NOISE[0] * spacing if position_noise is None else position_noise,
            _LEAST_NOISE[1] if normal_noise is None else normal_noise,
        )
        # Contacts too sparse for a shape with edges look noisy until they are divided into patches.
        noise = np.maximum(estimated, least)
        patch_of, evidence = segment(points, normals, pairs, spacing, *noise)
        if not np.array_equal(noise, least):
            other, other_evidence = segment(points, normals, pairs, spacing, *least)
            if other_evidence > evidence:
                noise, patch_of = np.array(least), other
        separate = int(patch_of.max()) + 1
        if separate > _MOST_PATCHES:
            raise EstimationError(
                f"{len(points)} contacts form {separate} smooth patches, more than {_MOST_PATCHES}:"
                " check whether each normal belongs to its point, and give the noise"
            )
        bounds = padded_bounds(merged, spacing_of(merged))
        amplitudes = [None] * separate
        return cls._join(
            points, normals, patch_of, (noise[0], noise[1]), pairs, amplitudes, spacing, bounds
        )

    def without(self, left_out: BoolArray) -> PatchImplicitSurface:
        """Return the estimate without some contacts, (N,), with the same segmentation and noise.

        Each contact keeps its patch, each patch its amplitude, and lengths stay in proportion to
        the spacing of all contacts.
        """
        points, normals = self.points[~left_out], self.normals[~left_out]
        left, patch_of = np.unique(self.patch_of[~left_out], return_inverse=True)
        noise = self.position_noise[~left_out], self.normal_noise[~left_out]
        pairs = ContactPairs.within(points, normals, self.spacing)
        amplitudes = [self.patches[p].amplitude for p in left]
        return self._join(
            points, normals, patch_of, noise, pairs, amplitudes, self.spacing, self.bounds
        )

    @classmethod
    def _join(
        cls,
        points: FloatArray,
        normals: FloatArray,
        patch_of: IndexArray,
        noise: tuple[FloatArray, FloatArray],
        pairs: ContactPairs,
        amplitudes: list[float] | list[None],
        spacing: float,
        bounds: FloatArray,
    ) -> PatchImplicitSurface:
        """Fit the patches and join them by CSG expressions."""
        variances = noise_variances(noise[0] / spacing, noise[1]).reshape(len(points), -1)
        patches = []
        for number, amplitude in enumerate(amplitudes):
            members = np.flatnonzero(patch_of == number)
            chosen = points[members], normals[members]
            of_noise = variances[members].ravel()
            patches.append(Patch.fit(members, *chosen, spacing, of_noise, amplitude))
        edges = EdgePairs.of(pairs, patch_of, spacing)
        wanted = edges.needed_values()[patch_of]  # (N, K)
        values = np.full(wanted.shape, np.nan)
        for column, patch in enumerate(patches):
            rows = np.flatnonzero(wanted[:, column])
            values[rows, column] = patch.value(points[rows])
        expressions = build_expressions(pairs, edges, values, spacing)
        distinct = sorted(set(expressions))
        number_of = {expression: k for k, expression in enumerate(distinct)}
        sigma = _SIGMA * spacing
        return cls(
            points=points,
            normals=normals,
            patch_of=patch_of,
            position_noise=noise[0],
            normal_noise=noise[1],
            patches=tuple(patches),
            expressions=tuple(distinct),
            expression_of=np.array([number_of[expression] for expression in expressions]),
            mean=KernelMean.of(points, sigma, density_weights(points, sigma)),
            spacing=spacing,
            bounds=bounds,
        )

    def value_and_gradient(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return f at points of shape (P, 3) [m] and its gradient, (P,) and (P, 3), at once."""

        def both(rows: FloatArray) -> FloatArray:
            return np.column_stack(self._value_and_gradient(rows, with_gradient=True))

        answers = self._map(both, points, (4,))
        return answers[:, 0], answers[:, 1:]

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The posterior standard deviation of the patches that make the surface there: it grows with
        noise, and away from contacts. A misread edge is not included.
        """
        rows, shape = flat_points(points)
        return np.sqrt(self._map(self._variance, rows)).reshape(shape)

    def _value_and_gradient(
        self, points: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        near, weights = self.mean.weights(points)

        def evaluate(patch: Patch) -> tuple[FloatArray, FloatArray]:
            values = patch.value(points)
            return values, patch.gradient(points) if with_gradient else values[:, None]

        number, values, gradients = self._fields(near, evaluate)
        terms = weights * values[number]  # (M, P)
        mean = terms.sum(axis=0)
        if not with_gradient:
            return mean, points
        slopes = np.einsum("ep,epk->pk", _sums(weights, number), gradients)
        slopes += self.mean.pulls(points, near, terms)
        slopes -= mean[:, None] * self.mean.pulls(points, near, weights)
        return mean, slopes

    def _variance(self, points: FloatArray) -> FloatArray:
        """Return the variance of the surface, shape (P,) [m^2], at points close together."""
        near, weights = self.mean.weights(points)

        def value_and_variance(patch: Patch) -> tuple[FloatArray, FloatArray]:
            return patch.value(points), patch.variance(points)[:, None]

        number, _, variances = self._fields(near, value_and_variance)
        return np.asarray(np.einsum("ep,ep->p", _sums(weights, number), variances[..., 0]))

    def _fields(
        self, near: IndexArray, evaluate: Callable[[Patch], tuple[FloatArray, FloatArray]]
    ) -> tuple[IndexArray, FloatArray, FloatArray]:
        """Evaluate the expressions of contacts `near`, (M,), at P points.

        Returns which of the E evaluated expressions is each contact's, (M,); their values (E, P);
        and the attributes (E, P, K) of the patches that make them, as from `evaluate`.
        """
        used, number_of = np.unique(self.expression_of[near], return_inverse=True)
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
        shown = np.empty((len(used), len(columns)), dtype=np.intp)
        for row, k in enumerate(used):
            rows = np.array([number[term] for term in self.expressions[k]])
            shown[row] = active[rows[heights[rows].argmin(axis=0)], columns]
        return number_of, values[shown, columns], attributes[shown, columns]


def _sums(weights: FloatArray, number: IndexArray) -> FloatArray:
    """Return sums over the rows of weights (M, P) that have each number from 0 on, (E, P)."""
    chosen = number == np.arange(number.max() + 1)[:, None]  # (E, M)
    return np.asarray(chosen.astype(np.float64) @ weights)
