"""Local Implicit Surfaces, which keep edges sharp (Ottenhaus et al. 2016).

f(x) = sum_i w_i k(x, c_i) beta_i(x) y_i(x)  /  sum_i w_i k(x, c_i)        (eq. 7, normalised)

with the plane y_i of contact i, a weight w_i, a Gaussian kernel k and the convexity beta_i.
It has the zero set of eq. 7. The denominator, which is not in the paper, keeps values finite.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.guesses import with_advice
from lis_grasp.records import short_repr
from lis_grasp.surfaces._contact_noise import precisions_of
from lis_grasp.surfaces._kernel_mean import NEGLIGIBLE, KernelMean, density_weights
from lis_grasp.surfaces.contact_preparation import prepare_contacts
from lis_grasp.surfaces.queries import BlockwiseSurface, flat_points, require_range
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.underflow import methods_underflow

Beta = Literal["corrected", "as_published", "none"]

_BETA_SIGN: dict[Beta, float] = {"corrected": -1.0, "as_published": 1.0, "none": 0.0}

# Width of the kernel, in units of the contacts' spacing; smaller leaves steps, larger rounds edges.
_SIGMA = 0.2

# Error of the surface at distance d from the nearest contact, in units of d^2 / spacing. It bounds
# 70 % of the surface of eight fully explored solids (half explored: 63 %), twice as much 90 %.
_EXTRAPOLATION_ERROR = 0.27

# Nearer than this to a contact's axis, in heights above it, directions are rounding.
_ON_AXIS = 1e-14

# Bound of |beta*|: at 1, f between two exactly opposite contacts would be 0, a false surface.
MAX_CONVEXITY = 0.98

# Floor of the angular width, eq. 13, which otherwise underflows to 0 a few sigma off the plane.
_MIN_WIDTH = 1e-3

# A neighbour this near to a contact's normal (sine of the angle) has no direction in its plane.
_ABOVE = 1e-6


@methods_underflow
@dataclass(frozen=True, slots=True, eq=False)
class LocalImplicitSurface(BlockwiseSurface):
    """Kernel-weighted mean of the contacts' tangent planes, scaled by local convexity.

    Made by `from_contacts`. Values are not metric: beside a convex edge they are scaled by beta.

    References
    ----------
    S. Ottenhaus, M. Miller, D. Schiebener, N. Vahrenkamp, T. Asfour, "Local implicit surface
    estimation for haptic exploration", Humanoids 2016.

    Examples
    --------
    >>> surface = LocalImplicitSurface.from_contacts(contacts)
    >>> surface.gradient([0.0, 0.0, 0.03]).round(3)
    array([0., 0., 1.])
    """

    points: FloatArray  #: (N, 3) [m], contacts without duplicates, in O
    normals: FloatArray  #: (N, 3), unit, outward
    mean: KernelMean  #: the weights w_i and the kernel k
    convexity: Convexity | None  #: beta*_i of every contact, or None for beta = 1
    beta_sign: float  #: sign of sgn(y) beta* in eq. 10
    spacing: float  #: of the contacts [m]
    position_noise: FloatArray  #: (N,) [m], standard deviations of the contacts along their normals
    normal_noise: FloatArray  #: (N,) [rad], of each component of their normals
    bounds: FloatArray  #: (2, 3) [m]

    __repr__ = short_repr

    @classmethod
    @with_advice
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        sigma: float | None = None,
        beta: Beta = "corrected",
        position_noise: float | None = None,
        normal_noise: float | None = None,
    ) -> LocalImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Parameters
        ----------
        contacts, position_noise, normal_noise
            See `prepare_contacts`, also for errors. More precise contacts weigh more; equal noise
            changes the uncertainty, not the surface. Contacts are not thinned.
        sigma
            Width of the kernel [m]; None takes a fifth of the contacts' spacing.
        beta
            Convexity: "corrected" is 1 - sgn(y) beta*, our correction; "as_published" is eq. 10,
            1 + sgn(y) beta*; "none" is 1.

        Raises
        ------
        InvalidOptionError
            If an option is outside its range or set.
        """
        prepared = prepare_contacts(contacts, position_noise, normal_noise, most=None)
        spacing = prepared.spacing
        sigma = _SIGMA * spacing if sigma is None else sigma
        require_range("sigma", sigma, unit="m", above_zero=True)
        if beta not in _BETA_SIGN:
            raise InvalidOptionError.not_one_of("beta", beta, _BETA_SIGN)
        points, normals = prepared.contacts.points, prepared.contacts.normals
        precisions = precisions_of(prepared.position_noise, len(points))
        weights = density_weights(points, sigma) * precisions
        return cls(
            points=points,
            normals=normals,
            mean=KernelMean.of(points, sigma, weights),
            convexity=None if beta == "none" else Convexity.from_contacts(points, normals, sigma),
            beta_sign=_BETA_SIGN[beta],
            spacing=spacing,
            position_noise=prepared.position_noise,
            normal_noise=prepared.normal_noise,
            bounds=prepared.bounds,
        )

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        Calibrated on known solids, not inferred from these contacts: at distance d from the nearest
        contact, the root of the summed squares of the position noise, the normal noise times d, and
        0.27 d^2 / spacing, the error of planes on simple solids. Squares of noise are means over
        the contacts, with the weights of f.
        """
        rows, shape = flat_points(points)
        return np.sqrt(self._map(self._variance, rows)).reshape(shape)

    def _variance(self, points: FloatArray) -> FloatArray:
        """Return the variance of the surface, shape (P,) [m^2], at points close together."""
        contact, column, weights = self.mean.sparse_weights(points)
        distance = self.mean.distance(points)
        shape_error = _EXTRAPOLATION_ERROR * distance**2 / self.spacing
        position, normal = (
            np.bincount(column, weights * noise[contact] ** 2, len(points))
            for noise in (self.position_noise, self.normal_noise)
        )
        return np.asarray(position + normal * distance**2 + shape_error**2)

    def _value_and_gradient(
        self, points: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        contact, column, weights = self.mean.sparse_weights(points)  # (R,) each
        offsets = np.take(points, column, axis=0) - np.take(self.points, contact, axis=0)
        terms, gradients = self._local_shapes(contact, offsets, with_gradient=with_gradient)
        values = np.asarray(np.bincount(column, weights * terms, len(points)), np.float64)
        if not with_gradient:
            return values, points
        # The kernel's own gradient pulls f towards terms above it.
        gradients -= ((terms - values[column]) / self.mean.sigma**2)[:, None] * offsets
        gradients *= weights[:, None]
        sums = [np.bincount(column, each, len(points)) for each in gradients.T]
        return values, np.column_stack(sums)

    def _local_shapes(
        self, contact: IndexArray, offsets: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return beta_i y_i at offsets (R, 3) from contacts i, (R,), and gradients, (R, 3).

        Where beta jumps, the gradient is the mean of both sides.
        """
        normals = np.take(self.normals, contact, axis=0)
        heights = np.einsum("rk,rk->r", offsets, normals)  # y_i, eq. 8
        if self.convexity is None:
            return heights, normals
        projected = offsets - heights[:, None] * normals
        radii = np.sqrt(np.einsum("rk,rk->r", projected, projected))
        directions = projected / np.maximum(radii, np.finfo(float).tiny)[:, None]  # phi_i(x)
        convexities, slopes = self.convexity.evaluate(
            contact, directions, with_slopes=with_gradient
        )
        signs = self.beta_sign * np.sign(heights)
        betas = 1.0 + signs * convexities  # eq. 10
        if not with_gradient:
            return betas * heights, offsets
        slopes -= np.einsum("rk,rk->r", slopes, directions)[:, None] * directions
        # On the axis, to rounding, there is no direction and no slope towards any.
        beside = radii > _ON_AXIS * np.abs(heights)
        slopes *= np.divide(signs * heights, radii, out=np.zeros_like(radii), where=beside)[:, None]
        return betas * heights, betas[:, None] * normals + slopes


