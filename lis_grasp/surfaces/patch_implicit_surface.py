"""Patch implicit surfaces: smooth Gaussian processes, joined at sharp edges."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.guesses import with_advice
from lis_grasp.records import short_repr
from lis_grasp.surfaces._kernel_mean import LEAST_WEIGHT, KernelMean, density_weights
from lis_grasp.surfaces._patch import JoinedPatches, Patch, PatchContacts, PatchPrior
from lis_grasp.surfaces._patch_csg import (
    EdgePairs,
    Expression,
    active_patches,
    build_expressions,
    solid_values,
)
from lis_grasp.surfaces._patch_segmentation import ContactPairs, segment
from lis_grasp.surfaces.contact_preparation import PreparedContacts, prepare_contacts
from lis_grasp.surfaces.queries import BlockwiseSurface, flat_points
from lis_grasp.typing import BoolArray, FloatArray, IndexArray
from lis_grasp.underflow import methods_underflow

# Width of the kernel that blends expressions of contacts, in spacings.
_SIGMA = 0.2

# Least noise of contacts, in spacings and rad: no surface is exactly a quadric or a process.
_LEAST_NOISE = (0.003, 0.015)

# More patches fit no object.
_MOST_PATCHES = 200


@methods_underflow
@dataclass(frozen=True, slots=True, eq=False)
class PatchImplicitSurface(BlockwiseSurface):
    """Smooth patches, each a Gaussian process, joined at sharp edges by CSG expressions.

    Contacts on one smooth surface make a patch: a Gaussian process with a quadric trend through
    their points and normals (`patch`). Marginal likelihood decides which contacts do
    (`patch_segmentation`). Round each contact the solid is a CSG expression: a union (min, concave
    edges) of intersections (max, convex edges) of patches. f is the kernel-weighted mean of the
    expressions, as in eq. 7 of Ottenhaus et al. 2016 with planes y_i replaced by expressions, and
    beta_i = 1.

    Exact for solids of planes, spheres and cylinders if every edge is distinguished from every
    bend. Near the surface f is a distance to first order; far from it only its sign counts.

    Made by `from_contacts`.

    Examples
    --------
    >>> surface = PatchImplicitSurface.from_contacts(contacts)
    >>> surface.bounds.shape
    (2, 3)
    """

    points: FloatArray  #: (N, 3) [m], contacts without duplicates, in O
    normals: FloatArray  #: (N, 3), unit, outward
    patch_of: IndexArray  #: (N,) index of the patch of each contact
    position_noise: FloatArray  #: (N,) [m], one standard deviation along the normal
    normal_noise: FloatArray  #: (N,) [rad], one of each component of the normal
    patches: tuple[Patch, ...]  #: the smooth patches
    joined: JoinedPatches  #: their values, at once
    expressions: tuple[Expression, ...]  #: the distinct CSG expressions
    expression_of: IndexArray  #: (N,), index of each contact's expression
    mean: KernelMean  #: kernel-weighted mean over contacts
    spacing: float  #: between places of contacts [m]
    bounds: FloatArray  #: (2, 3) [m]

    __repr__ = short_repr

    @classmethod
    @with_advice
    def from_contacts(
        cls,
        contacts: Contacts | PreparedContacts,
        *,
        position_noise: float | None = None,
        normal_noise: float | None = None,
    ) -> PatchImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        For arguments and errors see `prepare_contacts`.

        Raises `EstimationError` if contacts contradict each other so much that they have hardly a
        patch in common.
        """
        prepared = prepare_contacts(contacts, position_noise, normal_noise)
        points, normals = prepared.contacts.points, prepared.contacts.normals
        spacing = prepared.places.spacing
        pairs = ContactPairs.within(points, normals, spacing)
        noise = np.stack([prepared.position_noise, prepared.normal_noise])
        floors = np.array([[_LEAST_NOISE[0] * spacing], [_LEAST_NOISE[1]]])
        least = np.where(prepared.estimated, floors, noise)
        noise = np.maximum(noise, least)
        known = PatchContacts.of(points, normals, spacing, (noise[0], noise[1]))
        patch_of, evidence = segment(known, pairs)
        # Contacts too sparse for a shape with edges look noisy until they are divided into patches.
        if not np.array_equal(noise, least):
            clean = PatchContacts.of(points, normals, spacing, (least[0], least[1]))
            other, other_evidence = segment(clean, pairs)
            if other_evidence > evidence:
                known, patch_of = clean, other
        separate = int(patch_of.max()) + 1
        if separate > _MOST_PATCHES:
            raise EstimationError(
                f"{len(points)} contacts form {separate} smooth patches, more than {_MOST_PATCHES}:"
                " check whether each normal belongs to its point, and give the noise"
            )
        return cls._join(points, known, patch_of, pairs, [None] * separate, prepared.bounds)

    def without(self, left_out: BoolArray) -> PatchImplicitSurface:
        """Return the estimate without some contacts, (N,), with the same segmentation and noise.

        Each contact keeps its patch, each patch its prior, and lengths stay in proportion to
        the spacing of all contacts.
        """
        kept = np.flatnonzero(~left_out)
        left, patch_of = np.unique(self.patch_of[kept], return_inverse=True)
        points, normals = self.points[kept], self.normals[kept]
        noise = self.position_noise[kept], self.normal_noise[kept]
        known = PatchContacts.of(points, normals, self.spacing, noise)
        pairs = ContactPairs.within(points, normals, self.spacing)
        priors = [self.patches[p].prior for p in left]
        return self._join(points, known, patch_of, pairs, priors, self.bounds)

    @classmethod
    def _join(
        cls,
        points: FloatArray,
        contacts: PatchContacts,
        patch_of: IndexArray,
        pairs: ContactPairs,
        priors: list[PatchPrior] | list[None],
        bounds: FloatArray,
    ) -> PatchImplicitSurface:
        """Fit the patches and join them by CSG expressions; the contacts are at points [m]."""
        spacing = contacts.spacing
        patches = [
            Patch.fit(contacts, np.flatnonzero(patch_of == number), prior)
            for number, prior in enumerate(priors)
        ]
        edges = EdgePairs.of(pairs, patch_of, spacing)
        joined = JoinedPatches.of(patches)
        expressions = build_expressions(pairs, edges, joined.values(points).T, spacing)
        distinct = sorted(set(expressions))
        number_of = {expression: k for k, expression in enumerate(distinct)}
        sigma = _SIGMA * spacing
        return cls(
            points=points,
            normals=contacts.normals,
            patch_of=patch_of,
            position_noise=contacts.noise[0],
            normal_noise=contacts.noise[1],
            patches=tuple(patches),
            joined=joined,
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
        near, weights = self.mean.weights(points)  # (M,), (M, P)
        expressions, patches, number = self._expressions_of(near)
        values = self.joined.some(patches).values(points)
        if not with_gradient:
            solids = solid_values(expressions, values)
            return np.einsum("mp,mp->p", weights, solids[number]), points
        active = active_patches(expressions, values)  # (E, P)
        solids = values[active, np.arange(len(points))]
        mean = np.einsum("mp,mp->p", weights, solids[number])
        slopes = self.mean.pulls(points, near, weights * (solids[number] - mean))
        for patch, seen, of_patch in self._parts(patches, active, weights, number):
            slopes[seen] += of_patch[:, None] * patch.gradient(points[seen])
        return mean, slopes

    def _variance(self, points: FloatArray) -> FloatArray:
        """Return the variance of the surface, shape (P,) [m^2], at points close together."""
        near, weights = self.mean.weights(points)
        expressions, patches, number = self._expressions_of(near)
        active = active_patches(expressions, self.joined.some(patches).values(points))
        variances = np.zeros(len(points))
        for patch, seen, of_patch in self._parts(patches, active, weights, number):
            variances[seen] += of_patch * patch.variance(points[seen])
        return variances

    def _expressions_of(self, near: IndexArray) -> tuple[list[Expression], IndexArray, IndexArray]:
        """Return the expressions of contacts `near`, (M,), which patches occur, and each's number.

        The patches, (K,), are numbered in the expressions by their place among them.
        """
        used, number = np.unique(self.expression_of[near], return_inverse=True)
        shown = [self.expressions[k] for k in used]
        patches = sorted({p for each in shown for term in each for p in term})
        row = {p: k for k, p in enumerate(patches)}
        renumbered = [tuple(tuple(row[p] for p in term) for term in each) for each in shown]
        return renumbered, np.array(patches), number

    def _parts(
        self, patches: IndexArray, active: IndexArray, weights: FloatArray, number: IndexArray
    ) -> Iterator[tuple[Patch, IndexArray, FloatArray]]:
        """Yield each patch that makes the surface at some points, these (S,), and its weights."""
        columns = np.arange(weights.shape[1])
        of_patches = np.zeros((len(patches), len(columns)))
        for weight, k in zip(weights, number, strict=True):
            of_patches[active[k], columns] += weight
        for p, of_patch in zip(patches, of_patches, strict=True):
            seen = np.flatnonzero(of_patch > LEAST_WEIGHT)
            if len(seen):
                yield self.patches[p], seen, of_patch[seen]
