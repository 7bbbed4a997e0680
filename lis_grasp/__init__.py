"""Tactile exploration, implicit surface estimation and grasp planning for unknown objects.

The public names, loaded on first use so that `import lis_grasp` costs next to nothing. None of
them needs Drake; what does is in `lis_grasp.simulation`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from lis_grasp.version import __version__

if TYPE_CHECKING:
    from lis_grasp import pipeline as pipeline
    from lis_grasp import shapes as shapes
    from lis_grasp.contacts import Contacts as Contacts
    from lis_grasp.evaluation.surface_error import surface_error as surface_error
    from lis_grasp.grasping.epsilon import epsilon_quality as epsilon_quality
    from lis_grasp.grasping.force_closure import is_force_closure as is_force_closure
    from lis_grasp.grasping.grasps import Grasp as Grasp
    from lis_grasp.grasping.grasps import GraspSearch as GraspSearch
    from lis_grasp.grasping.sampler import ForceClosureSampler as ForceClosureSampler
    from lis_grasp.meshing import extract_mesh as extract_mesh
    from lis_grasp.robots.hand import Hand as Hand
    from lis_grasp.surfaces import BlendedImplicitSurface as BlendedImplicitSurface
    from lis_grasp.surfaces import (
        GaussianProcessImplicitSurface as GaussianProcessImplicitSurface,
    )
    from lis_grasp.surfaces import ImplicitSurface as ImplicitSurface
    from lis_grasp.surfaces import LocalImplicitSurface as LocalImplicitSurface
    from lis_grasp.surfaces import PatchImplicitSurface as PatchImplicitSurface

_HOMES = {
    "BlendedImplicitSurface": "lis_grasp.surfaces",
    "Contacts": "lis_grasp.contacts",
    "ForceClosureSampler": "lis_grasp.grasping.sampler",
    "GaussianProcessImplicitSurface": "lis_grasp.surfaces",
    "Grasp": "lis_grasp.grasping.grasps",
    "GraspSearch": "lis_grasp.grasping.grasps",
    "Hand": "lis_grasp.robots.hand",
    "ImplicitSurface": "lis_grasp.surfaces",
    "LocalImplicitSurface": "lis_grasp.surfaces",
    "PatchImplicitSurface": "lis_grasp.surfaces",
    "epsilon_quality": "lis_grasp.grasping.epsilon",
    "extract_mesh": "lis_grasp.meshing",
    "is_force_closure": "lis_grasp.grasping.force_closure",
    "pipeline": "lis_grasp.pipeline",
    "shapes": "lis_grasp.shapes",
    "surface_error": "lis_grasp.evaluation.surface_error",
}

__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> Any:
    """Load a public name from its home on first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'lis_grasp' has no attribute '{name}'")
    home = import_module(_HOMES[name])
    value = home if _HOMES[name] == f"lis_grasp.{name}" else getattr(home, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
