"""Whether contacts resist every wrench, with a proof either way; and how far along one wrench."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from lis_grasp.grasping.contact_cones import contact_cones
from lis_grasp.grasping.contact_model import CONE_EDGES, ContactModel
from lis_grasp.grasping.grasp_contacts import frame_of, one_grasp, primitive_wrenches
from lis_grasp.grasping.quality import spans
from lis_grasp.typing import FloatArray

# Least weight, and reach of a cone beyond a separating plane, that count as none.
_NO_WEIGHT, _NO_REACH = 1e-9, 1e-7
# Rounds of cutting planes for round cones; each halves, at least, what is left between the pyramid
# and the cone.
_MOST_CUTS = 60


@dataclass(frozen=True, slots=True, eq=False)
class ForceClosureProof:
    """Why contacts are in force closure, or why not.

    Parameters
    ----------
    wrenches
        Shape (K, 6): wrenches inside the contacts' cones, torques over the length scale.
    weights
        Shape (K,): positive, with ``weights @ wrenches = 0``, where the wrenches span all
        dimensions: every small wrench is then resisted. None without closure.
    separating_wrench
        Shape (6,), unit: no wrench of the contacts has a positive product with it, so nothing
        resists it. None with closure.
    """

    wrenches: FloatArray
    weights: FloatArray | None
    separating_wrench: FloatArray | None

    @property
    def holds(self) -> bool:
        """Whether the contacts are in force closure."""
        return self.weights is not None


def is_force_closure(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int | None = CONE_EDGES,
) -> bool:
    """Return whether contacts resist every wrench, by forces inside their cones.

    Equivalent to: wrenches of the cones span all six dimensions, and zero is a combination of
    them with strictly positive weights (Murray, Li and Sastry 1994, proposition 5.3).

    Parameters
    ----------
    points, normals, friction, model, torsion
        As in `epsilon_quality`.
    edges
        Of the pyramids that stand for cones; None for round cones.

    Raises
    ------
    InvalidContactsError
        If points and normals are not (C, 3) with C >= 1, or not finite.
    """
    proof = certify_force_closure(
        points, normals, friction=friction, model=model, torsion=torsion, edges=edges
    )
    return proof.holds


def certify_force_closure(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int | None = CONE_EDGES,
) -> ForceClosureProof:
    """Return why contacts are in force closure, or why not, in a form that anybody can check.

    Two linear programmes: weights that cancel the primitive wrenches, the least of them as large as
    possible; or, where there are none, a wrench that has no positive product with any. For round
    cones pyramids are refined by cutting planes (Kelley 1960): where a cone reaches beyond the
    separating plane of the pyramids, it adds the wrench that reaches farthest. Each answer is
    exact: weights are of wrenches inside the cones, and a plane is the answer only once no cone
    crosses it.

    Arguments and errors as of `is_force_closure`.
    """
    points, normals = one_grasp(points, normals)
    wrenches = primitive_wrenches(
        points,
        normals,
        friction=friction,
        model=model,
        torsion=torsion,
        edges=CONE_EDGES if edges is None else edges,
    )
    center, length = frame_of(points, None, None)
    cones = contact_cones(
        points[None],
        normals[None],
        friction=friction,
        origin=center,
        length_scale=length,
        model=model,
        torsion=torsion,
        edges=edges,
    )
    for _ in range(_MOST_CUTS):
        weights = _cancelling_weights(wrenches)
        if weights is not None:
            return ForceClosureProof(wrenches, weights, None)
        plane = _separating_wrench(wrenches)
        beyond = cones.farthest(plane[None], np.zeros(1, dtype=np.intp))[0]  # (C, 6)
        crossing = beyond @ plane > _NO_REACH
        if not crossing.any():
            break
        wrenches = np.vstack([wrenches, beyond[crossing]])
    return ForceClosureProof(wrenches, None, plane)


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

    The linear programme ``max t : W a = 0, a >= t, sum a = 1`` with the K wrenches as columns of W;
    scaled to lie in [0, 1]: positive exactly for force closure, 1 where equal weights cancel. It
    bounds epsilon from below by ``t`` times the least width of the hull of the wrenches.

    Parameters
    ----------
    points, normals, friction, model, torsion, edges
        As in `epsilon_quality`.

    References
    ----------
    A. H. Li, P. Culbertson, J. W. Burdick and A. D. Ames, "FRoGGeR: fast robust grasp generation
    via the min-weight metric", IROS 2023.
    """
    weights = _cancelling_weights(
        primitive_wrenches(
            points, normals, friction=friction, model=model, torsion=torsion, edges=edges
        )
    )
    return 0.0 if weights is None else float(len(weights) * weights.min())


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
    W = primitive_wrenches(
        points,
        normals,
        friction=friction,
        origin=origin,
        model=model,
        torsion=torsion,
        edges=edges,
    )
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


def _cancelling_weights(W: FloatArray) -> FloatArray | None:
    """Return positive weights (K,) with ``weights @ W = 0`` of sum 1, the least as large as can be.

    None where there are none, or where W (K, 6) does not span all dimensions.
    """
    if not spans(W):
        return None
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
    if solution.status != 0 or count * solution.x[-1] <= _NO_WEIGHT:
        return None
    weights: FloatArray = solution.x[:-1] + solution.x[-1]
    return weights


def _separating_wrench(W: FloatArray) -> FloatArray:
    """Return a unit wrench (6,) without positive product with any of W (K, 6); one must exist.

    ``min sum W y : W y <= 0, |y_i| <= 1``; where all products must vanish, W does not span, and
    what it leaves out is the answer.
    """
    solution = linprog(
        c=W.sum(axis=0), A_ub=W, b_ub=np.zeros(len(W)), bounds=(-1.0, 1.0), method="highs"
    )
    y = solution.x if solution.status == 0 else np.zeros(6)
    if (W @ y).min() > -_NO_REACH:
        y = np.linalg.svd(W)[2][-1]
    return np.asarray(y / np.linalg.norm(y))
