"""A mesh as FCL wants it."""

from __future__ import annotations

import fcl
import numpy as np
import trimesh


def bounding_volumes(mesh: trimesh.Trimesh) -> fcl.BVHModel:
    """Return FCL's bounding-volume hierarchy of a mesh's faces."""
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    model.endModel()
    return model
