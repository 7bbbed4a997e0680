"""Common style of the figures: size, type, titles, axes, colour bars, and PNG output."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, Literal

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from lis_grasp_studies.figures.palette import (
    FAINT,
    INK,
    QUIET,
    estimator_colour,
    estimator_label,
)

WIDTH, COLUMN = 7.16, 3.5
"""Of figures [in]: the two columns of an IEEE page, and one of them."""

SMALL, NORMAL, LARGE = 8.0, 8.5, 9.5
"""Sizes of type [pt]."""

DRAWN_WIDTH = 9.0
"""For which figures give their heights [in]."""


def new_figure(height: float, width: float = WIDTH, *, drawn_width: float = DRAWN_WIDTH) -> Figure:
    """Return an empty white figure; `height` is for the drawn width, and scaled to `width` [in]."""
    size = (width, height * width / drawn_width)
    return Figure(figsize=size, dpi=100, facecolor="white")


# What matplotlib writes about itself and the time.
_FACTS = {
    "png": ("Software",),
    "pdf": ("CreationDate", "Producer", "Creator"),
    "svg": ("Date", "Creator"),
}


def file_of(figure: Figure, kind: str, *, dots_per_inch: int) -> bytes:
    """Return a figure as "png", "pdf" or "svg"; equal figures give equal bytes."""
    stream, nothing = io.BytesIO(), dict.fromkeys(_FACTS[kind])
    with rc_context({"svg.hashsalt": "lis_grasp"}):  # names of its parts are random otherwise
        figure.savefig(stream, format=kind, dpi=dots_per_inch, metadata=nothing)
    return stream.getvalue()


def png_of(figure: Figure, *, dots_per_inch: int = 250) -> bytes:
    """Return a figure as PNG; equal figures give equal bytes."""
    return file_of(figure, "png", dots_per_inch=dots_per_inch)


def pdf_of(figure: Figure) -> bytes:
    """Return a figure as PDF; equal figures give equal bytes."""
    return file_of(figure, "pdf", dots_per_inch=int(figure.dpi))


def add_panel(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Return new axes at a place given in fractions of the figure."""
    return figure.add_axes((left, bottom, width, height))


def head(axes: Axes, text: str, side: Literal["left", "center"] = "center") -> None:
    """Write a panel's title above it."""
    axes.set_title(text, fontsize=NORMAL, color=INK, pad=6, loc=side)


def head_estimator(axes: Axes, name: str) -> None:
    """Write an estimator's name, in its colour, above a panel."""
    colour = estimator_colour(name)
    _write_at(axes, "top", estimator_label(name), fontsize=LARGE, color=colour, fontweight="bold")


def foot_note(axes: Axes, text: str) -> None:
    """Write text below a panel."""
    _write_at(axes, "bottom", text, fontsize=SMALL, color=INK)


def side_note(figure: Figure, x: float, y: float, text: str) -> None:
    """Write upward text left of a place given in fractions of the figure."""
    figure.text(x, y, text, rotation=90, ha="right", va="center", fontsize=NORMAL, color=INK)


def _write_at(axes: Axes, side: Literal["top", "bottom"], text: str, **font: Any) -> None:
    place = axes.get_position(original=True)  # axes of equal scales shrink when drawn
    y, va = (place.y1, "bottom") if side == "top" else (place.y0, "top")
    axes.figure.text(0.5 * (place.x0 + place.x1), y, text, ha="center", va=va, **font)


def colour_bar(
    figure: Figure,
    place: tuple[float, float, float, float],
    colours: Colormap,
    label: str,
    ticks: Mapping[float, str],
) -> None:
    """Draw a horizontal colour bar from the first to the last of its labelled ticks.

    `place` is left, bottom, width and height in fractions of the figure.
    """
    scale = Normalize(min(ticks), max(ticks))
    bar = figure.colorbar(
        ScalarMappable(scale, colours), cax=figure.add_axes(place), orientation="horizontal"
    )
    bar.set_ticks(list(ticks), labels=list(ticks.values()))
    bar.ax.tick_params(labelsize=SMALL, length=2, color=QUIET, labelcolor=INK)
    bar.set_label(label, fontsize=SMALL, color=INK)
    bar.outline.set_visible(False)  # type: ignore[operator]


def label_axes(axes: Axes, xlabel: str, ylabel: str) -> None:
    """Label a chart's axes, and reduce its frame to two lines and a faint grid."""
    axes.set_xlabel(xlabel, fontsize=NORMAL, color=INK)
    axes.set_ylabel(ylabel, fontsize=NORMAL, color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(QUIET)
    axes.tick_params(labelsize=SMALL, color=QUIET, labelcolor=INK)
    axes.grid(axis="y", color=FAINT, lw=0.8)
    axes.set_axisbelow(True)
