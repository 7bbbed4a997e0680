"""The figures of a study's report, in its order, with what there is to see on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import binomtest

from lis_grasp.json_lines import Row
from lis_grasp.paper_report.page import Picture
from lis_grasp.study.comparison import KINDS, kind_of
from lis_grasp.visualization.figures import png_of
from lis_grasp.visualization.figures.palette import (
    INK,
    QUIET,
    estimator_colour,
    estimator_label,
)
from lis_grasp.visualization.figures.style import (
    NORMAL,
    SMALL,
    add_panel,
    head,
    new_figure,
    plain_axes,
)

_LEFT, _WIDE, _BOTTOM, _HIGH = 0.075, 0.915, 0.17, 0.64
_MARKERS = "osD^vPX"
_BINS, _LEAST = 4, 8  # bins of equal numbers of trials, at the most; trials in one


def draw_pictures(rows: Sequence[Row]) -> Iterator[Picture]:
    """Draw the figures one after the other."""
    for noise in dict.fromkeys(row["noise"] for row in rows):
        chosen = [row for row in rows if row["noise"] == noise]
        yield Picture(
            f"Held against touches, noise: {noise}",
            "Share of trials whose best grasp lifted the true object and held it through the shake;"
            " a trial without a grasp is not held. Bars are 95 % intervals of Wilson (1927), which"
            " take trials as independent; touches are set apart a little to be told apart.",
            png_of(held_against_touches(chosen)),
        )
    yield Picture(
        "What the estimate promises, and what the truth keeps",
        "Epsilon of the best grasp of every trial, planned on the estimate, against the epsilon of"
        " the same grasp where its fingers meet the true object. On the dashed line both are equal;"
        " below it the estimate promised too much. Full: held; hollow: not held.",
        png_of(promise_against_truth(rows)),
    )
    if any(row["edge_rmsd"] is not None for row in rows):
        yield Picture(
            "Held against the error at edges",
            "Trials on objects with edges, of all estimators together and of each, in bins of equal"
            " numbers of trials by their error at edges; bars are 95 % intervals of"
            " Wilson. If edges matter to grasps, the line falls.",
            png_of(held_against_edge_error(rows)),
        )


def held_against_touches(rows: Sequence[Row]) -> Figure:
    """Draw the share of held grasps over touches, edged and curved objects beside each other."""
    figure = new_figure(3.6)
    kinds = [kind for kind in KINDS if any(kind_of(row) == kind for row in rows)]
    names = _estimators(rows)
    budgets = sorted({row["touches"] for row in rows})
    gap = 0.02 * max(budgets[-1] - budgets[0], 1)
    for k, kind in enumerate(kinds):
        axes = _panel(figure, k, len(kinds))
        for n, name in enumerate(names):
            held = [
                [r["held"] for r in rows if _is(r, kind, name) and r["touches"] == budget]
                for budget in budgets
            ]
            places = np.array(budgets, dtype=np.float64) + gap * (n - 0.5 * (len(names) - 1))
            _shares(axes, places, held, estimator_colour(name), _MARKERS[n % len(_MARKERS)])
        axes.set_xticks(budgets, [str(budget) for budget in budgets])
        _finish(axes, f"{kind} objects", "touches", "held [%]" if k == 0 else "")
        axes.set_ylim(0.0, 104.0)
    _legend(figure, names)
    return figure


def promise_against_truth(rows: Sequence[Row]) -> Figure:
    """Draw epsilon on the truth over epsilon on the estimate, a panel each estimator."""
    figure = new_figure(3.4)
    names = _estimators(rows)
    known = [row for row in rows if row["epsilon_truth"] is not None]
    largest = 1.05 * max(
        [max(row["epsilon_estimate"], row["epsilon_truth"]) for row in known], default=1.0
    )
    for k, name in enumerate(names):
        axes = _panel(figure, k, len(names), bottom=0.17, high=0.7)
        axes.plot([0.0, largest], [0.0, largest], color=QUIET, lw=1.0, ls=(0, (4, 3)))
        for held in (False, True):
            of = [row for row in known if row["estimator"] == name and row["held"] == held]
            axes.plot(
                [row["epsilon_estimate"] for row in of],
                [row["epsilon_truth"] for row in of],
                "o",
                ms=3.5,
                mec=estimator_colour(name),
                mfc=estimator_colour(name) if held else "none",
                mew=0.8,
                alpha=0.75,
            )
        axes.set_xlim(0.0, largest)
        axes.set_ylim(-0.02 * largest, largest)
        _finish(axes, estimator_label(name), "on the estimate", "on the truth" if k == 0 else "")
    return figure


def held_against_edge_error(rows: Sequence[Row]) -> Figure:
    """Draw the share of held grasps over the error at edges, in bins of equal numbers."""
    figure = new_figure(3.6)
    names = _estimators(rows)
    axes = _panel(figure, 0, 1)
    known = [row for row in rows if row["edge_rmsd"] is not None]
    groups = [("", known), *((n, [r for r in known if r["estimator"] == n]) for n in names)]
    for n, (name, of) in enumerate(groups):
        ordered = sorted(of, key=lambda row: (row["edge_rmsd"], row["key"]))
        count = min(max(len(ordered) // _LEAST, 1), _BINS)
        bins = [b for b in np.array_split(np.array(ordered, dtype=object), count) if len(b)]
        places = np.array([1e3 * np.mean([row["edge_rmsd"] for row in b]) for b in bins])
        held = [[row["held"] for row in b] for b in bins]
        colour = estimator_colour(name) if name else INK
        _shares(axes, places, held, colour, _MARKERS[(n - 1) % len(_MARKERS)] if name else "")
    axes.set_ylim(0.0, 104.0)
    axes.set_xlim(left=0.0)
    _finish(axes, "", "edges to estimate, RMSD [mm]", "held [%]")
    _legend(figure, names, more=[Line2D([], [], color=INK, lw=2.0, label="all")])
    return figure


def _shares(
    axes: Axes, places: np.ndarray, held: Sequence[Sequence[bool]], colour: str, marker: str
) -> None:
    """Draw shares in percent with their 95 % intervals; what has no trial is left out."""
    kept = [k for k, trials in enumerate(held) if len(trials)]
    shares, lows, highs = [], [], []
    for k in kept:
        result = binomtest(sum(held[k]), len(held[k]))
        interval = result.proportion_ci(method="wilson")
        shares.append(100.0 * result.statistic)
        lows.append(100.0 * interval.low)
        highs.append(100.0 * interval.high)
    axes.vlines(places[kept], lows, highs, color=colour, lw=1.2, alpha=0.6)
    axes.plot(
        places[kept], shares, color=colour, marker=marker, lw=2.0, ms=5.5, mec="white", mew=0.7
    )


def _panel(
    figure: Figure, index: int, count: int, *, bottom: float = _BOTTOM, high: float = _HIGH
) -> Axes:
    width = _WIDE / count
    return add_panel(figure, _LEFT + index * width, bottom, width - 0.045, high)


def _finish(axes: Axes, title: str, xlabel: str, ylabel: str) -> None:
    plain_axes(axes)
    head(axes, title)
    axes.set_xlabel(xlabel, fontsize=NORMAL, color=INK)
    axes.set_ylabel(ylabel, fontsize=NORMAL, color=INK)


def _legend(figure: Figure, names: Sequence[str], *, more: Sequence[Line2D] = ()) -> None:
    handles = [
        Line2D(
            [],
            [],
            color=estimator_colour(name),
            marker=_MARKERS[n % len(_MARKERS)],
            lw=2.0,
            label=estimator_label(name),
        )
        for n, name in enumerate(names)
    ]
    figure.legend(
        handles=[*handles, *more],
        loc="upper left",
        ncols=6,
        frameon=False,
        fontsize=SMALL,
        labelcolor=INK,
    )


def _is(row: Row, kind: str, estimator: str) -> bool:
    return kind_of(row) == kind and row["estimator"] == estimator


def _estimators(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row["estimator"] for row in rows))
