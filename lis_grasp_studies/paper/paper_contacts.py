"""Contacts of the paper's experiments: walks over true surfaces, random contacts, a wedge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_samples import sample_mesh, sample_segments
from lis_grasp.exploration import STEP_FRACTION
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray
from lis_grasp_studies.compared_estimators import Noise

# Distance of a new contact from the nearest one, in steps.
_BAND = (0.8, 1.2)
# A fingertip measures no normal on an edge: distance of contacts from edges, in steps.
_CLEARANCE = 0.06
# A contact does not explore a surface that faces away from it: the other side of a thin wall.
_FACES_AWAY = -0.5
# Points of the true surface that contacts are drawn from, even in area.
_PLACES = 20_000

NOISE_LEVELS = tuple(
    Noise(1e-3 * millimetres, float(np.deg2rad(degrees)))
    for millimetres, degrees in ((0, 0), (1, 2.5), (2, 5), (4, 10), (6, 15), (8, 20))
)
"""Noise of position and normal, from none to more than any sensor has."""

_SPACING = 0.05
_SIDE = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceWalk:
    """The contacts of one walk over an object, in order, and what was explored after each."""

    contacts: Contacts
    """Exact points and normals of the true surface, in O."""
    coverage: FloatArray
    """Shape (N,), fraction of the true area within a step of a contact that does not face away,
    after each contact."""

    def until(self, coverage: float) -> Contacts:
        """Return the contacts up to the one that explored at least this fraction of the object."""
        enough = np.flatnonzero(self.coverage >= coverage)
        return self.first(int(enough[0]) + 1 if len(enough) else len(self.contacts))

    def first(self, touches: int) -> Contacts:
        """Return the first contacts."""
        return self.contacts.subset(np.arange(min(touches, len(self.contacts))))


def walk_surface(shape: Shape, *, rng: np.random.Generator) -> SurfaceWalk:
    """Touch an object step by step until all of it is within a step of a contact.

    The first contact is anywhere; each next one is drawn from the true surface about a step away
    from the contacts so far. The paper's explorer chooses targets by an estimate, and does not say
    which; contacts chosen on the true surface depend on no estimator. They are even, though, which
    favours estimators with sharp edges.

    A step is a quarter of the object's size.
    """
    step = STEP_FRACTION * shape.size
    places, faces = sample_mesh(shape.mesh, _PLACES)
    normals = np.asarray(shape.mesh.face_normals)[faces]
    can_touch = np.ones(len(places), dtype=bool)
    if len(shape.edges):
        edge = cKDTree(sample_segments(shape.edges, _PLACES))
        can_touch = edge.query(places)[0] > _CLEARANCE * step
    gaps = np.full(len(places), np.inf)  # to the nearest contact that does not face away
    chosen: list[int] = []
    coverage: list[float] = []
    while True:
        open_ = can_touch & (gaps > _BAND[0] * step)
        frontier = np.flatnonzero(open_ & (gaps < _BAND[1] * step))
        if len(frontier):
            k = rng.choice(frontier)
        elif not open_.any():
            break
        else:  # at the start, and where a part is connected to nothing touched
            rest = np.flatnonzero(open_)
            k = rng.choice(rest[gaps[rest] == gaps[rest].min()])
        chosen.append(int(k))
        apart = np.linalg.norm(places - places[k], axis=1)
        apart[normals @ normals[k] < _FACES_AWAY] = np.inf
        np.minimum(gaps, apart, out=gaps)
        coverage.append(float(np.mean(gaps < step)))
    return SurfaceWalk(Contacts(places[chosen], normals[chosen]), np.array(coverage))


def random_contacts(shape: Shape, count: int, *, rng: np.random.Generator) -> Contacts:
    """Return exact contacts drawn at random from a surface, uniformly in area."""
    points, faces = sample_mesh(shape.mesh, _PLACES)
    drawn = rng.choice(_PLACES, count, replace=False)
    return Contacts(points[drawn], np.asarray(shape.mesh.face_normals)[faces[drawn]])


def wedge() -> Shape:
    """Return a large cube with an edge along y at the origin; its other edges are far away."""
    half = 0.5 * _SIDE
    cube = trimesh.creation.box(bounds=[[-_SIDE, -half, -_SIDE], [0.0, half, 0.0]])
    return Shape.from_mesh(cube, "wedge")


def touch_wedge() -> Contacts:
    """Return 12 contacts 50 mm apart: 2 columns of 3 on each face, the first 25 mm from the edge.

    The paper gives their number and spacing; their arrangement is ours.
    """
    away = -_SPACING * np.array([0.5, 1.5])
    along = _SPACING * np.array([-1.0, 0.0, 1.0])
    a, y = (values.ravel() for values in np.meshgrid(away, along))
    zero, one = np.zeros(6), np.ones(6)
    top = np.column_stack([a, y, zero]), np.column_stack([zero, zero, one])
    side = np.column_stack([zero, y, a]), np.column_stack([one, zero, zero])
    return Contacts(np.vstack([top[0], side[0]]), np.vstack([top[1], side[1]]))
