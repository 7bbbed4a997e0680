"""Figs. 6 and 7, the objects and an explored region; the map of the patch estimator's patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from scipy.spatial import cKDTree

from lis_grasp import Contacts, shapes
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import PatchImplicitSurface
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.visualization.camera import View
from lis_grasp_studies.figures import palette
from lis_grasp_studies.figures._solids import (
    LIFT,
    VIEW,
    contact_patches,
    estimated_mesh,
    sharp_patches,
    solid_patches,
    two_tone_patches,
    view_of,
    view_on,
)
from lis_grasp_studies.figures.painter import (
    frame_of,
    mesh_patches,
    overlay_lines,
    paint,
    point_patches,
)
from lis_grasp_studies.figures.style import NORMAL, add_panel, foot_note, head, new_figure
from lis_grasp_studies.paper.trials import EXPLORED_RADIUS, explored

_COLUMNS = 4
_STRAY = (-0.04, -0.09, 0.09)  # [m]

# Paul Tol's bright and light colours: neighbours in the list differ most.
_COLOURS = ("#4477AA", "#EE6677", "#228833", "#CCBB44", "#66CCEE", "#AA3377", "#EE8866", "#BBBBBB")


def figure_6() -> Figure:
    """Draw the built-in objects at the paper's size, with their sharp edges."""
    names = shapes.NAMES
    scenes = [solid_patches(view_of(n), shapes.build(n, shapes.PAPER_SIZE).mesh) for n in names]
    frames = np.array([frame_of(scene) for scene in scenes])
    half = 0.5 * np.ptp(frames, axis=1).max(axis=0)  # one scale for all
    rows = -(-len(names) // _COLUMNS)
    figure = new_figure(2.55 * rows)
    width, height = 1.0 / _COLUMNS, 1.0 / rows
    for k, name in enumerate(names):
        row, column = divmod(k, _COLUMNS)
        left, bottom = (column + 0.06) * width, (rows - 1 - row + 0.12) * height
        axes = add_panel(figure, left, bottom, 0.88 * width, 0.85 * height)
        paint(axes, scenes[k], frame=frames[k].mean(axis=0) + [-half, half])
        foot_note(axes, name.replace("_", " "))
    return figure


def figure_7() -> Figure:
    """Draw a half-explored object from two sides: yellow within 50 mm of a contact, else red."""
    shape, walk = explored("pentagon", 0)
    contacts, mesh = walk.until(0.5), shape.mesh
    figure = new_figure(4.6)
    front = view_on(contacts)
    back = View(front.azimuth + np.pi, front.elevation)
    colours = palette.EXPLORED, palette.UNEXPLORED
    for k, (view, side) in enumerate([(front, "front"), (back, "back")]):
        axes = add_panel(figure, 0.08 + 0.44 * k, 0.14, 0.4, 0.85)
        regions = two_tone_patches(view, mesh, contacts, EXPLORED_RADIUS, colours, piece=0.0007)
        paint(axes, [regions, sharp_patches(view, mesh), *contact_patches(view, contacts)])
        foot_note(axes, side)
    figure.legend(
        [Patch(color=colour) for colour in colours],
        ("explored: within 50 mm of a contact", "not explored"),
        loc="lower center",
        ncols=2,
        frameon=False,
        fontsize=NORMAL,
        labelcolor=palette.INK,
    )
    return figure


def patch_map(*, names: Sequence[str] = ("mallet", "half_cylinder")) -> Figure:
    """Draw contacts of explored objects, and the estimate, in the colours of the patches."""
    figure = new_figure(4.4)
    width = 1.0 / len(names)
    for k, name in enumerate(names):
        surface = PatchImplicitSurface.from_contacts(explored(name, 3)[1].contacts)
        mesh, view = extract_mesh(surface), view_of(name)
        colours = np.array([palette.rgba(_COLOURS[p % len(_COLOURS)]) for p in surface.patch_of])
        pale = 0.5 + 0.5 * colours
        facing = view.faces(surface.normals)
        scene = [
            mesh_patches(view, mesh, pale[_owners(surface, mesh.triangles_center)]),
            sharp_patches(view, mesh),
        ]
        for colour in np.unique(colours[facing], axis=0):
            chosen = surface.points[facing & (colours == colour).all(axis=1)]
            shown = to_hex(colour)
            scene.append(point_patches(view, chosen, palette.INK, radius=0.0042, lift=2.0 * LIFT))
            scene.append(point_patches(view, chosen, shown, radius=0.0033, lift=2.1 * LIFT))
        axes = add_panel(figure, k * width, 0.08, width, 0.9)
        paint(axes, scene)
        foot_note(axes, f"{len(surface.points)} contacts, {len(surface.patches)} patches")
    return figure


def bad_set() -> tuple[Contacts, list[int]]:
    """Return contacts of a mallet, and the rows of the bad ones: two flipped, one stray."""
    mesh, flipped = shapes.build("mallet", shapes.PAPER_SIZE).mesh, [9, 53]
    points, faces = trimesh.sample.sample_surface_even(mesh, 60, seed=1)
    normals = np.vstack([mesh.face_normals[faces], [0.0, 0.0, 1.0]])
    normals[flipped] *= -1.0
    return Contacts(np.vstack([points, _STRAY]), normals), [*flipped, len(points)]


def bad_contacts() -> Figure:
    """Draw a mallet estimated from contacts of which three are bad: all believed, then judged."""
    told, rows = bad_set()
    bad = told.subset(rows)
    arrows = np.stack([bad.points, bad.points + 0.03 * bad.normals], axis=1)
    figure = new_figure(3.8)
    for k, title in enumerate(("all believed", "two turned, one left out")):
        mesh = estimated_mesh("blend", replace(told, judged=k == 0))
        axes = add_panel(figure, 0.5 * k, 0.02, 0.5, 0.86)
        dots = point_patches(VIEW, bad.points, palette.BAD, radius=0.005, lift=1.0)
        solid = solid_patches(VIEW, mesh, palette.SURFACE)
        paint(axes, [*solid, *contact_patches(VIEW, told), dots])
        overlay_lines(axes, VIEW, arrows, palette.rgba(palette.BAD)[None], points=1.8)
        head(axes, title)
    return figure


def _owners(surface: PatchImplicitSurface, points: FloatArray) -> IndexArray:
    """Return a contact of the patch that makes the surface at each point, shape (P,).

    Of patches with contacts near by, the one whose function is nearest to 0 there.
    """
    tree = cKDTree(surface.points)
    near = tree.query(points, k=min(12, len(surface.points)))[1].reshape(len(points), -1)
    patch_of = surface.patch_of
    values = np.abs(surface.joined.values(points).T)  # (P, K)
    rows = np.arange(len(points))
    best = np.argmin(values[rows[:, None], patch_of[near]], axis=1)
    return np.asarray(near[rows, best])
