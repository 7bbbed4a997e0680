"""Objects, contacts and estimates that the figures show, as in the paper's experiments."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp_studies.estimators import Noise, compared_estimator
from lis_grasp_studies.figures.painter import View

COLUMNS = ("gpis", "lis", "blend")
"""Estimators beside each other: the paper's two, then the package's default."""

KERNEL_WIDTH = 0.3
"""Width of the LIS kernel in figs. 2 and 5, in units of the contacts' spacing."""

VIEW = View(np.deg2rad(-55.0), np.deg2rad(28.0))
"""View of most objects."""

_VIEWS = {
    "half_cylinder": View(np.deg2rad(-35.0), np.deg2rad(28.0)),
    "hollow_cylinder": View(np.deg2rad(-55.0), np.deg2rad(38.0)),
    "torus": View(np.deg2rad(-55.0), np.deg2rad(42.0)),
}


def view_of(name: str) -> View:
    """Return the view of a built-in object."""
    return _VIEWS.get(name, VIEW)


def view_on(contacts: Contacts) -> View:
    """Return the view, at the usual elevation, that most contacts face."""
    views = [View(azimuth, VIEW.elevation) for azimuth in np.deg2rad(np.arange(-180, 180, 15))]
    facing = [np.clip(contacts.normals @ view.axes[2], 0.0, None).sum() for view in views]
    return views[int(np.argmax(facing))]


def estimate(name: str, contacts: Contacts) -> ImplicitSurface:
    """Return the surface that a compared estimator, given by its name, makes of exact contacts."""
    return compared_estimator(name)(contacts, Noise())


def estimated_mesh(
    name: str, contacts: Contacts, *, resolution: float | None = None
) -> trimesh.Trimesh:
    """Return the mesh of the estimated surface; resolution [m] as `extract_mesh` takes it."""
    return extract_mesh(estimate(name, contacts), resolution=resolution)
