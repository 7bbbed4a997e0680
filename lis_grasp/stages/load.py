"""Prior knowledge of an object's load: the distribution of its mass and friction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import trimesh

from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.shapes import default_mass
from lis_grasp.shapes.object_mass import USUAL_FRICTION, USUAL_MASS, published_mass
from lis_grasp.task.task import Task

UNKNOWN_LOAD = LoadPrior(USUAL_FRICTION, USUAL_MASS, friction_spread=0.25, mass_spread=np.log(2))
"""Household objects and fingertips of rubber: 0.06 to 0.7 kg, friction 0.5 to 1.2."""


@dataclass(frozen=True, slots=True)
class KnownLoad:
    """The load as known before the object is touched."""

    prior: LoadPrior  #: distribution of mass and friction
    by_volume: bool = False  #: whether its mass is replaced by `default_mass` of an estimate

    @classmethod
    def of(cls, task: Task) -> KnownLoad:
        """Return what a task declares known: the true values, or their distribution."""
        world = task.world
        if task.known.load == "unknown":
            return cls(UNKNOWN_LOAD)
        mass = world.mass if world.mass is not None else published_mass(world.object)
        return cls(LoadPrior(world.friction, USUAL_MASS if mass is None else mass), mass is None)

    def of_mesh(self, mesh: trimesh.Trimesh) -> LoadPrior:
        """Return the distribution of mass and friction of an estimated object."""
        return replace(self.prior, mass=default_mass(mesh)) if self.by_volume else self.prior
