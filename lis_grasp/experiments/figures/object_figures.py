"""Figs. 6 and 7: the objects of the experiments, and the explored region of one of them."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from lis_grasp import shapes
from lis_grasp.experiments.figures.figure_inputs import explored_object, view_of, view_on
from lis_grasp.experiments.figures.painter import View, frame_of, paint
from lis_grasp.experiments.figures.palette import EXPLORED, INK, UNEXPLORED
from lis_grasp.experiments.figures.solids import (
    contact_patches,
    sharp_patches,
    solid_patches,
    two_tone_patches,
)
from lis_grasp.experiments.figures.style import NORMAL, add_panel, foot_note, new_figure
from lis_grasp.experiments.paper.paper_trials import EXPLORED_RADIUS

_COLUMNS = 4


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
    shape, walk = explored_object("pentagon", 0)
    contacts, mesh = walk.until(0.5), shape.mesh
    figure = new_figure(4.6)
    front = view_on(contacts)
    back = View(front.azimuth + np.pi, front.elevation)
    colours = EXPLORED, UNEXPLORED
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
        labelcolor=INK,
    )
    return figure
