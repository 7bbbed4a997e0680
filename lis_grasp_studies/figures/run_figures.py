"""Figures of a run for papers: its growing estimate, its best grasp, as PDF and PNG.

    lis-grasp run mallet --output results/mallet
    python -m lis_grasp_studies.figures.run_figures results/mallet --figures figures

Each is written 7.16 in and 3.5 in wide, two columns and one of an IEEE page, with type of 8 points.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from matplotlib.figure import Figure

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.provenance import read as read_facts
from lis_grasp.io.surface_files import load_growth
from lis_grasp.pipeline import Run
from lis_grasp.visualization.camera import View, choose_azimuth, surface_points
from lis_grasp.visualization.colours import ColourScale
from lis_grasp_studies.figures._solids import VIEW
from lis_grasp_studies.figures.static_scene import COLOURS, draw_still
from lis_grasp_studies.figures.style import COLUMN, WIDTH, add_panel, colour_bar, head, new_figure
from lis_grasp_studies.harness.page import Picture, write_figures
from lis_grasp_studies.harness.program import exit_code, read_options

_HIGH, _BAR = 2.0, 0.62  # [in] of panels, and of the colour bar below them


def run_picture(run: Run) -> Picture:
    """Return the estimates and the best grasp of a run, two columns and one column wide.

    InvalidFileError if the folder has no estimate with its contacts.
    """
    if run.mesh is None or run.contacts is None:
        raise InvalidFileError(
            f"{run.folder} has no estimate: name the folder of a run", path=run.folder
        )
    grown = load_growth(run.folder, read_facts(run.folder / "surface.ply"))
    stages = [(count, mesh) for count, mesh in grown if count < len(run.contacts)]
    stages = [*stages, (len(run.contacts), run.mesh)]
    some = [stages[k] for k in np.unique(np.linspace(0, len(stages) - 1, 3).astype(int))]
    return Picture.of(
        "Run",
        "The estimate after some touches, in the colour of its uncertainty, with the contacts and"
        " the edges of the true object; and the best grasp.",
        _drawn(run, some, WIDTH),
        _drawn(run, some[-1:], COLUMN),
    )


def _drawn(run: Run, stages: Sequence[tuple[int, trimesh.Trimesh]], width: float) -> Figure:
    assert run.contacts is not None
    assert run.mesh is not None
    best = run.grasps[0] if run.grasps else None
    number = len(stages) + (best is not None)
    high = min(_HIGH, width / number)
    figure = new_figure(high + _BAR + 0.25, width, drawn_width=width)
    tall = figure.get_figheight()
    deviations = [mesh.vertex_attributes.get("uncertainty") for _, mesh in stages]
    known = [values for values in deviations if values is not None]
    scale = ColourScale.of(np.concatenate(known)) if known else None
    solid = run.mesh if run.truth is None else run.truth.mesh
    azimuth = choose_azimuth(surface_points(solid), np.empty((0, 3)))
    looks: dict[str, Any] = {"truth": run.truth, "scale": scale}
    front = looks | {"view": View(azimuth, VIEW.elevation)}
    bottom, size = _BAR / tall, high / tall
    for k, (count, mesh) in enumerate(stages):
        axes = add_panel(figure, k / number, bottom, 1.0 / number, size)
        draw_still(axes, estimate=mesh, contacts=run.contacts[:count], **front)
        head(axes, f"{count} contacts")
    if best is not None:
        axes = add_panel(figure, (number - 1) / number, bottom, 1.0 / number, size)
        links = run.hand.forward_kinematics(best.X_OH, best.joint_positions)
        aside = View(np.arctan2(-best.X_OH[1, 3], -best.X_OH[0, 3]) + 0.5, np.radians(20))
        draw_still(axes, estimate=stages[-1][1], hand=run.hand, links=links, view=aside, **looks)
        head(axes, "best grasp")
    if scale is not None:
        values = 1e3 * np.linspace(scale.low, scale.high, 3)
        ticks = {float(value): f"{value:.2g}" for value in values}
        ticks[float(values[-1])] = f"\u2265 {values[-1]:.2g}"  # colours end there
        place = (0.25, 0.42 / tall, 0.5, 0.08 / tall)
        colour_bar(figure, place, COLOURS, "standard deviation of the surface [mm]", ticks)
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the figures; return the exit code."""
    options = read_options(__doc__, arguments, folder=Path, figures=Path("figures"))

    def work() -> None:
        write_figures(options.figures, [run_picture(Run.load(options.folder))])

    return exit_code("run_figures", work)


if __name__ == "__main__":
    sys.exit(main())
