"""What all figures have in common: size, type, titles, scales, and how one becomes a PNG."""

from __future__ import annotations

import io
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from lis_grasp.experiments.figures.palette import (
    FAINT,
    INK,
    QUIET,
    estimator_colour,
    estimator_label,
)

WIDTH = 9.0
"""Of every figure [in]: at 100 dots an inch it is 900 pixels wide."""

SMALL, NORMAL, LARGE = 8.5, 9.5, 11.0
"""Sizes of type [pt]."""


def new_figure(height: float) -> Figure:
    """Return an empty white figure of the common width, `height` [in]."""
    return Figure(figsize=(WIDTH, height), dpi=100, facecolor="white")


def png_of(figure: Figure, *, dots_per_inch: int = 200) -> bytes:
    """Return a figure as PNG; equal figures give equal bytes."""
    stream = io.BytesIO()
    # Without the version of matplotlib, which it writes by default.
    figure.savefig(stream, format="png", dpi=dots_per_inch, metadata={"Software": None})
    return stream.getvalue()


def add_panel(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Return axes at a place given in shares of the figure."""
    return figure.add_axes((left, bottom, width, height))


def head(axes: Axes, text: str, *, colour: str = INK) -> None:
    """Write a panel's title above it."""
    axes.set_title(text, fontsize=NORMAL, color=colour, pad=6)


def head_estimator(figure: Figure, axes: Axes, name: str) -> None:
    """Write an estimator's name, in its colour, above a panel, at the panel's own top."""
    place = axes.get_position(original=True)  # axes of equal scales shrink when drawn
    figure.text(
        0.5 * (place.x0 + place.x1),
        place.y1,
        estimator_label(name),
        ha="center",
        va="bottom",
        fontsize=LARGE,
        color=estimator_colour(name),
        fontweight="bold",
    )


def side_note(figure: Figure, x: float, y: float, text: str) -> None:
    """Write text upwards left of a place given in shares of the figure."""
    figure.text(x, y, text, rotation=90, ha="right", va="center", fontsize=NORMAL, color=INK)


def foot_note(axes: Axes, text: str) -> None:
    """Write text below a panel, at the panel's own bottom."""
    place = axes.get_position(original=True)
    axes.figure.text(
        0.5 * (place.x0 + place.x1),
        place.y0,
        text,
        ha="center",
        va="top",
        fontsize=SMALL,
        color=INK,
    )


def colour_bar(
    figure: Figure,
    place: tuple[float, float, float, float],
    colours: Colormap,
    limits: tuple[float, float],
    label: str,
    *,
    ticks: Sequence[float],
    tick_labels: Sequence[str] | None = None,
) -> None:
    """Draw a horizontal colour bar at a place given in shares of the figure."""
    axes = figure.add_axes(place)
    bar = figure.colorbar(
        ScalarMappable(Normalize(*limits), colours), cax=axes, orientation="horizontal"
    )
    bar.set_ticks(list(ticks), labels=None if tick_labels is None else list(tick_labels))
    bar.ax.tick_params(labelsize=SMALL, length=2, color=QUIET, labelcolor=INK)
    bar.set_label(label, fontsize=SMALL, color=INK)
    bar.outline.set_visible(False)  # type: ignore[operator]


def plain_axes(axes: Axes, *, grid: bool = True) -> None:
    """Leave of a chart's frame what is read: two axes and a faint grid."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(QUIET)
    axes.tick_params(labelsize=SMALL, color=QUIET, labelcolor=INK)
    if grid:
        axes.grid(axis="y", color=FAINT, lw=0.8)
    axes.set_axisbelow(True)
