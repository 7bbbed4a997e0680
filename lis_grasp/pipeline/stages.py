"""Stages between touch and lift: the estimate of the surface and the plan of grasps."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial

import numpy as np
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import (
    TactileSensor,
)
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.grasping.load_prior import LoadPrior
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.meshing import extract_mesh
from lis_grasp.pipeline.plugged_in import find_estimator
from lis_grasp.robots.hand import Hand
from lis_grasp.surfaces import Estimator, ImplicitSurface, carved
from lis_grasp.surfaces.carved_implicit_surface import above_table

_GRASP_STREAM = 2  # of random numbers: a stage run alone repeats its part of a whole run


@dataclass(slots=True)
class Stopwatch:
    """Wall time of each named stage [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time of a block to `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start


def make_estimator(name: str, sensor: TactileSensor | None = None) -> Estimator:
    """Return an estimator, the package's or a plug-in, that is given the sensor's noise.

    The estimator estimates a noise that is 0 from the contacts, or keeps its own default.
    """
    if sensor is None:
        return find_estimator(name)
    noise = {"position_noise": sensor.position_noise, "normal_noise": sensor.normal_noise}
    return partial(find_estimator(name), **{kind: value for kind, value in noise.items() if value})


def estimate(
    contacts: Contacts,
    estimator: str,
    sensor: TactileSensor | None = None,
    *,
    free_space: bool = True,
    table: float | None = None,
) -> tuple[ImplicitSurface, trimesh.Trimesh]:
    """Estimate the surface from contacts of a sensor, and mesh it.

    With `free_space`, the contacts' free space is removed. A `table` at a height [m] closes the
    estimate from below.
    """
    surface = make_estimator(estimator, sensor)(contacts)
    if free_space:
        margin = 0.0 if sensor is None else sensor.free_margin
        surface = carved(surface, contacts, margin=margin)
    surface = above_table(surface, table)
    return surface, extract_mesh(surface)


def plan(
    mesh: trimesh.Trimesh,
    hand: Hand,
    *,
    support: float | None,
    friction: float = 0.8,
    prior: LoadPrior | None = None,
    count: int,
    seed: int,
    candidates: int | None = None,
    station: Station | None = None,
) -> GraspSearch:
    """Plan `count` ranked grasps on a mesh on a plane at height `support` in O [m].

    The prior of mass and friction replaces the coefficient of `friction`. At most `candidates`
    contact sets are sampled; None for the sampler's default. With a `station`, its arm carries the
    hand, and grasps are within its reach.
    """
    sampler = ForceClosureSampler(hand, **asdict(prior or LoadPrior(friction)), station=station)
    if candidates is not None:
        sampler = replace(sampler, candidates=candidates)
    rng = np.random.default_rng([seed, _GRASP_STREAM])
    return sampler.sample(mesh, rng=rng, support_height=support, count=count)
