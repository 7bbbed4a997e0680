"""Fig. 6: the objects of the experiments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from lis_grasp import shapes
from lis_grasp.experiments.figures.experiment import view_of
from lis_grasp.experiments.figures.painter import frame_of, paint
from lis_grasp.experiments.figures.solids import solid_patches
from lis_grasp.experiments.figures.style import add_panel, foot_note, new_figure

_COLUMNS = 4


def figure_6(*, names: Sequence[str] = shapes.NAMES) -> Figure:
    """Draw built-in objects of the paper's size with their sharp edges.

    Parameters
    ----------
    names
        Of the objects.
    """
    scenes = [solid_patches(view_of(n), shapes.build(n, shapes.PAPER_SIZE).mesh) for n in names]
    frames = np.array([frame_of(scene) for scene in scenes])
    half = 0.5 * np.ptp(frames, axis=1).max(axis=0)  # one scale for all
    rows = -(-len(names) // _COLUMNS)
    figure = new_figure(2.55 * rows)
    for k, name in enumerate(names):
        row, column = divmod(k, _COLUMNS)
        width, height = 1.0 / _COLUMNS, 1.0 / rows
        axes = add_panel(
            figure,
            (column + 0.06) * width,
            (rows - 1 - row + 0.12) * height,
            0.88 * width,
            0.85 * height,
        )
        paint(axes, scenes[k], frame=frames[k].mean(axis=0) + [-half, half])
        foot_note(axes, name.replace("_", " "))
    return figure
