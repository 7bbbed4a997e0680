"""Local Implicit Surfaces, which keep edges sharp (Ottenhaus et al. 2016)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import merge_duplicates, spacing_of
from lis_grasp.surfaces.contact_weights import density_weights, voronoi_weights
from lis_grasp.surfaces.convexity import Convexity
from lis_grasp.surfaces.kernel_mean import KernelMean
from lis_grasp.surfaces.queries import (
    flat_points,
    map_blocks,
    require_choice,
    require_contacts,
    require_range,
)
from lis_grasp.typing import FloatArray, IndexArray

Weights = Literal["voronoi", "density"]
Beta = Literal["corrected", "as_published", "none"]

_BETA_SIGN = {"corrected": -1.0, "as_published": 1.0, "none": 0.0}

# Width of the kernel, in units of the contacts' spacing; smaller leaves steps, larger rounds edges.
_SIGMA = 0.2

# Error of the surface at distance d from the nearest contact, in units of d^2 / spacing, that holds
# for 70 % of the surface, on eight solids fully explored, with noise and without; 90 % lie within
# twice as much. Half explored, 63 % and 86 % do.
_EXTRAPOLATION_ERROR = 0.27

# Points evaluated at once: so many, in a box no larger than this many spacings.
_BLOCK, _BLOCK_EXTENT = 4096, 8.0

# Nearer than this to a contact's axis, as a part of the height above it, directions are rounding.
_ON_AXIS = 1e-14


@dataclass(frozen=True, slots=True, eq=False)
class LocalImplicitSurface:
    """The surface that contacts' tangent planes form, each bent to the side its neighbours lie on.

    f(x) = sum_i w_i k(x, c_i) beta_i(x) y_i(x)  /  sum_i w_i k(x, c_i)        (eq. 7, normalised)

    with the plane y_i of contact i, a weight w_i, a Gaussian kernel k and the convexity beta_i.
    The zero set is that of eq. 7; the denominator, not in the paper, keeps values finite and
    distance-like everywhere, where eq. 7 is exactly 0 a dozen sigma away from the last contact.
    A surface is extrapolated without end; `bounds` says how far it is meant.

    Made by `from_contacts`. Values are not metric: beside a convex edge they are scaled by beta.

    Parameters
    ----------
    points
        Shape (N, 3) [m], contacts without duplicates, in O.
    normals
        Shape (N, 3), unit, outward.
    mean
        The weights w_i and the kernel k.
    convexity
        beta*_i of every contact, or None for beta = 1.
    beta_sign
        Sign of sgn(y) beta* in eq. 10.
    spacing
        Of the contacts [m].
    position_noise, normal_noise
        One standard deviation of a contact's position along its normal [m] and of its normal [rad].
    bounds
        Shape (2, 3) [m].
    remake
        `from_contacts` with the options that this surface was made with.

    References
    ----------
    S. Ottenhaus, M. Miller, D. Schiebener, N. Vahrenkamp, T. Asfour, "Local implicit surface
    estimation for haptic exploration", Humanoids 2016.
    """

    points: FloatArray
    normals: FloatArray
    mean: KernelMean
    convexity: Convexity | None
    beta_sign: float
    spacing: float
    position_noise: float
    normal_noise: float
    bounds: FloatArray
    remake: Callable[[Contacts], LocalImplicitSurface]

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        sigma: float | None = None,
        weights: Weights = "density",
        beta: Beta = "corrected",
        position_noise: float = 0.0,
        normal_noise: float = 0.0,
        margin: float | None = None,
    ) -> LocalImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Parameters
        ----------
        contacts
            Where the object was touched; duplicates are merged first.
        sigma
            Width of the kernel [m]; None takes a fifth of the contacts' spacing.
        weights
            w_i: "voronoi", eq. 9 with cells clipped to a ball of one spacing, or "density",
            1 / sum_j k(c_i, c_j), which is cheaper and about as good.
        beta
            Convexity: "corrected" is 1 - sgn(y) beta*; "as_published" is eq. 10 with its plus sign,
            which grows the wrong side of every edge (a convex edge is the maximum of its planes, so
            the outside must win there), "none" is 1.
        position_noise, normal_noise
            One standard deviation of the contacts' positions along the normal [m] and of their
            normals [rad]. They do not change the surface, they enter its uncertainty.
        margin
            By how much bounds exceed the contacts' box [m]; None takes one spacing.

        Raises
        ------
        InvalidContactsError
            If there is no contact.
        InvalidOptionError
            If an option is outside its range or set.
        """
        require_contacts(contacts)
        remake = partial(
            cls.from_contacts,
            sigma=sigma,
            weights=weights,
            beta=beta,
            position_noise=position_noise,
            normal_noise=normal_noise,
            margin=margin,
        )
        merged = merge_duplicates(contacts, position_noise)
        spacing = spacing_of(merged)
        if sigma is None:
            sigma = _SIGMA * spacing
        require_range("sigma", sigma, 0.0, unit="m", low_included=False)
        require_choice("weights", weights, get_args(Weights))
        require_choice("beta", beta, get_args(Beta))
        margin = spacing if margin is None else require_range("margin", margin, 0.0, unit="m")
        points, normals = merged.points, merged.normals
        return cls(
            points=points,
            normals=normals,
            mean=KernelMean.of(
                points,
                sigma,
                voronoi_weights(points, radius=spacing)
                if weights == "voronoi"
                else density_weights(points, sigma),
            ),
            convexity=None if beta == "none" else Convexity.from_contacts(points, normals, sigma),
            beta_sign=_BETA_SIGN[beta],
            spacing=spacing,
            position_noise=require_range("position_noise", position_noise, 0.0, unit="m"),
            normal_noise=require_range("normal_noise", normal_noise, 0.0, unit="rad"),
            bounds=merged.bounds + margin * np.array([[-1.0], [1.0]]),
            remake=remake,
        )

    def with_contacts(self, new: Contacts) -> LocalImplicitSurface:
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

        On the plane of a contact, where its share of f has a kink (eq. 10), the two one-sided
        gradients are averaged.
        """
        rows, shape = flat_points(points)
        gradients = map_blocks(
            lambda x: self._superpose(x, with_gradient=True)[1], rows, *self._blocks, (3,)
        )
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        Measured beforehand, not inferred from these contacts: at distance d from the nearest one,
        the root of the summed squares of the position noise, the normal noise times d, and 0.27
        d^2 / spacing, the error that planes make on simple solids.
        """
        rows, shape = flat_points(points)
        distance = self.mean.distance(rows)
        shape_error = _EXTRAPOLATION_ERROR * distance**2 / self.spacing
        return np.sqrt(
            self.position_noise**2 + (self.normal_noise * distance) ** 2 + shape_error**2
        ).reshape(shape)

    @property
    def _blocks(self) -> tuple[int, float]:
        return _BLOCK, _BLOCK_EXTENT * self.spacing

    def _superpose(
        self, points: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return f, shape (P,), and its gradient, shape (P, 3), at points close together."""

        def local(i: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            offsets = points[seen] - self.points[i]
            return self._local_shape(i, offsets, with_gradient=with_gradient)

        near, shares = self.mean.shares(points)
        return self.mean.superpose(points, near, shares, local, with_gradient=with_gradient)

    def _local_shape(
        self, i: int, offsets: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return beta_i y_i at offsets from contact i, shape (R, 3), and its gradient."""
        normal = self.normals[i]
        heights = offsets @ normal  # y_i, eq. 8
        if self.convexity is None:
            return heights, np.broadcast_to(normal, offsets.shape)
        projected = offsets - heights[:, None] * normal
        radii = np.linalg.norm(projected, axis=1)
        directions = projected / np.maximum(radii, np.finfo(float).tiny)[:, None]  # phi_i(x)
        convexities, slopes = self.convexity.evaluate(i, directions)
        signs = self.beta_sign * np.sign(heights)
        betas = 1.0 + signs * convexities  # eq. 10
        if not with_gradient:
            return betas * heights, offsets
        slopes -= np.einsum("rk,rk->r", slopes, directions)[:, None] * directions
        # On the axis, to rounding, there is no direction and no slope towards any.
        beside = radii > _ON_AXIS * np.abs(heights)
        slopes *= np.divide(signs * heights, radii, out=np.zeros_like(radii), where=beside)[:, None]
        return betas * heights, betas[:, None] * normal + slopes
