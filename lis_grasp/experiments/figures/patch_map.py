"""Map of the patch estimator's segmentation: contacts and surface coloured by patch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from lis_grasp.experiments.figures.figure_inputs import explored_object, view_of
from lis_grasp.experiments.figures.painter import mesh_patches, paint, point_patches
from lis_grasp.experiments.figures.palette import INK, rgba
from lis_grasp.experiments.figures.solids import LIFT, sharp_patches
from lis_grasp.experiments.figures.style import add_panel, foot_note, new_figure
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import PatchImplicitSurface
from lis_grasp.typing import FloatArray, IndexArray

# Paul Tol's bright and light colours: neighbours in the list differ most.
_COLOURS = ("#4477AA", "#EE6677", "#228833", "#CCBB44", "#66CCEE", "#AA3377", "#EE8866", "#BBBBBB")


def patch_map(*, names: Sequence[str] = ("mallet", "half_cylinder")) -> Figure:
    """Draw contacts of explored objects, and the estimate, in the colours of the patches."""
    figure = new_figure(4.4)
    width = 1.0 / len(names)
    for k, name in enumerate(names):
        surface = PatchImplicitSurface.from_contacts(explored_object(name, 3)[1].contacts)
        mesh, view = extract_mesh(surface), view_of(name)
        colours = np.array([rgba(_COLOURS[p % len(_COLOURS)]) for p in _patch_of(surface)])
        pale = 0.5 + 0.5 * colours
        facing = view.faces(surface.normals)
        scene = [
            mesh_patches(view, mesh, pale[_owners(surface, mesh.triangles_center)]),
            sharp_patches(view, mesh),
        ]
        for colour in np.unique(colours[facing], axis=0):
            chosen = surface.points[facing & (colours == colour).all(axis=1)]
            shown = to_hex(colour)
            scene.append(point_patches(view, chosen, INK, radius=0.0042, lift=2.0 * LIFT))
            scene.append(point_patches(view, chosen, shown, radius=0.0033, lift=2.1 * LIFT))
        axes = add_panel(figure, k * width, 0.08, width, 0.9)
        paint(axes, scene)
        foot_note(axes, f"{len(surface.points)} contacts, {len(surface.patches)} patches")
    return figure


def _patch_of(surface: PatchImplicitSurface) -> IndexArray:
    """Return the patch of each contact, shape (N,)."""
    patch_of = np.empty(len(surface.points), dtype=np.intp)
    for p, patch in enumerate(surface.patches):
        patch_of[patch.members] = p
    return patch_of


def _owners(surface: PatchImplicitSurface, points: FloatArray) -> IndexArray:
    """Return a contact of the patch that makes the surface at each point, shape (P,).

    Of patches with contacts near by, the one whose function is nearest to 0 there.
    """
    tree = cKDTree(surface.points)
    near = tree.query(points, k=min(12, len(surface.points)))[1].reshape(len(points), -1)
    patch_of = _patch_of(surface)
    values = np.stack(
        [np.abs(p.evaluate(points, with_gradient=False)[0]) for p in surface.patches], axis=1
    )  # (P, K)
    rows = np.arange(len(points))
    best = np.argmin(values[rows[:, None], patch_of[near]], axis=1)
    return np.asarray(near[rows, best])
