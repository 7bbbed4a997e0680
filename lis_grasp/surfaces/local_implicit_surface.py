"""Local Implicit Surfaces: the paper's estimator, which keeps edges sharp (Ottenhaus et al. 2016)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import merge_duplicates, spacing_of
from lis_grasp.surfaces.contact_weights import density_weights, voronoi_weights
from lis_grasp.surfaces.convexity import NEGLIGIBLE, Convexity
from lis_grasp.surfaces.queries import (
    compact_blocks,
    flat_points,
    require_choice,
    require_contacts,
    require_range,
)

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]

Weights = Literal["voronoi", "density"]
Beta = Literal["mended", "printed", "none"]

_BETA_SIGN = {"mended": -1.0, "printed": 1.0, "none": 0.0}

# Width of the kernel, in units of the contacts' spacing: 0.2 to 0.3 are equally good.
_SIGMA = 0.25

# Position error between contacts, in units of d^2 / spacing at distance d from the nearest contact.
_EXTRAPOLATION_ERROR = 0.3

_BLOCK = 2048


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
    weights
        Shape (N,), w_i.
    convexity
        beta*_i of every contact, or None for beta = 1.
    beta_sign
        Sign of sgn(y) beta* in eq. 10.
    sigma
        Width of the kernel [m].
    spacing
        Of the contacts [m].
    position_noise, normal_noise
        One standard deviation of a contact's position along its normal [m] and of its normal [rad].
    bounds
        Shape (2, 3) [m].

    References
    ----------
    S. Ottenhaus, M. Miller, D. Schiebener, N. Vahrenkamp, T. Asfour, "Local implicit surface
    estimation for haptic exploration", Humanoids 2016.
    """

    points: FloatArray
    normals: FloatArray
    weights: FloatArray
    convexity: Convexity | None
    beta_sign: float
    sigma: float
    spacing: float
    position_noise: float
    normal_noise: float
    bounds: FloatArray
    _tree: cKDTree

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        sigma: float | None = None,
        weights: Weights = "density",
        beta: Beta = "mended",
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
            Width of the kernel [m]; None takes a quarter of the contacts' spacing.
        weights
            w_i: "voronoi", eq. 9 with cells clipped to a ball of one spacing, or "density",
            1 / sum_j k(c_i, c_j), which is cheaper and about as good.
        beta
            Convexity: "mended" is 1 - sgn(y) beta*, "printed" is eq. 10 to the letter, with a plus,
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
        merged = merge_duplicates(contacts)
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
            weights=(
                voronoi_weights(points, radius=spacing)
                if weights == "voronoi"
                else density_weights(points, sigma)
            ),
            convexity=None if beta == "none" else Convexity.from_contacts(points, normals, sigma),
            beta_sign=_BETA_SIGN[beta],
            sigma=float(sigma),
            spacing=spacing,
            position_noise=require_range("position_noise", position_noise, 0.0, unit="m"),
            normal_noise=require_range("normal_noise", normal_noise, 0.0, unit="rad"),
            bounds=merged.bounds + margin * np.array([[-1.0], [1.0]]),
            _tree=cKDTree(points),
        )

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): negative inside, 0 on the surface."""
        rows, shape = flat_points(points)
        values = np.empty(len(rows))
        for index in compact_blocks(rows, _BLOCK):
            values[index], _ = self._superpose(rows[index], with_gradient=False)
        return values.reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the exact gradient of f at points of shape (..., 3) [m], shape (..., 3).

        On the plane of a contact, where its share of f has a kink (eq. 10), the two one-sided
        gradients are averaged.
        """
        rows, shape = flat_points(points)
        gradients = np.empty((len(rows), 3))
        for index in compact_blocks(rows, _BLOCK):
            _, gradients[index] = self._superpose(rows[index], with_gradient=True)
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        A heuristic, not inferred from the contacts: at distance d from the nearest contact, the
        root of the summed squares of the position noise, the normal noise times d, and 0.3 d^2 /
        spacing for the shape between contacts (d / spacing beyond one spacing, where nothing is
        known). The 0.3 was measured on simple solids touched about a quarter of their size apart.
        """
        rows, shape = flat_points(points)
        distance, _ = self._tree.query(rows)
        shape_error = _EXTRAPOLATION_ERROR * distance**2 / self.spacing
        return np.sqrt(
            self.position_noise**2 + (self.normal_noise * distance) ** 2 + shape_error**2
        ).reshape(shape)

    def _superpose(self, points: FloatArray, *, with_gradient: bool) -> tuple[FloatArray, FloatArray]:
        """Return f, shape (P,), and its gradient, shape (P, 3), at points that lie close together."""
        near = self._contacts_near(points)
        shares = self._shares(points, near)  # (M, P)
        values = np.zeros(len(points))
        gradients = np.zeros((len(points), 3))
        pulls = np.zeros((len(points), 3))
        for i, share in zip(near, shares, strict=True):
            seen = np.flatnonzero(share > np.exp(-NEGLIGIBLE))
            if not len(seen):
                continue
            share = share[seen]
            offsets = points[seen] - self.points[i]
            summand, slope = self._local_shape(i, offsets, with_gradient=with_gradient)
            values[seen] += share * summand
            if with_gradient:
                # d/dx of a kernel-weighted mean: the shares move, grad s_i = -s_i (x - c_i - mean)/sigma^2
                gradients[seen] += share[:, None] * (slope - summand[:, None] * offsets / self.sigma**2)
                pulls[seen] += share[:, None] * offsets / self.sigma**2
        return values, gradients + values[:, None] * pulls

    def _contacts_near(self, points: FloatArray) -> IndexArray:
        """Return the contacts whose kernel can be seen at some of the points.

        Relative to the nearest contact's, always: a far point still has a value. At a distance d
        from its nearest contact a point sees those up to sqrt(d^2 + reach^2).
        """
        center = 0.5 * (points.min(axis=0) + points.max(axis=0))
        radius = np.linalg.norm(points - center, axis=1).max()
        nearest = self._tree.query(center)[0] + radius
        spread = np.log(self.weights.max() / self.weights.min())
        reach = self.sigma * np.sqrt(2.0 * (NEGLIGIBLE + spread))
        far = radius + np.hypot(nearest, reach)
        return np.sort(self._tree.query_ball_point(center, far * (1.0 + 1e-9))).astype(np.intp)

    def _shares(self, points: FloatArray, near: IndexArray) -> FloatArray:
        """Return w_i k(x, c_i) / sum_j w_j k(x, c_j), shape (M, P), without underflow."""
        origin = points[0]
        contacts, points = self.points[near] - origin, points - origin
        exponents = contacts @ points.T  # (M, P): of eq. 6, but for a term that is common to all i
        exponents -= 0.5 * np.sum(contacts**2, axis=1)[:, None]
        exponents /= self.sigma**2
        exponents += np.log(self.weights[near])[:, None]
        exponents -= exponents.max(axis=0)
        np.exp(exponents, out=exponents)
        exponents /= exponents.sum(axis=0)
        return exponents

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
        slopes *= (signs * heights / np.maximum(radii, np.finfo(float).tiny))[:, None]
        return betas * heights, betas[:, None] * normal + slopes
