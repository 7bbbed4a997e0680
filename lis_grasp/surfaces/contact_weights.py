"""Weights of contacts: more for one that stands alone, less for those that crowd together."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.typing import FloatArray

# Directions of the Voronoi quadrature: weights are then good to about 1e-3.
_DIRECTIONS = 2048


def voronoi_weights(points: FloatArray, radius: float) -> FloatArray:
    """Weigh each contact by the volume of its Voronoi cell (Ottenhaus et al. 2016, eq. 9).

    Cells at the rim of the contacts are unbounded, therefore each is clipped to a ball round its
    contact (departure from the paper). A clipped cell is star-shaped about its contact: it reaches
    rho(u) along the direction u, up to the ball or the nearest bisecting plane, and its volume is
    the mean of (4 pi / 3) rho^3 over directions; the mean is taken over a fixed spiral of
    directions. Contacts at the same place share their cell equally.

    Parameters
    ----------
    points
        Shape (N, 3) [m].
    radius
        Of the clipping ball [m].

    Returns
    -------
    FloatArray
        Shape (N,), as part of the whole ball: above 0, at most 1.
    """
    places, place, shared = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    directions = _spiral_directions(_DIRECTIONS)  # (U, 3)
    tree = cKDTree(places)
    volumes = np.ones(len(places))
    for i, center in enumerate(places):
        near = [
            j for j in tree.query_ball_point(center, 2.0 * radius, return_sorted=True) if j != i
        ]
        offsets = places[near] - center  # (J, 3)
        # The bisecting plane of neighbour j is d . x = |d|^2 / 2, met at x = rho u.
        inverse_reach = 2.0 * directions @ (offsets / np.sum(offsets**2, axis=1, keepdims=True)).T
        farthest = 1.0 / np.max(inverse_reach, axis=1, initial=1.0 / radius)  # (U,)
        volumes[i] = np.mean((farthest / radius) ** 3)
    return volumes[place.reshape(-1)] / shared[place.reshape(-1)]


def density_weights(points: FloatArray, sigma: float) -> FloatArray:
    """Weigh each contact by one over the kernel density of contacts at it, 1 / sum_j k(c_i, c_j).

    Cheaper than eq. 9 of Ottenhaus et al. 2016 and like it in spirit: contacts at the same place
    share the weight of one, exactly; it depends on distances only.

    Returns
    -------
    FloatArray
        Shape (N,), at least 1/N, at most 1.
    """
    tree = cKDTree(points)
    distances = tree.sparse_distance_matrix(tree, 8.0 * sigma, output_type="coo_matrix")
    kernel = np.exp(-0.5 * (distances.data / sigma) ** 2)
    # Pairs at distance 0, each contact with itself among them, are stored as explicit zeros.
    return 1.0 / np.bincount(distances.row, kernel, minlength=len(points))


def _spiral_directions(count: int) -> FloatArray:
    """Return unit directions spread evenly over the sphere (Fibonacci spiral), shape (count, 3)."""
    index = np.arange(count)
    height = 1.0 - (2.0 * index + 1.0) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * index
    ring = np.sqrt(1.0 - height**2)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])
