"""Figure of a run for papers: object, estimate with contacts, and best grasp from two views.

Text and colour bar are vectors; the pictures are those of the z-buffer, at the figure's resolution.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.pipeline import Run
from lis_grasp.results.run_results import SOURCES
from lis_grasp.visualization.camera import View
from lis_grasp.visualization.colours import viridis
from lis_grasp.visualization.still import Still, uncertainty_scale
from lis_grasp_studies.figures.palette import TRUTH
from lis_grasp_studies.figures.style import add_panel, colour_bar, head, new_figure

DOTS_PER_INCH = 400
"""Of the pictures, which journals ask for."""

# Fractions of a panel's width, and heights [in] of the heads and of the colour bar.
_TALL, _HEAD, _BAR = 0.75, 0.25, 0.55
_COLOURS = ListedColormap(viridis(np.linspace(0.0, 1.0, 256)))


@dataclass(frozen=True, slots=True, eq=False)
class _Column:
    """A column of the figure: its head, its content, and the solid that its window shows."""

    title: str
    still: Still
    framed: Still


def run_figure(run: Run, width: float) -> Figure:
    """Return a figure of a run, `width` wide [in].

    Raises `InvalidFileError` if a file of a stage is missing.
    """
    _require_stages(run)
    assert run.mesh is not None
    columns = [*_columns(run)]
    wide = width / len(columns)
    tall = _TALL * wide
    figure = new_figure(2.0 * tall + _HEAD + _BAR, width, drawn_width=width)
    height = figure.get_figheight()
    front = columns[-1].still.best_view()
    for row, view in enumerate((front, View(front.azimuth + 0.5 * np.pi, front.elevation))):
        for place, column in enumerate(columns):
            bottom = (_BAR + (1 - row) * tall) / height
            axes = add_panel(
                figure, place / len(columns), bottom, 1.0 / len(columns), tall / height
            )
            dots = (round(DOTS_PER_INCH * wide), round(DOTS_PER_INCH * tall))
            axes.imshow(column.still.draw(column.framed.window(view, dots)), aspect="auto")
            axes.set_axis_off()
            if row == 0:
                head(axes, column.title)
    _draw_scale(figure, run)
    return figure


def _require_stages(run: Run) -> None:
    missing = [name for name in SOURCES[::-1] if not (run.folder / name).is_file()]
    if missing:
        raise InvalidFileError(
            f"{run.folder} has no {missing[0]}: a figure needs {', '.join(SOURCES[::-1])}, which"
            " `lis-grasp run` writes",
            path=run.folder / missing[0],
        )


def _columns(run: Run) -> Iterator[_Column]:
    """Yield the true object, where it is recorded, the estimate, and the grasp, if there is one."""
    assert run.mesh is not None
    assert run.contacts is not None
    solids = [run.mesh] if run.truth is None else [run.mesh, run.truth.mesh]
    both = Still(solid=trimesh.util.concatenate([_bare(solid) for solid in solids]))
    if run.truth is not None:
        yield _Column("object", Still(solid=_bare(run.truth.mesh), colour=TRUTH), both)
    size = _size(run)
    title = f"estimate from {len(run.contacts)} contacts"
    yield _Column(title, Still(solid=run.mesh, contacts=run.contacts, size=size), both)
    if run.grasps:
        grasp = Still(solid=run.mesh, hand=run.hand, grasp=run.grasps[0], size=size)
        yield _Column("best grasp", grasp, grasp)


def _bare(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def _size(run: Run) -> float:
    assert run.mesh is not None
    return float((run.mesh if run.truth is None else run.truth.mesh).extents.max())


def _draw_scale(figure: Figure, run: Run) -> None:
    assert run.mesh is not None
    scale, height = uncertainty_scale(run.mesh, _size(run)), figure.get_figheight()
    if scale is None:
        return
    values = 1e3 * np.linspace(scale.low, scale.high, 3)
    ticks = {float(value): f"{value:.2g}" for value in values}
    ticks[float(values[-1])] = f"\u2265 {values[-1]:.2g}"  # colours end there
    place = (0.3, 0.4 / height, 0.4, 0.08 / height)
    colour_bar(figure, place, _COLOURS, "standard deviation of the surface [mm]", ticks)
