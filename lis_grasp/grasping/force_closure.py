"""Force closure: the test, the min-weight metric, and resisted forces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.sparse import csr_array

from lis_grasp.grasping.contact_wrenches import CONE_EDGES, ContactModel, WrenchModel
from lis_grasp.grasping.epsilon import span_all_dimensions
from lis_grasp.guesses import with_advice
from lis_grasp.typing import FloatArray

# Smaller weights count as zero.
_NO_WEIGHT = 1e-9


@with_advice
def is_force_closure(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    friction: float,
    model: ContactModel = "coulomb",
    torsion: float = 0.0,
    edges: int = CONE_EDGES,
) -> bool:
    """Return whether contacts resist every wrench, by forces inside their friction pyramids.

    Equivalent to: their wrenches span all six dimensions, and zero is a combination of them with
    strictly positive weights (Murray, Li and Sastry 1994, proposition 5.3).

    For arguments and errors see `epsilon_quality`.

    Examples
    --------
    >>> is_force_closure(contacts.points, contacts.normals, friction=0.5)
    True
    >>> is_force_closure(contacts.points[:1], contacts.normals[:1], friction=0.5)
    False
    """
    wrench_model = WrenchModel(friction, model, torsion, edges=edges)
    return _cancelling_weights(wrench_model.wrenches_of_grasp(points, normals)) is not None


def min_weight(points: npt.ArrayLike, normals: npt.ArrayLike, model: WrenchModel) -> float:
    """Return the largest least weight with which the primitive wrenches cancel, times their number.

    The linear programme ``max t : W a = 0, a >= t, sum a = 1`` with the K wrenches as columns of W;
    scaled to [0, 1]: positive exactly for force closure, 1 where equal weights cancel. It bounds
    epsilon from below by ``t`` times the least width of the hull of the wrenches.

    Parameters
    ----------
    points, normals
        Shape (C, 3), as in `epsilon_quality`.
    model
        The contacts' model.

    References
    ----------
    A. H. Li, P. Culbertson, J. W. Burdick and A. D. Ames, "FRoGGeR: fast robust grasp generation
    via the min-weight metric", IROS 2023.
    """
    weights = _cancelling_weights(model.wrenches_of_grasp(points, normals))
    return 0.0 if weights is None else float(len(weights) * weights.min())


def resisted_force(
    points: npt.ArrayLike, normals: npt.ArrayLike, direction: npt.ArrayLike, model: WrenchModel
) -> float:
    """Return the force through the origin that contacts resist, per unit of their normal forces.

    The extent of the grasp wrench space along one wrench: the linear programme
    ``max s : W a = s (d, 0), a >= 0, sum a = 1``. With the direction upwards and the origin at the
    centre of mass it is the weight that a grasp carries, in newtons for each newton of squeeze: a
    task wrench (Borst, Fischer and Hirzinger 2004), where epsilon asks for all wrenches at once.

    Parameters
    ----------
    points, normals
        Shape (C, 3), as in `epsilon_quality`.
    direction
        Shape (3,), unit: direction of the force on the object.
    model
        The contacts' model. Its origin is the point that the force passes through; its length scale
        does not matter.
    """
    points, normals = np.asarray(points)[None], np.asarray(normals)[None]
    return float(resisted_forces(points, normals, direction, model)[0])


def resisted_forces(
    points: npt.ArrayLike, normals: npt.ArrayLike, direction: npt.ArrayLike, model: WrenchModel
) -> FloatArray:
    """Return `resisted_force` of many grasps, contacts (B, C, 3), by one linear programme; (B,).

    Each grasp is a block of it, with ``sum a <= 1``, which allows ``s = 0``. A largest ``s > 0``
    has ``sum a = 1``, as it grows with the weights. Where the solver fails, grasps are solved one
    by one; a grasp on which it fails again resists zero.
    """
    wrenches = replace(model, length_scale=None).wrenches(points, normals)  # (B, C, K, 6)
    count = len(wrenches)
    W = wrenches.reshape(count, -1, 6)
    task = np.concatenate([np.asarray(direction, dtype=np.float64), np.zeros(3)])
    columns = np.concatenate([W, np.broadcast_to(-task, (count, 1, 6))], axis=1)  # (B, N, 6)
    sizes, rows = columns.shape[1], np.arange(6 * count).reshape(count, 1, 6)
    row, column = np.broadcast_arrays(rows, np.arange(count * sizes).reshape(count, sizes, 1))
    on_rows = (row.ravel(), column.ravel())
    is_force = np.tile(np.arange(sizes) == sizes - 1, count)
    weights = np.flatnonzero(~is_force)
    solution = linprog(
        c=np.where(is_force, -1.0, 0.0),
        A_eq=csr_array((columns.ravel(), on_rows)),
        b_eq=np.zeros(6 * count),
        A_ub=csr_array(
            (np.ones(len(weights)), (weights // sizes, weights)), (count, len(is_force))
        ),
        b_ub=np.ones(count),
        bounds=(0.0, None),
        method="highs",
    )
    if solution.status == 0:
        return np.asarray(solution.x[is_force])
    if count == 1:
        return np.zeros(1)
    alone = zip(np.asarray(points)[:, None], np.asarray(normals)[:, None], strict=True)
    return np.concatenate([resisted_forces(p, n, direction, model) for p, n in alone])


def _cancelling_weights(W: FloatArray) -> FloatArray | None:
    """Return weights (K,) above 0, of sum 1, with ``weights @ W = 0``; None if rank(W) < 6."""
    if not span_all_dimensions(W):
        return None
    count = len(W)
    # Largest t; unknowns b = a - t >= 0 and t, so that every bound is the solver's own.
    solution = linprog(
        c=np.append(np.zeros(count), -1.0),
        A_eq=np.vstack([np.column_stack([W.T, W.sum(axis=0)]), np.append(np.ones(count), count)]),
        b_eq=np.append(np.zeros(6), 1.0),
        bounds=(0.0, None),
        method="highs",
    )
    # Infeasible: all wrenches are in an open half-space.
    if solution.status != 0 or count * solution.x[-1] <= _NO_WEIGHT:
        return None
    return np.asarray(solution.x[:-1] + solution.x[-1])
