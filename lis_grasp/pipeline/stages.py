"""Stages between touch and lift: the estimate of the surface and the plan of grasps."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import TactileSensor
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.grasping.sampler import CANDIDATES, ForceClosureSampler
from lis_grasp.meshing import extract_mesh
from lis_grasp.pipeline.plugged_in import find_estimator
from lis_grasp.pipeline.scenario import Known, Perception
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


def make_estimator(estimator: str | Estimator, sensor: TactileSensor) -> Estimator:
    """Return the estimator of a name, the package's or a plug-in, given the sensor's noise.

    It estimates a noise that is 0 from the contacts, or keeps its own default. An estimator that is
    no name is returned as it is.
    """
    if not isinstance(estimator, str):
        return estimator
    noise = {"position_noise": sensor.position_noise, "normal_noise": sensor.normal_noise}
    given = {kind: value for kind, value in noise.items() if value}
    return partial(find_estimator(estimator), **given)


def estimate(known: Perception, contacts: Contacts) -> tuple[ImplicitSurface, trimesh.Trimesh]:
    """Estimate the surface from contacts, and mesh it.

    `known` says by which estimator and sensor, whether the contacts' free space is removed, and
    which table closes the estimate from below.
    """
    surface = make_estimator(known.estimator, known.sensor)(contacts)
    if known.free_space:
        surface = carved(surface, contacts, margin=known.sensor.free_margin)
    surface = above_table(surface, known.table)
    return surface, extract_mesh(surface)


def plan(known: Known, mesh: trimesh.Trimesh, *, candidates: int = CANDIDATES) -> GraspSearch:
    """Plan the ranked grasps of the known hand, and its arm if it has one, on a mesh.

    At most `candidates` contact sets are sampled.
    """
    load, station = known.load_prior(mesh), known.station
    sampler = ForceClosureSampler(known.hand, load, candidates=candidates, station=station)
    rng = np.random.default_rng([known.seed, _GRASP_STREAM])
    return sampler.sample(mesh, rng=rng, support_height=known.support, count=known.grasps)
