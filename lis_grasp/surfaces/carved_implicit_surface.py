"""An estimate without what contradicts free space: where the hand passed, there is no object."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.surfaces.queries import flat_points, map_rows, require_range
from lis_grasp.typing import FloatArray, IndexArray

# Points of a ball at which an estimate is asked: its centre, and on its surface towards the faces
# and the corners of a cube. A cap that none of them is in is lower than a fifth of the radius.
_FACES = np.vstack([np.eye(3), -np.eye(3)])
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3))) / np.sqrt(3.0)
_PLACES = np.vstack([np.zeros((1, 3)), _FACES, _CORNERS])  # (15, 3)

# A ball whose centre is this many radii outside of the estimate, by its values, is not asked for
# more: near its zero set an estimate is about a distance.
_FAR = 1.5

# Pairs of points and balls that are looked at together.
_PAIRS = 2**20


@dataclass(frozen=True, slots=True, eq=False)
class CarvedImplicitSurface:
    """An estimate with balls of free space taken out of it.

    f = max(g, max_i (r_i - |x - c_i|))

    with the estimate g and balls of centres c_i and radii r_i: the difference of two solids. It is
    outside wherever g is, and besides in every ball; where no ball is, it is g. Where the balls are
    free in truth, it is wrong about no point of space that g is right about. Made by `carved`.

    Parameters
    ----------
    surface
        The estimate g.
    centers, radii
        Shapes (K, 3) [m] in O, and (K,) [m]; at least one.
    """

    surface: ImplicitSurface
    centers: FloatArray
    radii: FloatArray

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is meant, shape (2, 3) [m]."""
        return self.surface.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        values = np.array(self.surface.evaluate(rows))
        asked, depths, _ = self._depths(rows, values)
        values[asked] = np.maximum(values[asked], depths)
        return values.reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3): outward."""
        rows, shape = flat_points(points)
        values, gradients = self.surface.evaluate(rows), np.array(self.surface.gradient(rows))
        asked, depths, ball = self._depths(rows, values)
        deeper = depths > values[asked]
        asked, ball = asked[deeper], ball[deeper]
        towards = self.centers[ball] - rows[asked]
        length = np.linalg.norm(towards, axis=1, keepdims=True)
        gradients[asked] = towards / np.maximum(length, np.finfo(np.float64).tiny)
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The estimate's own; where it is carved, together with how deep inside it the point is: by as
        much it is known to be wrong there.
        """
        rows, shape = flat_points(points)
        values, deviations = self.surface.evaluate(rows), np.array(self.surface.uncertainty(rows))
        asked, depths, _ = self._depths(rows, values)
        carved = asked[depths > values[asked]]
        deviations[carved] = np.hypot(deviations[carved], np.minimum(values[carved], 0.0))
        return deviations.reshape(shape)

    def _depths(
        self, points: FloatArray, values: FloatArray
    ) -> tuple[IndexArray, FloatArray, IndexArray]:
        """Return which points may be in a ball, how deep, and in which, three of shape (A,)."""
        asked = np.flatnonzero(values < self.radii.max())  # no depth is more

        def deepest(chosen: FloatArray) -> FloatArray:
            depths = self.radii - cdist(chosen, self.centers)  # (A, K)
            ball = np.argmax(depths, axis=1)
            return np.column_stack([depths[np.arange(len(chosen)), ball], ball])

        found = map_rows(deepest, points[asked], max(1, _PAIRS // len(self.radii)))
        return asked, found[:, 0], found[:, 1].astype(np.intp)


def uncarved(surface: ImplicitSurface) -> ImplicitSurface:
    """Return the estimate that free space was carved off, or the surface itself."""
    return surface.surface if isinstance(surface, CarvedImplicitSurface) else surface


def carved(
    surface: ImplicitSurface, contacts: Contacts, *, margin: float = 0.0, growth: float = 1.0
) -> ImplicitSurface:
    """Return an estimate without what contradicts the free space of its contacts.

    Only balls that the estimate reaches into are kept; where there is none, the estimate itself is
    returned. A ball never reaches beyond the contact that is nearest to its centre, so every
    contact of the surface stays on it.

    Where a hand passed deep inside the estimate, the estimate is wrong by more than the hand's
    width: a tunnel through a plug that is not there leaves a plug with a tunnel. So such a ball
    grows, by as much as its centre is inside, but no farther than halfway to the nearest contact:
    between what is known to be free and what is known to be surface the middle is as good a guess
    as any. Without growth only what is certain is carved off.

    Parameters
    ----------
    surface
        Estimated from the contacts, by whatever estimator.
    contacts
        With balls of free space (`Contacts.free_points`, `Contacts.free_radii`).
    margin
        By how much balls are made smaller [m]: two standard deviations of where the hand is known
        to be, say. Of balls with no more room than that nothing is known.
    growth
        How much a ball grows, in depths of its centre inside the estimate; 0 for not at all.

    Raises
    ------
    InvalidOptionError
        If the margin or the growth is negative or not finite.
    """
    require_range("margin", margin, 0.0, unit="m")
    require_range("growth", growth, 0.0)
    centers, radii = contacts.free_points, contacts.free_radii - margin
    low, high = surface.bounds
    reaches = (radii > 0.0) & np.all((centers + radii[:, None] > low), axis=1)
    reaches &= np.all(centers - radii[:, None] < high, axis=1)
    centers, radii = centers[reaches], radii[reaches]
    nearest = _to_nearest(contacts, centers)
    radii = np.minimum(radii, nearest)
    values = surface.evaluate(centers)
    near = np.flatnonzero(values < _FAR * radii)
    places = centers[near, None] + radii[near, None, None] * _PLACES  # (B, 15, 3)
    kept = near[(surface.evaluate(places) < 0.0).any(axis=1)]
    if not len(kept):
        return surface
    grown = np.minimum(radii - growth * values, 0.5 * (radii + nearest))[kept]
    return CarvedImplicitSurface(surface, centers[kept], np.maximum(grown, radii[kept]))


def _to_nearest(contacts: Contacts, centers: FloatArray) -> FloatArray:
    """Return the distance from each centre to the nearest contact, shape (K,) [m]."""
    if not len(contacts) or not len(centers):
        return np.full(len(centers), np.inf)
    return np.asarray(cKDTree(contacts.points).query(centers)[0])
