"""Errors of estimates that should be exact: a cube from six contacts, and meshing loss."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.mesh_distance import distances_to_mesh
from lis_grasp.evaluation.surface_samples import sample_segments
from lis_grasp.experiments.compared_estimators import Noise, compared_estimator
from lis_grasp.experiments.paper.paper_trials import explored
from lis_grasp.meshing import extract_mesh
from lis_grasp.typing import FloatArray

_HALF = 0.05
_SAMPLES = 3000
# Objects that patches reproduce to rounding: the mesher causes any error at their edges.
_EXACT_OBJECTS = ("box", "pentagon")


def cube_edge_error(estimator: str) -> float:
    """Return the root mean square distance of a cube's edges from its estimate [m].

    The cube has sides of 10 cm and one contact in the middle of each face (fig. 1).
    """
    axes = np.vstack([np.eye(3), -np.eye(3)])
    mesh = extract_mesh(compared_estimator(estimator)(Contacts(_HALF * axes, axes), Noise()))
    corners = _HALF * np.array(list(product((-1.0, 1.0), repeat=3)))
    edges = [pair for pair in combinations(corners, 2) if np.sum(pair[0] != pair[1]) == 1]
    return _root_mean_square(distances_to_mesh(sample_segments(np.array(edges), _SAMPLES), mesh)[0])


def meshing_loss(cell: float, *, seeds: int = 3) -> float:
    """Return the root mean square distance of edges from meshes of exact estimates [m].

    Parameters
    ----------
    cell
        Of the grid [m].
    seeds
        Walks over each object.
    """
    errors = []
    for name, seed in product(_EXACT_OBJECTS, range(seeds)):
        shape, walk = explored(name, seed)
        surface = compared_estimator("patch")(walk.contacts, Noise())
        points = sample_segments(shape.edges, _SAMPLES)
        errors.append(distances_to_mesh(points, extract_mesh(surface, resolution=cell))[0])
    return _root_mean_square(np.concatenate(errors))


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
