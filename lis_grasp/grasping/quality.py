"""How good a grasp is: force closure, and the largest wrench that it resists in every direction."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.grasping.contact_model import CONE_EDGES, ContactModel, contact_wrenches

FloatArray = npt.NDArray[np.float64]

# Wrenches are of order 1; a hull flatter than this in some direction resists nothing along it.
_FLAT = 1e-9


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

    The grasp wrench space is the convex hull of all primitive wrenches: what contacts can resist
    whose normal forces sum to 1 (the L1 metric). Epsilon is the distance from the origin to the
    hull's nearest facet, and 0 where the origin is not inside.

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
    model, torsion, edges
        See `contact_wrenches`.

    Raises
    ------
    InvalidContactsError
        If points and normals are not (C, 3) with C >= 1, or not finite.

    References
    ----------
    C. Ferrari and J. Canny, "Planning optimal grasps", ICRA 1992.
    """
    wrenches = _primitive_wrenches(
        points, normals, friction, origin, length_scale, model, torsion, edges
    )
    if not _spans(wrenches):
        return 0.0  # flat: some wrench is not resisted at all
    try:
        hull = ConvexHull(wrenches)
    except QhullError:
        # Contacts of high symmetry have facets of many coplanar points, whose merging can fail;
        # joggled by some 1e-11 (the same way each time) they have simple facets only.
        hull = ConvexHull(wrenches, qhull_options="QJ")
    # A facet is {x : n x + d <= 0} with unit n, so the origin is at depth -d inside it.
    return float(max(-hull.equations[:, -1].max(), 0.0))


def is_force_closure(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int = CONE_EDGES,
) -> bool:
    """Return whether contacts resist every wrench, by forces inside their linearised cones.

    Equivalent to: the primitive wrenches span all six dimensions, and zero is a combination of
    them with strictly positive weights (Murray, Li and Sastry 1994, proposition 5.3). The least
    weight is made as large as possible by a linear programme.

    Parameters
    ----------
    points, normals, friction, model, torsion, edges
        As in `epsilon_quality`.

    Raises
    ------
    InvalidContactsError
        If points and normals are not (C, 3) with C >= 1, or not finite.
    """
    return (
        min_weight(points, normals, friction=friction, model=model, torsion=torsion, edges=edges)
        > 1e-9
    )


def min_weight(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int = CONE_EDGES,
) -> float:
    """Return the largest least weight with which the primitive wrenches cancel, times their number.

    The linear programme ``max t : W a = 0, a >= t, sum a = 1`` with the wrenches as columns of W;
    scaled to lie in [0, 1]: positive exactly for force closure, 1 where equal weights cancel.

    Parameters
    ----------
    points, normals, friction, model, torsion, edges
        As in `epsilon_quality`.

    References
    ----------
    A. H. Li, P. Culbertson, J. W. Burdick and A. D. Ames, "FRoGGeR: fast robust grasp generation
    via the min-weight metric", IROS 2023.
    """
    W = _primitive_wrenches(points, normals, friction, None, None, model, torsion, edges)  # (K, 6)
    if not _spans(W):
        return 0.0
    count = len(W)
    # Unknowns: b = a - t >= 0 and t, so that every bound is the solver's own.
    solution = linprog(
        c=np.append(np.zeros(count), -1.0),
        A_eq=np.vstack(
            [np.column_stack([W.T, W.sum(axis=0)]), np.append(np.ones(count), float(count))]
        ),
        b_eq=np.append(np.zeros(6), 1.0),
        bounds=(0.0, None),
        method="highs",
    )
    # Infeasible: zero is no combination at all, the wrenches lie in an open half-space.
    return float(count * solution.x[-1]) if solution.status == 0 else 0.0


def resisted_force(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    direction: npt.ArrayLike,
    *,
    friction: float,
    origin: npt.ArrayLike,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int = CONE_EDGES,
) -> float:
    """Return the force through a point that contacts can put up, per unit of their normal forces.

    How far the grasp wrench space reaches along one wrench: the linear programme
    ``max s : W a = s (d, 0), a >= 0, sum a = 1``. With the direction upwards and the origin at the
    centre of mass, the weight that a grasp can carry in newtons for each newton that it squeezes: a
    task wrench (Borst, Fischer and Hirzinger 2004), where epsilon asks for all at once.

    Parameters
    ----------
    points, normals, friction, model, torsion, edges
        As in `epsilon_quality`.
    direction
        Shape (3,), unit: of the force on the object.
    origin
        Shape (3,) [m]: a point that the force passes through.
    """
    W = _primitive_wrenches(
        points, normals, friction, origin, None, model, torsion, edges
    )  # (K, 6)
    task = np.concatenate([np.asarray(direction, dtype=np.float64), np.zeros(3)])
    solution = linprog(
        c=np.append(np.zeros(len(W)), -1.0),
        A_eq=np.vstack([np.column_stack([W.T, -task]), np.append(np.ones(len(W)), 0.0)]),
        b_eq=np.append(np.zeros(6), 1.0),
        bounds=(0.0, None),
        method="highs",
    )
    # Infeasible: no squeeze at all is without a wrench of its own.
    return float(solution.x[-1]) if solution.status == 0 else 0.0


def _spans(wrenches: FloatArray) -> bool:
    """Return whether wrenches (K, 6) span all six dimensions, and about zero so does their hull."""
    flatness = _FLAT * np.sqrt(len(wrenches))
    centered = wrenches - wrenches.mean(axis=0)
    return bool(np.linalg.matrix_rank(centered, tol=flatness) == 6)


def _primitive_wrenches(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    friction: float,
    origin: npt.ArrayLike | None,
    length_scale: float | None,
    model: ContactModel,
    torsion: float,
    edges: int,
) -> FloatArray:
    points, normals = (
        _contact_rows(name, a) for name, a in (("points", points), ("normals", normals))
    )
    if points.shape != normals.shape:
        raise InvalidContactsError(
            f"each point needs one normal; {len(points)} points and {len(normals)} normals came"
        )
    center = points.mean(axis=0) if origin is None else np.asarray(origin, dtype=np.float64)
    if length_scale is None:
        reach = float(np.linalg.norm(points - center, axis=1).max())
        length_scale = reach if reach > 0.0 else 1.0
    wrenches = contact_wrenches(
        points,
        normals,
        friction=friction,
        origin=center,
        length_scale=length_scale,
        model=model,
        torsion=torsion,
        edges=edges,
    )
    return wrenches.reshape(-1, 6)


def _contact_rows(name: str, values: Any) -> FloatArray:
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows) or not np.isfinite(rows).all():
        raise InvalidContactsError(
            f"{name} must be finite numbers of shape (C, 3) with C of at least 1; their shape is"
            f" {rows.shape}"
        )
    return rows
