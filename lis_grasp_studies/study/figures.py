"""Figures of a study: success rate against touches and edge error, epsilon predicted and true."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import cycle, pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.figures.palette import INK, QUIET, estimator_colour, estimator_label
from lis_grasp_studies.figures.style import (
    COLUMN,
    DRAWN_WIDTH,
    SMALL,
    WIDTH,
    add_panel,
    head,
    label_axes,
    new_figure,
)
from lis_grasp_studies.harness.page import Picture
from lis_grasp_studies.harness.statistics import SuccessRate, success_rate
from lis_grasp_studies.study.comparison import Kind, is_kind, kinds_of, names
from lis_grasp_studies.study.tables import KIND_LABELS
from lis_grasp_studies.study.trial import TRUTH

_LEFT, _WIDE = 0.075, 0.915
_BELOW = 0.85  # [in] between rows of panels, for labels and titles
_MARKERS = "osD^vPX*"
_SIDE_BY_SIDE = 0.3  # width of the estimators at a number of touches; 1 is the next number
_BINS, _LEAST = 4, 8  # bins of equal numbers of trials, at the most; trials in one


def draw_pictures(rows: Sequence[Row]) -> Iterator[Picture]:
    """Draw the figures one after the other."""
    for noise in names(rows, "noise"):
        chosen = [row for row in rows if row["noise"] == noise]
        yield Picture.of(
            f"Held against touches, noise: {noise}",
            "Success rate: trials whose best grasp lifted the true object and held it through the"
            " shake; a trial without a grasp is not held. Bars are 95 % intervals for other seeds.",
            *both_widths(held_against_touches, chosen),
        )
    yield Picture.of(
        "Epsilon on the estimate and on the truth",
        "Epsilon of the best grasp of every trial: planned on the estimate, and where its fingers"
        " meet the true object. Below the dashed line the estimate was too optimistic. Filled:"
        " held; empty: not held.",
        *both_widths(epsilon_against_truth, rows),
    )
    if any(row["edge_rmsd"] is not None for row in rows):
        yield Picture.of(
            "Held against the error at edges",
            "Trials on objects with edges, of all estimators together and of each, in bins of equal"
            " numbers of trials by their error at edges (a point is at the bin's median); bars are"
            " 95 % intervals for other seeds. If edges matter to grasps, the line falls.",
            *both_widths(held_against_edge_error, rows),
        )


def both_widths(
    draw: Callable[[Sequence[Row], float], Figure], rows: Sequence[Row]
) -> tuple[Figure, Figure]:
    """Return a figure two columns wide, and the same one column wide."""
    return draw(rows, WIDTH), draw(rows, COLUMN)


def held_against_touches(rows: Sequence[Row], width: float = WIDTH) -> Figure:
    """Draw the success rate over touches, a panel each kind of objects."""
    kinds = kinds_of(rows)
    figure, panels = _panels(len(kinds), columns=2, high=2.6, width=width)
    who = names(rows, "estimator")
    budgets = sorted(names(rows, "touches"))
    for kind, axes in zip(kinds, panels, strict=True):
        for n, name in enumerate(who):
            of = [row for row in rows if is_kind(row, kind) and row["estimator"] == name]
            held = [success_rate([row for row in of if row["touches"] == m]) for m in budgets]
            # Budgets are steps: evenly apart, and the estimators side by side close to each.
            places = np.arange(len(budgets)) + _SIDE_BY_SIDE * ((n + 0.5) / len(who) - 0.5)
            _rates(axes, places, held, estimator_colour(name), _MARKERS[n % len(_MARKERS)])
        axes.set_xticks(range(len(budgets)), [str(budget) for budget in budgets])
        axes.set_xlim(-0.5, len(budgets) - 0.5)
        head(axes, KIND_LABELS[kind])
        label_axes(axes, "touches", "held [%]" if _is_left(axes) else "")
        axes.set_ylim(0.0, 104.0)
    _legend(figure, who)
    return figure


def epsilon_against_truth(rows: Sequence[Row], width: float = WIDTH) -> Figure:
    """Plot epsilon on the true mesh against epsilon on the estimate, one panel per estimator."""
    who = names(rows, "estimator")
    figure, panels = _panels(len(who), columns=4, high=2.1, legend=0.15, width=width)
    known = [row for row in rows if row["epsilon_truth"] is not None]
    few = len(known) < 500
    largest = 1.05 * max(
        [max(row["epsilon_estimate"], row["epsilon_truth"]) for row in known], default=1.0
    )
    for name, axes in zip(who, panels, strict=True):
        axes.plot([0.0, largest], [0.0, largest], color=QUIET, lw=1.0, ls=(0, (4, 3)))
        for held in (False, True):
            of = [row for row in known if row["estimator"] == name and row["held"] == held]
            points = ([row[f"epsilon_{on}"] for row in of] for on in ("estimate", "truth"))
            colour = estimator_colour(name)
            size, alpha = (3.5, 0.75) if few else (2.0, 0.45)
            face = colour if held else "none"
            axes.plot(*points, "o", ms=size, mec=colour, mfc=face, mew=0.8, alpha=alpha)
        axes.set_xlim(0.0, largest)
        axes.set_ylim(-0.02 * largest, largest)
        axes.locator_params(nbins=4)
        axes.tick_params(labelleft=_is_left(axes))
        head(axes, estimator_label(name))
        label_axes(axes, "on the estimate", "on the truth" if _is_left(axes) else "")
    return figure


def held_against_edge_error(rows: Sequence[Row], width: float = WIDTH) -> Figure:
    """Draw the success rate over the error at edges, in bins of equal numbers."""
    kinds = [k for k in kinds_of(rows) if any(r["edge_rmsd"] is not None for r in _of(rows, k))]
    figure, panels = _panels(len(kinds), columns=2, high=2.6, width=width)
    who = [name for name in names(rows, "estimator") if name != TRUTH]  # which has no error
    for kind, axes in zip(kinds, panels, strict=True):
        known = [r for r in _of(rows, kind) if r["edge_rmsd"] is not None and r["estimator"] in who]
        groups = [("", known), *((n, [r for r in known if r["estimator"] == n]) for n in who)]
        for n, (name, of) in enumerate(groups):
            if not of:
                continue
            ordered = sorted(of, key=lambda row: (row["edge_rmsd"], row["key"]))
            count = min(max(len(ordered) // _LEAST, 1), _BINS)
            ends = [len(ordered) * i // count for i in range(count + 1)]
            bins = [ordered[a:b] for a, b in pairwise(ends)]
            places = np.array([1e3 * np.median([row["edge_rmsd"] for row in b]) for b in bins])
            colour = estimator_colour(name) if name else INK
            marker = _MARKERS[(n - 1) % len(_MARKERS)] if name else ""
            _rates(axes, places, [success_rate(b) for b in bins], colour, marker)
        axes.set_ylim(0.0, 104.0)
        axes.set_xlim(left=0.0)
        head(axes, KIND_LABELS[kind])
        label_axes(axes, "edges to estimate, RMSD [mm]", "held [%]" if _is_left(axes) else "")
    _legend(figure, who, more=[Line2D([], [], color=INK, lw=2.0, label="all")])
    return figure


def _rates(
    axes: Axes, places: np.ndarray, rates: Sequence[SuccessRate | None], colour: str, marker: str
) -> None:
    """Draw rates in percent with their intervals; None is left out."""
    known = [(x, rate) for x, rate in zip(places, rates, strict=True) if rate is not None]
    intervals = [(x, s.low, s.high) for x, s in known if s.low is not None and s.high is not None]
    for x, low, high in intervals:
        axes.vlines(x, 100.0 * low, 100.0 * high, color=colour, lw=1.2, alpha=0.6)
    shown = [x for x, _ in known], [100.0 * rate.value for _, rate in known]
    axes.plot(*shown, color=colour, marker=marker, lw=1.5, ms=5.0, mec="white", mew=0.7)


def _panels(
    count: int, *, columns: int, high: float, legend: float = 0.55, width: float = WIDTH
) -> tuple[Figure, list[Axes]]:
    """Return a figure of panels in rows, each `high` inches, below a legend of `legend` inches.

    `columns` are those of a figure of the whole width; one column of a page has half as many.
    """
    part = width / WIDTH
    columns = min(columns if part == 1.0 else columns // 2, count)
    rows = -(-count // columns)
    high *= 1.0 if columns > 1 else 0.6  # a column of panels fits on a page
    legend += 0.0 if part == 1.0 else 0.15  # for its second line
    total = legend + rows * (high + _BELOW)
    figure = new_figure(total, width, drawn_width=part * DRAWN_WIDTH)
    first = _LEFT / part
    wide = (_LEFT + _WIDE - first) / columns
    panels = []
    for k in range(count):
        down, across = divmod(k, columns)
        bottom = total - legend - (down + 1) * (high + _BELOW) + 0.75 * _BELOW
        left = first + across * wide
        panels.append(add_panel(figure, left, bottom / total, wide - 0.05, high / total))
    return figure, panels


def _is_left(axes: Axes) -> bool:
    return bool(axes.get_position().x0 < 0.2)


def _legend(figure: Figure, names: Sequence[str], *, more: Sequence[Line2D] = ()) -> None:
    handles = [
        Line2D([], [], color=estimator_colour(name), marker=marker, lw=2.0, label=label)
        for name, marker, label in zip(names, cycle(_MARKERS), map(estimator_label, names))
    ]
    columns = 6 if figure.get_figwidth() == WIDTH else 3
    style: dict[str, Any] = {"ncols": columns, "frameon": False, "fontsize": SMALL}
    style["labelcolor"] = INK
    figure.legend(handles=[*handles, *more], loc="upper left", **style)


def _of(rows: Sequence[Row], kind: Kind) -> list[Row]:
    return [row for row in rows if is_kind(row, kind)]
