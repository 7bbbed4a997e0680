"""The table that an object stands on."""

from __future__ import annotations

import numpy as np
import trimesh
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    Box,
    GeometryId,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

_SIZE, _THICKNESS = 1.5, 0.1  # [m]
_MARGIN = 0.3  # [m] of table beyond what stands on it
# A ball of 10 cm and 0.5 kg sinks in by 0.2 mm: F = pi E R d^2 / (half the thickness).
_MODULUS = 5e7  # [Pa]
_DISSIPATION = 20.0  # [s/m], a thud, not a bounce


def add_table(
    plant: MultibodyPlant, height: float, friction: float, *, under: trimesh.Trimesh
) -> GeometryId:
    """Add a compliant table with its top at a height of W [m], and return its geometry.

    It is 1.5 m wide about W's origin, and wider where what stands on it, given in W, is elsewhere.
    A box: Drake 1.51 fails on a compliant half space against a rigid mesh.
    """
    size = max(_SIZE, 2.0 * (float(np.abs(under.bounds[:, :2]).max()) + _MARGIN))
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=_DISSIPATION,
        friction=CoulombFriction(friction, friction),
        properties=properties,
    )
    AddCompliantHydroelasticProperties(
        resolution_hint=0.1, hydroelastic_modulus=_MODULUS, properties=properties
    )
    X_WT = RigidTransform([0.0, 0.0, height - 0.5 * _THICKNESS])
    return plant.RegisterCollisionGeometry(
        plant.world_body(), X_WT, Box(size, size, _THICKNESS), "table", properties
    )
