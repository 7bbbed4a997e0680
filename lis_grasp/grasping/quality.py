"""How good a grasp is: the wrenches that its contacts resist, measured in the usual ways.

Frictional wrenches and their hulls are those of `contact_model`; forces act on the object, torques
are divided by a length so that all six parts are forces.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError
from lis_grasp.grasping.contact_cones import contact_cones
from lis_grasp.grasping.contact_model import CONE_EDGES, ContactModel
from lis_grasp.grasping.grasp_contacts import (
    checked_contacts,
    frame_of,
    one_grasp,
    primitive_wrenches,
)
from lis_grasp.grasping.inscribed_ball import inner_radii
from lis_grasp.typing import FloatArray, IndexArray

ForceLimit = Literal["sum", "each"]
"""What is bounded by 1: the sum of the normal forces (L1), or each of them (L-infinity)."""

# Wrenches are of order 1; a hull flatter than this in some direction resists nothing along it.
_FLAT = 1e-9
# How near to round cones' epsilon the result is.
_ROUND_TOLERANCE = 1e-3


def epsilon_quality(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    origin: npt.ArrayLike | None = None,
    length_scale: float | None = None,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int | None = CONE_EDGES,
    limit: ForceLimit = "sum",
) -> float:
    """Return the Ferrari-Canny quality: the radius of the largest ball of resisted wrenches.

    The grasp wrench space is what contacts can resist whose normal forces sum to 1 (the convex hull
    of all primitive wrenches, the L1 metric), or are 1 at the most each (the Minkowski sum of the
    contacts' own hulls, L-infinity). Epsilon is the distance from the origin to its border, and 0
    where the origin is not inside.

    Parameters
    ----------
    points, normals
        Shape (C, 3) [m] and unit, OUTWARD of the object (as in `Contacts`).
    friction
        Coulomb coefficient.
    origin
        Shape (3,) [m]: where torques are taken about; None for the centroid of the points. The
        object's centre of mass is the usual choice where it is known.
    length_scale
        [m] What torques are divided by; None for the largest distance of a point from the origin.
    model, torsion
        See `contact_wrenches`.
    edges
        Of the pyramids that stand for cones; None for round cones, to a thousandth.
    limit
        On the normal forces: ``"sum"`` or ``"each"``.

    Raises
    ------
    InvalidContactsError
        If points and normals are not (C, 3) with C >= 1, or not finite.

    References
    ----------
    C. Ferrari and J. Canny, "Planning optimal grasps", ICRA 1992.
    """
    if edges is None or limit != "sum":
        points, normals = one_grasp(points, normals)
        return float(
            epsilon_qualities(
                points[None],
                normals[None],
                friction=friction,
                origin=origin,
                length_scale=length_scale,
                model=model,
                torsion=torsion,
                edges=edges,
                limit=limit,
            )[0]
        )
    wrenches = primitive_wrenches(
        points,
        normals,
        friction=friction,
        origin=origin,
        length_scale=length_scale,
        model=model,
        torsion=torsion,
        edges=edges,
    )
    hull = _hull(wrenches)
    # A facet is {x : n x + d <= 0} with unit n, so the origin is at depth -d inside it.
    return 0.0 if hull is None else float(max(-hull.equations[:, -1].max(), 0.0))


def epsilon_qualities(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    origin: npt.ArrayLike | None = None,
    length_scale: npt.ArrayLike | None = None,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int | None = CONE_EDGES,
    limit: ForceLimit = "sum",
    tolerance: float = 0.0,
) -> FloatArray:
    """Return the epsilon of many grasps at once, several times as fast as one after the other.

    `epsilon_quality` by expanding polytopes (`inner_radii`) instead of whole hulls: within some
    millionths of it for pyramids, a thousandth below it at the most for round cones; below 0.0001
    it may be 0.

    Parameters
    ----------
    points, normals
        Shape (B, C, 3): grasps of equally many contacts [m], and unit, outward of the object.
    origin, length_scale
        Shape (3,) or (B, 3) [m], and scalar or (B,) [m]; None as in `epsilon_quality`.
    friction, model, torsion, edges, limit
        As in `epsilon_quality`.
    tolerance
        Share of epsilon by which the result may be too small; with 0.05 it takes two thirds of the
        time, and is off by less than a hundredth mostly.

    Returns
    -------
    FloatArray
        Shape (B,).
    """
    points, normals = checked_contacts(points, normals)
    if points.ndim != 3:
        raise InvalidContactsError(f"grasps must be of shape (B, C, 3); it is {points.shape}")
    if limit not in get_args(ForceLimit):
        raise InvalidOptionError(
            f"limit must be one of {', '.join(get_args(ForceLimit))}; it is '{limit}'"
        )
    center, length = frame_of(points, origin, length_scale)
    cones = contact_cones(
        points,
        normals,
        friction=friction,
        origin=center,
        length_scale=length,
        model=model,
        torsion=torsion,
        edges=edges,
    )

    def farthest(directions: FloatArray, grasps: IndexArray) -> FloatArray:
        wrenches = cones.farthest(directions, grasps)  # (b, C, 6)
        reach = (wrenches @ directions[:, :, None])[..., 0]  # (b, C)
        if limit == "each":
            return np.asarray(((reach > 0.0)[..., None] * wrenches).sum(axis=1))
        return wrenches[np.arange(len(reach)), reach.argmax(axis=1)]

    least = _ROUND_TOLERANCE if edges is None else 0.0
    return inner_radii(farthest, len(points), tolerance=max(tolerance, least))


def wrench_volume(
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
    """Return the volume of the grasp wrench space, of six dimensions; 0 where it is flat.

    Unlike epsilon it is the same about any origin, if the length scale is given (its default is
    that of the contacts about the origin), and it does not see a weak direction (Miller and Allen
    1999). Arguments as in `epsilon_quality`.
    """
    wrenches = primitive_wrenches(
        points,
        normals,
        friction=friction,
        origin=origin,
        length_scale=length_scale,
        model=model,
        torsion=torsion,
        edges=edges,
    )
    hull = _hull(wrenches)
    return 0.0 if hull is None else float(hull.volume)


def isotropy(
    points: npt.ArrayLike,
    *,
    origin: npt.ArrayLike | None = None,
    length_scale: float | None = None,
) -> float:
    """Return the smallest over the largest singular value of the grasp map, from 0 to 1.

    The map takes the contacts' forces, each free in three directions, to the wrench on the object:
    at 1 all wrenches cost equal forces (Kim, Oh, Yi and Suh 2001). It depends on where the contacts
    are, and on nothing else.

    Parameters
    ----------
    points
        Shape (C, 3) [m].
    origin, length_scale
        As in `epsilon_quality`.
    """
    points, _ = one_grasp(points, points)
    center, length = frame_of(points, origin, length_scale)
    forces = np.tile(np.eye(3), (len(points), 1))  # (3 C, 3)
    arms = np.repeat((points - center) / length, 3, axis=0)
    values = np.linalg.svd(np.hstack([forces, np.cross(arms, forces)]), compute_uv=False)
    return float(values[-1] / values[0]) if len(values) == 6 else 0.0


def spans(wrenches: FloatArray) -> bool:
    """Return whether wrenches (K, 6) span all six dimensions, and about zero so does their hull."""
    flatness = _FLAT * np.sqrt(len(wrenches))
    centered = wrenches - wrenches.mean(axis=0)
    return bool(np.linalg.matrix_rank(centered, tol=flatness) == 6)


def _hull(wrenches: FloatArray) -> ConvexHull | None:
    """Return the convex hull of wrenches (K, 6); None where it is flat."""
    if not spans(wrenches):
        return None
    try:
        return ConvexHull(wrenches)
    except QhullError:
        # Contacts of high symmetry have facets of many coplanar points, whose merging can fail;
        # joggled by some 1e-11 (the same way each time) they have simple facets only.
        return ConvexHull(wrenches, qhull_options="QJ")
