"""Surfaces estimated from contacts: one protocol, one file per estimator."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from lis_grasp.surfaces.blended_implicit_surface import BlendedImplicitSurface
from lis_grasp.surfaces.carved_implicit_surface import CarvedImplicitSurface, carved
from lis_grasp.surfaces.contact_loading import load_contacts
from lis_grasp.surfaces.gaussian_process import GaussianProcessImplicitSurface
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.surfaces.local_implicit_surface import LocalImplicitSurface
from lis_grasp.surfaces.normal_estimation import estimate_normals
from lis_grasp.surfaces.patch_implicit_surface import PatchImplicitSurface

Estimator = Callable[..., ImplicitSurface]
"""Makes a surface from `Contacts`; keywords give the sensor's noise and options."""

ESTIMATORS: Mapping[str, Estimator] = MappingProxyType(
    {
        "lis": LocalImplicitSurface.from_contacts,
        "gpis": GaussianProcessImplicitSurface.from_contacts,
        "patch": PatchImplicitSurface.from_contacts,
        "blend": BlendedImplicitSurface.from_contacts,
    }
)
"""Every estimator by its short name, with its default options."""

__all__ = [
    "ESTIMATORS",
    "BlendedImplicitSurface",
    "CarvedImplicitSurface",
    "Estimator",
    "GaussianProcessImplicitSurface",
    "ImplicitSurface",
    "LocalImplicitSurface",
    "PatchImplicitSurface",
    "carved",
    "estimate_normals",
    "load_contacts",
]
