"""Surfaces estimated from contacts: one protocol, one file per estimator."""

from lis_grasp._moved import module_names
from lis_grasp.surfaces.blended_implicit_surface import BlendedImplicitSurface
from lis_grasp.surfaces.carved_implicit_surface import FreeSpace, Remainder, carved
from lis_grasp.surfaces.contact_loading import load_contacts
from lis_grasp.surfaces.contact_verdicts import ContactVerdicts, judge_contacts, orient_normals
from lis_grasp.surfaces.estimators import ESTIMATORS, Estimator
from lis_grasp.surfaces.gaussian_process_implicit_surface import GaussianProcessImplicitSurface
from lis_grasp.surfaces.implicit_surface import DeferredSurface, ImplicitSurface
from lis_grasp.surfaces.local_implicit_surface import LocalImplicitSurface
from lis_grasp.surfaces.normal_estimation import estimate_normals
from lis_grasp.surfaces.patch_implicit_surface import PatchImplicitSurface
from lis_grasp.surfaces.smooth_implicit_surface import SmoothImplicitSurface

__all__ = [
    "ESTIMATORS",
    "BlendedImplicitSurface",
    "ContactVerdicts",
    "DeferredSurface",
    "Estimator",
    "FreeSpace",
    "GaussianProcessImplicitSurface",
    "ImplicitSurface",
    "LocalImplicitSurface",
    "PatchImplicitSurface",
    "Remainder",
    "SmoothImplicitSurface",
    "carved",
    "estimate_normals",
    "judge_contacts",
    "load_contacts",
    "orient_normals",
]
__getattr__, __dir__ = module_names(__name__, __all__)
