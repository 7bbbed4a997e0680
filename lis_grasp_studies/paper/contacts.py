"""Contacts of the paper's experiments: walks over true surfaces, random contacts, a wedge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import STEP_FRACTION
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray
from lis_grasp_studies.contact_study.surface_points import SurfacePoints
from lis_grasp_studies.estimators import Noise

# Distance of a new contact from the nearest one, in steps.
_BAND = (0.8, 1.2)
# A fingertip measures no normal on an edge: distance of contacts from edges, in steps.
_CLEARANCE = 0.06

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
    surface = SurfacePoints.with_face_normals(shape)
    can_touch = surface.edge_distances > _CLEARANCE * step
    gaps = np.full(len(surface.points), np.inf)  # to the nearest contact that does not face away
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
        surface.shrink_gaps(gaps, k)
        coverage.append(float(np.mean(gaps < step)))
    return SurfaceWalk(surface.contacts(np.array(chosen)), np.array(coverage))


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
