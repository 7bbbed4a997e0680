"""Tactile exploration, implicit surface estimation and grasp planning for unknown objects.

The public names, loaded on first use so that `import lis_grasp` costs next to nothing. None of
them needs Drake; what does is in `lis_grasp.simulation` and `lis_grasp.drake`.
"""

import sys
from typing import TYPE_CHECKING

from lis_grasp._moved import OldModules, module_names
from lis_grasp.version import __version__

if TYPE_CHECKING:
    from lis_grasp import pipeline as pipeline
    from lis_grasp import shapes as shapes
    from lis_grasp.contacts import Contacts as Contacts
    from lis_grasp.evaluation.surface_error import surface_error as surface_error
    from lis_grasp.exports.outline import outline as outline
    from lis_grasp.grasping.epsilon import epsilon_quality as epsilon_quality
    from lis_grasp.grasping.force_closure import is_force_closure as is_force_closure
    from lis_grasp.grasping.grasps import Grasp as Grasp
    from lis_grasp.grasping.grasps import GraspSearch as GraspSearch
    from lis_grasp.grasping.sampler import ForceClosureSampler as ForceClosureSampler
    from lis_grasp.lifting.pose_in_hand import PoseInHand as PoseInHand
    from lis_grasp.lifting.pose_in_hand import locate_in_hand as locate_in_hand
    from lis_grasp.meshing import extract_mesh as extract_mesh
    from lis_grasp.pipeline.direct import explore as explore
    from lis_grasp.pipeline.direct import lift as lift
    from lis_grasp.pipeline.direct import next_touch as next_touch
    from lis_grasp.pipeline.direct import plan as plan
    from lis_grasp.pipeline.direct import run as run
    from lis_grasp.pipeline.names_of_2 import RunConfig as RunConfig
    from lis_grasp.results.run_results import Run as Run
    from lis_grasp.robots.hand import Hand as Hand
    from lis_grasp.shapes import Shape as Shape
    from lis_grasp.stages.estimate import estimate as estimate
    from lis_grasp.stages.surroundings import load_world as load_world
    from lis_grasp.surfaces import BlendedImplicitSurface as BlendedImplicitSurface
    from lis_grasp.surfaces import (
        GaussianProcessImplicitSurface as GaussianProcessImplicitSurface,
    )
    from lis_grasp.surfaces import ImplicitSurface as ImplicitSurface
    from lis_grasp.surfaces import LocalImplicitSurface as LocalImplicitSurface
    from lis_grasp.surfaces import PatchImplicitSurface as PatchImplicitSurface
    from lis_grasp.surfaces import SmoothImplicitSurface as SmoothImplicitSurface
    from lis_grasp.surfaces import load_contacts as load_contacts
    from lis_grasp.task import Decide as Decide
    from lis_grasp.task import Known as Known
    from lis_grasp.task import Robot as Robot
    from lis_grasp.task import Task as Task
    from lis_grasp.task import World as World
    from lis_grasp.task import load_scene as load_scene
    from lis_grasp.task import write_scene as write_scene
    from lis_grasp.visualization import Scene as Scene
    from lis_grasp.world import Body as Body
    from lis_grasp.world import Surroundings as Surroundings

_HOMES = {
    "contacts": "Contacts",
    "evaluation.surface_error": "surface_error",
    "exports.outline": "outline",
    "grasping.epsilon": "epsilon_quality",
    "grasping.force_closure": "is_force_closure",
    "grasping.grasps": "Grasp GraspSearch",
    "grasping.sampler": "ForceClosureSampler",
    "lifting.pose_in_hand": "PoseInHand locate_in_hand",
    "meshing": "extract_mesh",
    "pipeline": "",
    "pipeline.names_of_2": "RunConfig",
    "pipeline.direct": "explore lift next_touch plan run",
    "results.run_results": "Run",
    "robots.hand": "Hand",
    "shapes": "Shape",
    "stages.estimate": "estimate",
    "stages.surroundings": "load_world",
    "surfaces": (
        "BlendedImplicitSurface GaussianProcessImplicitSurface ImplicitSurface LocalImplicitSurface"
        " PatchImplicitSurface SmoothImplicitSurface load_contacts"
    ),
    "task": "Decide Known Robot Task World load_scene write_scene",
    "visualization": "Scene",
    "world": "Body Surroundings",
}

if OldModules not in sys.meta_path:
    sys.meta_path.insert(0, OldModules)  # type: ignore[arg-type]

__all__ = ["__version__", "pipeline", "shapes", *" ".join(_HOMES.values()).split()]
__getattr__, __dir__ = module_names(__name__, __all__, _HOMES)

# A notebook, or a library that loads IPython without a shell.
_ipython = sys.modules.get("IPython")
if _ipython and (_shell := _ipython.get_ipython()):
    from lis_grasp._displays import register

    register(_shell.display_formatter)
