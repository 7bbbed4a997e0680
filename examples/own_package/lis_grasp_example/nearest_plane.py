"""Estimator: the tangent plane of the nearest contact."""

import numpy as np
from scipy.spatial import cKDTree


class NearestPlane:
    """A surface of which each place belongs to the tangent plane of its nearest contact."""

    def __init__(self, contacts, *, position_noise=0.0, normal_noise=0.0):
        self._contacts, self._tree = contacts, cKDTree(contacts.points)
        self._noise = position_noise
        margin = max(0.15 * contacts.extent, 0.01)
        self.bounds = contacts.bounds + [[-margin], [margin]]  # (2, 3) [m]

    def evaluate(self, points):
        """Return the signed distances to the planes, (...) [m]: negative inside."""
        nearest = self._tree.query(points)[1]
        offsets = points - self._contacts.points[nearest]
        return np.sum(offsets * self._contacts.normals[nearest], axis=-1)

    def gradient(self, points):
        """Return the planes' normals, (..., 3)."""
        return self._contacts.normals[self._tree.query(points)[1]]

    def uncertainty(self, points):
        """Return one standard deviation, (...) [m]: it grows away from the contacts."""
        return np.hypot(self._noise, 0.2 * self._tree.query(points)[0])
