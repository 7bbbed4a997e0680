"""Patch implicit surfaces: smooth patches with local quadrics, joined at sharp edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import merge_duplicates, spacing_of
from lis_grasp.surfaces.contact_weights import density_weights
from lis_grasp.surfaces.kernel_mean import KernelMean
from lis_grasp.surfaces.local_quadrics import LocalQuadrics
from lis_grasp.surfaces.patch_relations import Formula, Piece, compose_formulas
from lis_grasp.surfaces.patches import REACH, ContactPairs, find_patches
from lis_grasp.surfaces.queries import (
    compact_blocks,
    flat_points,
    require_contacts,
    require_range,
)

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]

# Widths of the kernels that blend quadrics within a patch and formulas of contacts, in spacings.
_PATCH_SIGMA = 0.4
_SIGMA = 0.2

# Of contacts, where the caller does not say: a good tactile sensor's.
_POSITION_NOISE = 0.01  # in spacings
_NORMAL_NOISE = 0.05  # [rad]

# Root mean square error of the surface at distance d from the nearest contact, in units of
# d^2 / spacing: 0.17 to 0.42 for d from 0.2 to 1.4 spacings, on eight solids at two spacings.
_SHAPE_ERROR = 0.25

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

    def evaluate(self, points: FloatArray, *, with_gradient: bool) -> tuple[FloatArray, FloatArray]:
        """Return the patch's function, shape (P,) [m], and gradient, (P, 3), at points near by."""

        def local(node: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            member = self.members[node]
            return self.quadrics.evaluate(member, points[seen], with_gradient=with_gradient)

        near, shares = self.mean.shares(points)
        return self.mean.superpose(points, near, shares, local, with_gradient=with_gradient)


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
    points
        Shape (N, 3) [m], contacts without duplicates, in O.
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
    position_noise, normal_noise
        One standard deviation of a contact's position [m] and normal [rad].
    bounds
        Shape (2, 3) [m].
    """

    points: FloatArray
    patches: tuple[Patch, ...]
    formulas: tuple[Formula, ...]
    formula_of: IndexArray
    mean: KernelMean
    spacing: float
    position_noise: float
    normal_noise: float
    bounds: FloatArray

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
        """
        require_contacts(contacts)
        merged = merge_duplicates(contacts)
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
        quadrics = LocalQuadrics.fit(
            points,
            normals,
            pairs.on_one_patch(patch_of),
            spacing,
            position_noise=position_noise,
            normal_noise=normal_noise,
        )
        patches = tuple(
            _patch(np.flatnonzero(patch_of == p), quadrics, _PATCH_SIGMA * spacing)
            for p in range(patch_of.max() + 1)
        )
        values = np.stack(
            [patch.evaluate(points, with_gradient=False)[0] for patch in patches], axis=1
        )  # (N, K)
        formulas = compose_formulas(pairs, patch_of, values, spacing)
        distinct = sorted(set(formulas))
        number = {formula: k for k, formula in enumerate(distinct)}
        sigma = _SIGMA * spacing
        return cls(
            points=points,
            patches=patches,
            formulas=tuple(distinct),
            formula_of=np.array([number[formula] for formula in formulas]),
            mean=KernelMean.of(points, sigma, density_weights(points, sigma)),
            spacing=spacing,
            position_noise=position_noise,
            normal_noise=normal_noise,
            bounds=merged.bounds + margin * np.array([[-1.0], [1.0]]),
        )

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        values = np.empty(len(rows))
        for index in compact_blocks(rows, _BLOCK):
            values[index], _ = self._superpose(rows[index], with_gradient=False)
        return values.reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the exact gradient of f at points of shape (..., 3) [m], shape (..., 3).

        At an edge, where f has a kink, one of the one-sided gradients.
        """
        rows, shape = flat_points(points)
        gradients = np.empty((len(rows), 3))
        for index in compact_blocks(rows, _BLOCK):
            _, gradients[index] = self._superpose(rows[index], with_gradient=True)
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        Measured beforehand, not inferred from these contacts: at distance d from the nearest one,
        the root of the summed squares of the position noise, the normal noise times d, and a
        quarter of d^2 / spacing, the error made on simple solids without noise. Most of a surface
        is far better, the surroundings of a misread edge worse.
        """
        rows, shape = flat_points(points)
        distance = self.mean.distance(rows)
        shape_error = _SHAPE_ERROR * distance**2 / self.spacing
        return np.sqrt(
            self.position_noise**2 + (self.normal_noise * distance) ** 2 + shape_error**2
        ).reshape(shape)

    def _superpose(
        self, points: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return f, shape (P,), and its gradient, shape (P, 3), at points close together."""
        near, shares = self.mean.shares(points)
        used = sorted({int(k) for k in self.formula_of[near]})
        involved = sorted({p for k in used for piece in self.formulas[k] for p in piece})
        patches = {
            p: self.patches[p].evaluate(points, with_gradient=with_gradient) for p in involved
        }
        fields = {k: _apply(self.formulas[k], patches) for k in used}

        def local(node: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            values, gradients = fields[self.formula_of[node]]
            return values[seen], gradients[seen]

        return self.mean.superpose(points, near, shares, local, with_gradient=with_gradient)


def _patch(members: IndexArray, quadrics: LocalQuadrics, sigma: float) -> Patch:
    return Patch(members, quadrics, KernelMean.of(quadrics.points[members], sigma))


def _apply(
    formula: Formula, patches: dict[int, tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """Return min over pieces of max over patches, and the gradient of whichever it is."""
    value, gradient = _largest(formula[0], patches)
    for piece in formula[1:]:
        other, other_gradient = _largest(piece, patches)
        less = other < value
        value = np.where(less, other, value)
        gradient = np.where(less[:, None], other_gradient, gradient)
    return value, gradient


def _largest(
    piece: Piece, patches: dict[int, tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    value, gradient = patches[piece[0]]
    for p in piece[1:]:
        other, other_gradient = patches[p]
        more = other > value
        value = np.where(more, other, value)
        gradient = np.where(more[:, None], other_gradient, gradient)
    return value, gradient
