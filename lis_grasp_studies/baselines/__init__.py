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
        "offset_gp": OffsetSurface.gaussian_process,
        "ransac_csg": PrimitiveCSGSurface.from_contacts,
        "poisson": MeshLabSurface.poisson,
        "rimls": MeshLabSurface.rimls,
        "apss": MeshLabSurface.apss,
    }
)
"""Every baseline by its short name. `offset_gp` needs scikit-learn, the last three need pymeshlab:
`pip install lis-grasp[baselines]`."""

__all__ = [
    "BASELINES",
    "HermiteRBFSurface",
    "MeshLabSurface",
    "OffsetSurface",
    "PrimitiveCSGSurface",
]