@dataclass(frozen=True, slots=True, eq=False)
class Convexity:
    """beta*_i(phi) of every contact: -1 convex, 0 flat, 1 concave, towards the direction phi.

    Local convexity of Ottenhaus et al. 2016, eqs. 11 to 15.

    The angle phi enters eqs. 11 and 15 through its cosine only, sin^2(phi / 2) = (1 - cos phi) / 2,
    and the cosine is the product of two unit vectors in the contact's tangent plane. So no local
    axes are needed and no angle is computed.
    """

    # (N + 1,): contact i owns the rows starts[i]:starts[i + 1] below, one for each neighbour j
    starts: IndexArray
    # (P, 3), unit: from c_i to c_j in the tangent plane of i; 0 if c_j is straight above or below
    directions: FloatArray
    log_heights: FloatArray  # (P,) log sigma_h of eq. 12
    # (P,) 1 / (4 sigma_w^2) of eq. 13: the kernel is exp(-sharpness (1 - cos phi))
    sharpness: FloatArray
    sines: FloatArray  # (P,) sin(alpha_ij)

    @classmethod
    def from_contacts(cls, points: FloatArray, normals: FloatArray, sigma: float) -> Convexity:
        """Prepare every pair of contacts that is not negligible; shapes (N, 3), sigma in metres."""
        owners, others = _visible_pairs(points, normals, sigma)
        offsets = points[others] - points[owners]  # (P, 3)
        distances = np.linalg.norm(offsets, axis=1)
        heights = np.einsum("pk,pk->p", offsets, normals[owners])  # y_i(c_j), eq. 8
        projected = offsets - heights[:, None] * normals[owners]
        lengths = np.linalg.norm(projected, axis=1)
        on_axis = lengths <= _ABOVE * distances
        return cls(
            starts=np.searchsorted(owners, np.arange(len(points) + 1)),
            directions=np.where(on_axis, 0.0, projected.T / np.where(on_axis, 1.0, lengths)).T,
            log_heights=-0.5 * (distances / sigma) ** 2,
            # Straight above: the same height in every direction.
            sharpness=np.where(on_axis, 0.0, _sharpness(heights, sigma)),
            sines=np.clip(heights / distances, -1.0, 1.0),
        )

    def evaluate(
        self, contacts: npt.ArrayLike, directions: FloatArray, *, with_slopes: bool = True
    ) -> tuple[FloatArray, FloatArray]:
        """Return beta* of contacts, shape (R,), and its slopes by direction, shape (R, 3).

        Eq. 15, clamped to the open interval (-1, 1), of one contact or (R,), towards unit
        directions (R, 3) in the tangent planes of the contacts.
        """
        values, slopes = np.zeros(len(directions)), np.zeros_like(directions)
        contacts = np.broadcast_to(np.asarray(contacts, dtype=np.intp), len(directions))
        counts = self.starts[contacts + 1] - self.starts[contacts]
        known = np.flatnonzero(counts)  # a lone contact is flat
        if not len(known):
            return values, slopes
        counts = counts[known]
        begins = np.cumsum(counts) - counts  # of each contact's terms
        owner = np.repeat(np.arange(len(known)), counts)  # (T,)
        rows = np.arange(len(owner)) + (self.starts[contacts[known]] - begins)[owner]
        pulls = np.take(self.sharpness[:, None] * self.directions, rows, axis=0)  # (T, 3)
        terms = np.einsum("tk,tk->t", pulls, np.take(directions, known[owner], axis=0))
        terms += (self.log_heights - self.sharpness)[rows]  # log of eq. 11
        terms -= np.maximum.reduceat(terms, begins)[owner]
        np.exp(terms, out=terms)
        terms /= np.add.reduceat(terms, begins)[owner]
        sines = self.sines[rows]
        means = np.add.reduceat(terms * sines, begins)  # eq. 15
        if with_slopes:
            pulls *= (terms * (sines - means[owner]))[:, None]
            free = np.abs(means) < MAX_CONVEXITY
            slopes[known] = np.where(free[:, None], np.add.reduceat(pulls, begins, axis=0), 0.0)
        values[known] = np.clip(means, -MAX_CONVEXITY, MAX_CONVEXITY)
        return values, slopes


