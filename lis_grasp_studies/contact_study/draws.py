"""Contacts of a true surface: even, random by area, clustered, on one half, and by exploration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import POLICIES
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import touch
from lis_grasp.task.task import Task
from lis_grasp.typing import BoolArray, IndexArray
from lis_grasp_studies.contact_study.surface_points import SurfacePoints

# Even contacts keep this distance from edges, in sizes of the object: on an edge a fingertip
# measures no normal.
_CLEARANCE = 0.0075
# An even contact is drawn from the places that are at least this far from the contacts so far, in
# distances of the farthest place.
_JITTER = 0.8
# Places of a pad that contacts of one touch are drawn from.
_PAD_PLACES = 40

CLUSTER_RADIUS = 0.0045
"""Contacts of one touch of a taxel pad are within this distance of its middle [m]."""

CLUSTER_SIZES = (3, 9)
"""Least and largest number of contacts of one touch of a taxel pad."""


def even_contacts(surface: SurfacePoints, count: int, *, rng: np.random.Generator) -> Contacts:
    """Return contacts spread evenly: each next one far from all others, with jitter."""
    return surface.contacts(_even(surface, _clear(surface), count, rng))


def random_contacts(surface: SurfacePoints, count: int, *, rng: np.random.Generator) -> Contacts:
    """Return contacts drawn uniformly by area, near edges too."""
    return surface.contacts(rng.choice(len(surface.points), count, replace=False))


def half_contacts(surface: SurfacePoints, count: int, *, rng: np.random.Generator) -> Contacts:
    """Return contacts spread evenly over the half of the surface on one side of a random plane."""
    direction = rng.normal(size=3)
    heights = surface.points @ direction
    return surface.contacts(
        _even(surface, _clear(surface) & (heights > np.median(heights)), count, rng)
    )


def clustered_contacts(surface: SurfacePoints, count: int, *, rng: np.random.Generator) -> Contacts:
    """Return exact contacts in clusters, as a taxel pad measures several at each touch.

    Clusters of 3 to 9 contacts are within 9 mm of each other, their middles spread evenly. A pad
    touches one side of a sheet: normals of a cluster differ by less than 90 degrees.
    """
    sizes: list[int] = []
    while sum(sizes) < count:
        sizes.append(min(int(rng.integers(*CLUSTER_SIZES, endpoint=True)), count - sum(sizes)))
    found = Contacts(np.empty((0, 3)), np.empty((0, 3)))
    for middle, size in zip(_even(surface, _clear(surface), len(sizes), rng), sizes, strict=True):
        touched = _touch_of_pad(surface, middle, rng)
        found = found.append(touched.subset(np.arange(min(size, len(touched)))))
    return found


DRAWS: Mapping[str, Callable[..., Contacts]] = MappingProxyType(
    {
        "even": even_contacts,
        "random": random_contacts,
        "clustered": clustered_contacts,
        "half": half_contacts,
    }
)
"""Every way to draw a number of exact contacts, by its name."""

EXPLORATIONS: Mapping[str, str] = MappingProxyType(
    {("random_targets" if name == "random" else name): name for name in POLICIES}
)
"""The policies by which the simulated hand explores, by the names that they have among draws."""


def explored_contacts(shape: Shape, hand: Hand, draw: str, count: int, *, seed: int) -> Contacts:
    """Return the contacts of a hand that explores by a policy and `gpis`, without the simulator.

    The estimator that guides the hand is the same for every compared estimator. Free space that the
    hand passed through is left out.
    """
    policy = EXPLORATIONS[draw]
    task = Task.of(
        known=True, prober="kinematic", policy=policy, estimator="gpis", touches=count, seed=seed
    )
    found = touch(Scenario.from_config(task, shape, hand)).contacts
    return Contacts(found.points, found.normals)


def _clear(surface: SurfacePoints) -> BoolArray:
    size = float(np.ptp(surface.points, axis=0).max())
    return np.asarray(surface.edge_distances > _CLEARANCE * size)


def _even(
    surface: SurfacePoints, permitted: BoolArray, count: int, rng: np.random.Generator
) -> IndexArray:
    """Return the indices of places in farthest-point order with jitter."""
    gaps = np.where(permitted, np.inf, -1.0)  # to the nearest chosen place that does not face away
    chosen = np.empty(count, dtype=np.intp)
    for k in range(count):
        chosen[k] = rng.choice(np.flatnonzero(gaps >= _JITTER * gaps.max()))
        surface.shrink_gaps(gaps, chosen[k])
    return chosen


def _touch_of_pad(surface: SurfacePoints, middle: int, rng: np.random.Generator) -> Contacts:
    """Return contacts that one touch may make, about a place of the surface, in random order."""
    center, normal = surface.points[middle], surface.normals[middle]
    across = np.linalg.svd(normal[None])[2][1:]  # (2, 3), tangents
    angles = rng.uniform(0.0, 2.0 * np.pi, _PAD_PLACES)
    reach = CLUSTER_RADIUS * np.sqrt(rng.uniform(size=_PAD_PLACES))
    offsets = reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    near = surface.nearest(center + offsets @ across)
    touched = np.linalg.norm(near.points - center, axis=1) <= CLUSTER_RADIUS
    touched &= near.normals @ normal > 0.0
    return surface.contacts(np.array([middle])).append(near.subset(np.flatnonzero(touched)))
