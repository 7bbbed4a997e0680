"""Baseline surface reconstructions from contacts, with the ImplicitSurface protocol."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp_studies.baselines.hermite_rbf import HermiteRBFSurface
from lis_grasp_studies.baselines.meshlab_surface import MeshLabSurface
from lis_grasp_studies.baselines.offset_surface import OffsetSurface
from lis_grasp_studies.baselines.primitive_csg_surface import PrimitiveCSGSurface

BASELINES: Mapping[str, Callable[[Contacts], ImplicitSurface]] = MappingProxyType(
    {
        "hermite_rbf": HermiteRBFSurface.from_contacts,
        "offset_rbf": OffsetSurface.thin_plate,
        "ransac_csg": PrimitiveCSGSurface.from_contacts,
    }
)
"""Every baseline that needs no other package, by its short name."""

__all__ = [
    "BASELINES",
    "HermiteRBFSurface",
    "MeshLabSurface",
    "OffsetSurface",
    "PrimitiveCSGSurface",
]
