"""Contacts of the paper's experiments: a walk over the true surface, without an estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_samples import sample_mesh, sample_segments
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import STEP_FRACTION
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray

# Distance of a new contact from the nearest one, in steps.
_BAND = (0.8, 1.2)
# A fingertip measures no normal on an edge: distance of contacts from edges, in steps.
_CLEARANCE = 0.06
# A contact does not explore a surface that faces away from it: the other side of a thin wall.
_FACES_AWAY = -0.5
_PLACES = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceWalk:
    """The contacts of one walk over an object, in order, and what was explored after each.

    Parameters
    ----------
    contacts
        Exact points and normals of the true surface, in O.
    coverage
        Shape (N,), fraction of the true area within a step of a contact that does not face away,
        after each contact.
    """

    contacts: Contacts
    coverage: FloatArray

    def until(self, coverage: float) -> Contacts:
        """Return the contacts up to the one that explored at least this fraction of the object."""
        enough = np.flatnonzero(self.coverage >= coverage)
        return self.first(int(enough[0]) + 1 if len(enough) else len(self.contacts))

    def first(self, touches: int) -> Contacts:
        """Return the first contacts."""
        return self.contacts.subset(np.arange(min(touches, len(self.contacts))))


def walk_surface(
    shape: Shape, *, rng: np.random.Generator, step: float | None = None
) -> SurfaceWalk:
    """Touch an object step by step until all of it is within a step of a contact.

    The first contact is anywhere; each next one is drawn from the true surface about a step away
    from the contacts so far. The paper's explorer chooses targets by an estimate, and does not say
    which; contacts chosen on the true surface depend on no estimator. They are even, though, which
    favours estimators with sharp edges.

    Parameters
    ----------
    shape
        The true object.
    rng
        Decides where the walk goes.
    step
        Distance between contacts [m]; None takes a quarter of the object's size.

    Raises
    ------
    InvalidOptionError
        If the step is not a positive length.
    """
    step = STEP_FRACTION * shape.size if step is None else step
    if not (np.isfinite(step) and step > 0.0):
        raise InvalidOptionError.out_of_range("step", step, "a positive length [m]")
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
