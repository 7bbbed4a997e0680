"""Patch implicit surfaces: smooth patches with local quadrics, joined at sharp edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.contact_merging import merge_duplicates, spacing_of
from lis_grasp.surfaces.contact_weights import density_weights
from lis_grasp.surfaces.kernel_mean import KernelMean
from lis_grasp.surfaces.local_quadrics import LocalQuadrics
from lis_grasp.surfaces.patch import Patch, values_of_patches
from lis_grasp.surfaces.patch_relations import Formula, Meetings, compose_formulas
from lis_grasp.surfaces.patch_segmentation import REACH, ContactPairs, find_patches
from lis_grasp.surfaces.queries import (
    flat_points,
    map_blocks,
    require_contacts,
    require_range,
)
from lis_grasp.typing import FloatArray, IndexArray

# Widths of the kernels that blend quadrics within a patch and formulas of contacts, in spacings.
_PATCH_SIGMA = 0.4
_SIGMA = 0.2

# Of contacts, where the caller does not say: a good tactile sensor's.
_POSITION_NOISE = 0.01  # in spacings
_NORMAL_NOISE = 0.05  # [rad]

# More smooth patches than these are no object's, and would take minutes: so many, or where contacts
# are very many this share of them (random contacts on a sphere leave islands out of reach of the
# rest, patches of their own, 1 % as many as contacts); but no more values of patches at contacts
# than memory holds.
_MOST_PATCHES, _MOST_PATCHES_OF_CONTACTS = 1000, 0.02
_MOST_VALUES = 200_000_000

# Points evaluated at once: so many, in a box no larger than this many spacings.
_BLOCK, _BLOCK_EXTENT = 4096, 8.0


@dataclass(frozen=True, slots=True, eq=False)
class PatchImplicitSurface:
    """Local implicit shapes that know smooth from sharp: quadrics, joined by maxima and minima.

    Contacts that lie on one smooth surface make a patch, whose function blends their quadrics.
    Round each contact the solid is a formula of maxima (convex edges) and minima (concave edges)
    of patches. f is the kernel-weighted mean of the formulas, as in eq. 7 of Ottenhaus et al. 2016
    with y_i taken from planes to such formulas and beta_i, which they make needless, to 1.

    Exact for solids made of planes, spheres and cylinders if every edge is told apart from every
    bend. Near the surface f is a distance to first order; far from it only its sign counts.

    Made by `from_contacts`.

    Parameters
    ----------
    points, normals
        Shape (N, 3) [m] and (N, 3), contacts without duplicates, in O.
    patches
        The smooth pieces.
    formulas
        The distinct formulas.
    formula_of
        Shape (N,), the formula of each contact.
    mean
        Over contacts.
    spacing
        Of the contacts [m].
    bounds
        Shape (2, 3) [m].
    remake
        `from_contacts` with the options that this surface was made with.
    """

    points: FloatArray
    normals: FloatArray
    patches: tuple[Patch, ...]
    formulas: tuple[Formula, ...]
    formula_of: IndexArray
    mean: KernelMean
    spacing: float
    bounds: FloatArray
    remake: Callable[[Contacts], PatchImplicitSurface]

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        position_noise: float | None = None,
        normal_noise: float = _NORMAL_NOISE,
        margin: float | None = None,
    ) -> PatchImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Parameters
        ----------
        contacts
            Where the object was touched; duplicates are merged first.
        position_noise
            One standard deviation of a contact along its normal [m]; None takes 0.01 of the
            contacts' spacing.
        normal_noise
            One standard deviation of each component of the normals [rad].
        margin
            By how much bounds exceed the contacts' box [m]; None takes one spacing.

        Raises
        ------
        InvalidContactsError
            If there is no contact.
        InvalidOptionError
            If an option is outside its range.
        EstimationError
            If contacts contradict each other so much that they have hardly a patch in common.
        """
        require_contacts(contacts)
        remake = partial(
            cls.from_contacts,
            position_noise=position_noise,
            normal_noise=normal_noise,
            margin=margin,
        )
        merged = merge_duplicates(contacts, position_noise)
        points, normals, spacing = merged.points, merged.normals, spacing_of(merged)
        margin = spacing if margin is None else require_range("margin", margin, 0.0, unit="m")
        if position_noise is None:
            position_noise = _POSITION_NOISE * spacing
        require_range("position_noise", position_noise, 0.0, unit="m")
        require_range("normal_noise", normal_noise, 0.0, unit="rad")

        pairs = ContactPairs.within(points, normals, REACH * spacing)
        patch_of = find_patches(
            pairs, len(points), position_noise=position_noise, normal_noise=normal_noise
        )
        separate = int(patch_of.max()) + 1
        most = _most_patches(len(points))
        if separate > most:
            raise EstimationError(
                f"{len(points)} contacts fall into {separate} smooth patches, more"
                f" than {most}: see whether each normal belongs to its point, and"
                " tell the noise"
            )
        quadrics = LocalQuadrics.fit(
            points,
            normals,
            pairs.on_one_patch(patch_of),
            spacing,
            position_noise=position_noise,
            normal_noise=normal_noise,
        )
        patches = tuple(
            Patch.of(np.flatnonzero(patch_of == p), quadrics, _PATCH_SIGMA * spacing)
            for p in range(patch_of.max() + 1)
        )
        meetings = Meetings.of(pairs, patch_of, spacing)
        values = values_of_patches(points, patches, quadrics, meetings.asked_for()[patch_of])
        formulas = compose_formulas(pairs, meetings, values, spacing)
        distinct = sorted(set(formulas))
        number = {formula: k for k, formula in enumerate(distinct)}
        sigma = _SIGMA * spacing
        return cls(
            points=points,
            normals=normals,
            patches=patches,
            formulas=tuple(distinct),
            formula_of=np.array([number[formula] for formula in formulas]),
            mean=KernelMean.of(points, sigma, density_weights(points, sigma)),
            spacing=spacing,
            bounds=merged.bounds + margin * np.array([[-1.0], [1.0]]),
            remake=remake,
        )

    def with_contacts(self, new: Contacts) -> PatchImplicitSurface:
        """Return the estimate from the new contacts too: made anew, which takes milliseconds."""
        return self.remake(Contacts(self.points, self.normals).append(new))

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        values = map_blocks(
            lambda x: self._superpose(x, with_gradient=False)[0], rows, *self._blocks
        )
        return values.reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the exact gradient of f at points of shape (..., 3) [m], shape (..., 3).

        At an edge, where f has a kink, one of the one-sided gradients.
        """
        rows, shape = flat_points(points)
        gradients = map_blocks(
            lambda x: self._superpose(x, with_gradient=True)[1], rows, *self._blocks, (3,)
        )
        return gradients.reshape(*shape, 3)

    def value_and_gradient(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return f at points of shape (P, 3) [m] and its gradient, (P,) and (P, 3), in one go."""

        def both(rows: FloatArray) -> FloatArray:
            values, gradients = self._superpose(rows, with_gradient=True)
            return np.column_stack([values, gradients])

        answers = map_blocks(both, points, *self._blocks, (4,))
        return answers[:, 0], answers[:, 1:]

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The posterior standard deviation of the quadrics that make the surface there: it grows with
        the noise that was told, and away from contacts with what their neighbours leave open of
        the curvature. Whether the edges were read rightly is not in it.
        """
        rows, shape = flat_points(points)
        return np.sqrt(map_blocks(self._variance, rows, *self._blocks)).reshape(shape)

    @property
    def _blocks(self) -> tuple[int, float]:
        return _BLOCK, _BLOCK_EXTENT * self.spacing

    def _superpose(
        self, points: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return f, shape (P,), and its gradient, shape (P, 3), at points close together."""
        near, shares = self.mean.shares(points)
        fields = self._fields(near, lambda p: p.evaluate(points, with_gradient=with_gradient))

        def local(node: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            values, gradients = fields[self.formula_of[node]]
            return values[seen], gradients[seen]

        return self.mean.superpose(points, near, shares, local, with_gradient=with_gradient)

    def _variance(self, points: FloatArray) -> FloatArray:
        """Return the variance of the surface, shape (P,) [m^2], at points close together."""
        near, shares = self.mean.shares(points)

        def value_and_variance(patch: Patch) -> tuple[FloatArray, FloatArray]:
            values, _ = patch.evaluate(points, with_gradient=False)
            return values, patch.variance(points)[:, None]

        fields = self._fields(near, value_and_variance)
        variances = np.stack([fields[k][1][:, 0] for k in self.formula_of[near]])  # (M, P)
        return np.asarray(np.einsum("mp,mp->p", shares, variances))

    def _fields(
        self, near: IndexArray, ask: Callable[[Patch], tuple[FloatArray, FloatArray]]
    ) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Return the formulas of contacts: values (P,), and of the patch that wins, what it has.

        `ask` gives a patch's values, shape (P,), and what comes along with them, shape (P, K).
        """
        used = sorted({int(k) for k in self.formula_of[near]})
        pieces = sorted({piece for k in used for piece in self.formulas[k]})
        involved = sorted({p for piece in pieces for p in piece})
        asked = [ask(self.patches[p]) for p in involved]
        values = np.stack([value for value, _ in asked])  # (patches, P)
        along = np.stack([other for _, other in asked])  # (patches, P, K)
        place = {p: row for row, p in enumerate(involved)}
        columns = np.arange(values.shape[1])

        # Of each piece the largest patch, of each formula the smallest piece; ties to the first.
        winners = np.empty((len(pieces), len(columns)), dtype=np.intp)
        for row, piece in enumerate(pieces):
            rows = np.array([place[p] for p in piece])
            winners[row] = rows[values[rows].argmax(axis=0)]
        heights = values[winners, columns]  # (pieces, P)
        number = {piece: row for row, piece in enumerate(pieces)}
        fields = {}
        for k in used:
            rows = np.array([number[piece] for piece in self.formulas[k]])
            winner = winners[rows[heights[rows].argmin(axis=0)], columns]
            fields[k] = values[winner, columns], along[winner, columns]
        return fields


def _most_patches(contacts: int) -> int:
    """Return into how many patches so many contacts may fall."""
    most = max(_MOST_PATCHES, int(_MOST_PATCHES_OF_CONTACTS * contacts))
    return min(most, _MOST_VALUES // contacts)
