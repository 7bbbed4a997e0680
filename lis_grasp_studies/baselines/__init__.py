"""Baseline surface reconstructions from contacts, with the ImplicitSurface protocol."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp_studies.baselines.hermite_rbf import HermiteRBFSurface
from lis_grasp_studies.baselines.offset_surface import OffsetSurface
from lis_grasp_studies.baselines.primitive_csg_surface import PrimitiveCSGSurface

BASELINES: Mapping[str, Callable[[Contacts], ImplicitSurface]] = MappingProxyType(
    {
        "hermite_rbf": HermiteRBFSurface.from_contacts,
        "offset_rbf": OffsetSurface.thin_plate,
        "ransac_csg": PrimitiveCSGSurface.from_contacts,
    }
)
"""Every baseline by its short name."""

__all__ = [
    "BASELINES",
    "HermiteRBFSurface",
    "OffsetSurface",
    "PrimitiveCSGSurface",
]