def _sharpness(heights: FloatArray, sigma: float) -> FloatArray:
    """Return 1 / (4 sigma_w^2) of eq. 13."""
    return 0.25 / np.maximum(np.exp(-0.5 * (heights / sigma) ** 2), _MIN_WIDTH) ** 2


def _visible_pairs(
    points: FloatArray, normals: FloatArray, sigma: float
) -> tuple[IndexArray, IndexArray]:
    """Return contacts i and neighbours j, ordered, whose kernel (eq. 11) is not negligible.

    In any direction the logarithm of eq. 11 is between log sigma_h - 2 sharpness and log sigma_h.
    A neighbour whose upper limit is far below another one's lower limit is negligible. The upper
    limit falls with distance: a few nearest neighbours often suffice, or else more are queried.
    """
    tree = cKDTree(points)
    owners, others = [np.empty(0, np.intp)], [np.empty(0, np.intp)]
    pending = np.arange(len(points))
    neighbors = min(48, len(points) - 1)
    while len(pending):
        distances, index = tree.query(points[pending], k=np.arange(1, neighbors + 2))
        heights = np.einsum("ijk,ik->ij", points[index] - points[pending, None], normals[pending])
        upper = -0.5 * (distances / sigma) ** 2
        # Contacts that coincide have no angle between them.
        lower = np.where(distances > 0.0, upper - 2.0 * _sharpness(heights, sigma), -np.inf)
        visible = lower.max(axis=1) - NEGLIGIBLE
        done = (upper[:, -1] < visible) | (neighbors == len(points) - 1)
        row, column = np.nonzero((distances > 0.0) & (upper >= visible[:, None]) & done[:, None])
        owners.append(pending[row])
        others.append(index[row, column])
        pending = pending[~done]
        neighbors = min(4 * neighbors, len(points) - 1)
    i, j = np.concatenate(owners), np.concatenate(others)
    order = np.lexsort((j, i))
    return i[order], j[order]
