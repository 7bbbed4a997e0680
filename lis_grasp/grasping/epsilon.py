"""Epsilon (Ferrari-Canny) grasp quality: the largest ball of wrenches that contacts resist.

Two algorithms give it: `epsilon_by_convex_hull` is exact and takes one grasp,
`epsilon_by_expanding_polytope` is faster and takes many.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import ConvexHull, QhullError

from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.grasping._expanding_polytope import inscribed_ball_radii
from lis_grasp.grasping.contact_wrenches import CONE_EDGES, ContactModel, WrenchModel, wrench_model
from lis_grasp.guesses import with_advice
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray, IndexArray

ROBUST_FRACTION = 0.5
"""Fraction of the friction in robust qualities: normals are known to a few degrees only."""

# Wrenches are of order 1; a hull flatter than this in some direction resists nothing along it.
_FLAT = 1e-9


@with_advice
def epsilon_quality(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    origin: npt.ArrayLike | None = None,
    length_scale: float | None = None,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int = CONE_EDGES,
) -> float:
    """Return the Ferrari-Canny quality: the radius of the largest ball of resisted wrenches.

    Epsilon is 0 without force closure. The metric is L1.

    Parameters
    ----------
    points, normals
        Shape (C, 3) [m] and unit, OUTWARD of the object (as in `Contacts`).
    friction
        Coulomb coefficient.
    origin
        Shape (3,) [m]: reference point of torques; None for the centroid of the points.
    length_scale
        Divisor of torques [m]; None for the largest distance of a point from the origin.
    model, torsion, edges
        Contact model, torsion [m] of soft fingers and edges of the friction pyramid; see
        `WrenchModel`.

    Raises
    ------
    InvalidContactsError
        If points and normals are not (C, 3) with C >= 1, or not finite.
    InvalidOptionError
        If another argument is out of range.

    References
    ----------
    C. Ferrari and J. Canny, "Planning optimal grasps", ICRA 1992.

    Examples
    --------
    >>> 0.2 < epsilon_quality(contacts.points, contacts.normals, friction=0.5) < 0.6
    True
    """
    wrench_model = WrenchModel(friction, model, torsion, origin, length_scale, edges)
    return epsilon_by_convex_hull(points, normals, wrench_model)


def epsilon_by_convex_hull(
    points: npt.ArrayLike, normals: npt.ArrayLike, model: WrenchModel
) -> float:
    """Return epsilon of one grasp's contacts (C, 3), exactly, by the hull of their wrenches."""
    wrenches = model.wrenches_of_grasp(points, normals)
    if not span_all_dimensions(wrenches):
        return 0.0
    try:
        hull = ConvexHull(wrenches)
    except QhullError:
        # Merging coplanar points of symmetric contacts can fail: joggle by some 1e-11, repeatably.
        hull = ConvexHull(wrenches, qhull_options="QJ")
    # A facet is {x : n x + d <= 0} with unit n, so the origin is at depth -d inside it.
    return float(max(-hull.equations[:, -1].max(), 0.0))


def epsilon_by_expanding_polytope(
    points: npt.ArrayLike, normals: npt.ArrayLike, model: WrenchModel, *, tolerance: float = 0.0
) -> FloatArray:
    """Return epsilon of many grasps at once, several times faster than hull by hull.

    The result differs from `epsilon_by_convex_hull` by some millionths; below 0.0001 it may be 0.

    Parameters
    ----------
    points, normals, model
        Shape (B, C, 3): grasps of equally many contacts [m], and unit, outward of the object; and
        the contacts' model.
    tolerance
        Fraction of epsilon by which the result (B,) may be too small. With 0.05 it takes 7 % less
        time, and is mostly off by less than a hundredth.
    """
    wrenches = model.wrenches(points, normals)  # (B, C, K, 6)
    if wrenches.ndim != 4:
        raise InvalidContactsError(
            f"grasps must be of shape (B, C, 3); it is {np.shape(points)}", field="points"
        )

    return epsilon_of_wrenches(wrenches, tolerance=tolerance)


def epsilon_of_wrenches(wrenches: FloatArray, *, tolerance: float = 0.0) -> FloatArray:
    """Return epsilon (B,) of the primitive wrenches (B, C, K, 6) of grasps.

    See `epsilon_by_expanding_polytope`.
    """
    hulls = wrenches.reshape(len(wrenches), wrenches.shape[1] * wrenches.shape[2], 6)

    def farthest(directions: FloatArray, grasps: IndexArray) -> FloatArray:
        own = hulls[grasps]  # (b, C K, 6)
        chosen = (own @ directions[:, :, None])[..., 0].argmax(axis=1)
        return own[np.arange(len(own)), chosen]

    return inscribed_ball_radii(farthest, len(hulls), tolerance=tolerance)


def span_all_dimensions(wrenches: FloatArray) -> bool:
    """Return whether the hull of wrenches (K, 6) has a volume."""
    flatness = _FLAT * np.sqrt(len(wrenches))
    centered = wrenches - wrenches.mean(axis=0)
    return bool(np.linalg.matrix_rank(centered, tol=flatness) == 6)


def epsilon_on(
    mesh: trimesh.Trimesh, hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float
) -> float:
    """Return epsilon of a hand's contacts (C, 3) on an object, by `wrench_model`."""
    return epsilon_by_convex_hull(points, normals, wrench_model(mesh, hand, friction))


def robust_epsilon_on(
    mesh: trimesh.Trimesh, hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float
) -> float:
    """Return ``epsilon_robust`` of a hand's contacts (C, 3) on an object.

    It predicts a lift from measured contacts: of 186 lifts, planned on 5 to 15 touches, 137 of the
    147 with more than zero of it held, and 10 of the 39 others.
    """
    return epsilon_on(mesh, hand, points, normals, friction=ROBUST_FRACTION * friction)
