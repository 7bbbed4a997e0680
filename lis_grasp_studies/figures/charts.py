"""Charts of results: bars per object (figs. 9, 10), curves over noise (fig. 12), calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.typing import FloatArray
from lis_grasp_studies.figures import palette, style

_MEAN = "mean"  # the group that is the mean over objects
_GROUP = 0.82  # fraction of a group's width that bars take
_LEFT, _WIDE = 0.075, 0.905
_MARKERS = "osD^vPX*<>"
_CURVE: dict[str, Any] = {"lw": 2.0, "ms": 5.5, "mec": "white", "mew": 0.7}


def bars(
    values: Mapping[str, Mapping[str, Sequence[float]]],
    *,
    title: str,
    ylabel: str,
    width: float = style.WIDTH,
) -> Figure:
    """Draw a bar for each estimator and object: the mean, one standard deviation, and every seed.

    `values` maps estimator and object to the value [mm] of each seed; NaN is left out. The last
    group is the mean over objects; its spread is over seeds where all objects have equally many. A
    figure of one column has labels upright and a legend of two columns.
    InvalidOptionError if there are no values.
    """
    known = {name: _known(objects) for name, objects in values.items()}
    objects = list(dict.fromkeys(name for of in known.values() for name in of))
    if not objects:
        raise InvalidOptionError(
            "bars need the values of at least one estimator and object", option="values"
        )
    groups = [*objects, _MEAN] if len(objects) > 1 else objects
    narrow = width < style.WIDTH
    if narrow:
        figure = style.new_figure(2.7, width, drawn_width=style.COLUMN)
        axes = style.add_panel(figure, 0.14, 0.27, 0.84, 0.45)
    else:
        figure = style.new_figure(3.7)
        axes = style.add_panel(figure, _LEFT, 0.12, _WIDE, 0.66)
    breadth = _GROUP / len(known)
    handles = []
    for k, (name, of) in enumerate(known.items()):
        means = _over_objects(of)
        for g, group in enumerate(groups):
            seeds = means if group == _MEAN else of.get(group, np.empty(0))
            if len(seeds):
                at = g + (k + 0.5) * breadth - 0.5 * _GROUP
                _bar(axes, at, 0.88 * breadth, seeds, palette.estimator_colour(name))
        if of:
            mean = means.mean()
            text = f"{mean:.1f}" if mean >= 0.95 else f"{mean:.2f}"
            handles.append(_handle(name, f"{palette.estimator_label(name)} ({text})", lw=7.0))
    if len(groups) > len(objects):
        axes.axvspan(len(objects) - 0.5, len(objects) + 0.5, color="#f4f4f4", lw=0.0, zorder=0)
    axes.set_xlim(-0.55, len(groups) - 0.45)
    axes.set_ylim(bottom=0.0)
    between = " " if narrow else "\n"
    axes.set_xticks(range(len(groups)), [group.replace("_", between) for group in groups])
    style.label_axes(axes, "", ylabel)
    axes.tick_params(axis="x", length=0, labelsize=style.NORMAL, labelrotation=90 * narrow)
    _head(figure, title, handles, columns=2 if narrow else 5)
    return figure


def curve_panels(
    levels: Sequence[str],
    panels: Mapping[str, Mapping[str, npt.ArrayLike]],
    *,
    xlabel: str,
    ylabel: str,
) -> Figure:
    """Draw panels of curves with one scale: for each estimator the mean and a standard deviation.

    `panels` maps title and estimator to values, shape (L, repeats) for the labels of L `levels`;
    NaN is left out. InvalidOptionError if values have another shape.
    """
    figure = style.new_figure(3.7)
    names = list(dict.fromkeys(name for values in panels.values() for name in values))
    markers = {name: _MARKERS[k % len(_MARKERS)] for k, name in enumerate(names)}
    width, top = _WIDE / len(panels), 0.0
    place = np.arange(len(levels), dtype=np.float64)
    for p, (title, values) in enumerate(panels.items()):
        wide = (0.94 if len(panels) > 1 else 1) * width
        axes = style.add_panel(figure, _LEFT + p * width, 0.2, wide, 0.56)
        for name, table in values.items():
            mean, spread = _statistics(name, table, len(levels))
            low, high = np.maximum(mean - spread, 0.0), mean + spread
            colour = palette.estimator_colour(name)
            axes.fill_between(place, low, high, color=colour, alpha=0.15, lw=0.0)
            axes.plot(place, mean, color=colour, marker=markers[name], **_CURVE)
            top = max(top, float(np.nanmax(high, initial=0.0)))
        axes.set_xticks(range(len(levels)), list(levels))
        axes.set_xlim(-0.15, len(levels) - 0.85)
        style.label_axes(axes, xlabel, ylabel if p == 0 else "")
        style.head(axes, title, "left")
        axes.tick_params(labelleft=p == 0)
    for axes in figure.axes:
        axes.set_ylim(0.0, 1.03 * top or 1.0)
    label = palette.estimator_label
    _head(figure, "", [_handle(n, label(n), marker=markers[n], **_CURVE) for n in names])
    return figure


def calibration(
    nominal: Sequence[float], covered: Mapping[str, npt.ArrayLike], *, title: str
) -> Figure:
    """Draw the observed coverage of each estimator's uncertainty bands against the predicted one.

    `nominal` is the predicted coverage of M bands, one a panel; `covered` maps an estimator to the
    observed coverage, shape (M,) or (M, repeats), NaN left out; all from 0 to 1.
    InvalidOptionError if `covered` has another shape.
    """
    rows = np.arange(len(covered))
    height = 1.15 + 0.3 * len(rows)
    figure = style.new_figure(height)
    left, width = 0.2, 0.78 / len(nominal)
    low, high = 0.55 / height, 0.3 * len(rows) / height
    for p, predicted in enumerate(nominal):
        axes = style.add_panel(figure, left + p * width, low, 0.9 * width, high)
        axes.axvline(predicted, color=palette.INK, lw=1.0, ls=(0, (4, 3)))
        for row, (name, table) in zip(rows, covered.items(), strict=True):
            observed = np.asarray(table, dtype=np.float64)
            columns = observed[:, None] if observed.ndim == 1 else observed
            mean, spread = (a[p] for a in _statistics(name, columns, len(nominal)))
            colour = palette.estimator_colour(name)
            axes.hlines(row, mean - spread, min(mean + spread, 1.0), color=colour, lw=2.0)
            axes.plot([mean], [row], "o", ms=7.0, mfc=colour, mec="white", mew=0.8)
        axes.set(xlim=(0.0, 1.02), ylim=(len(rows) - 0.5, -0.5))
        axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100 %"])
        axes.set_yticks(rows, [palette.estimator_label(n) if p == 0 else "" for n in covered])
        style.label_axes(axes, "fraction of the truth inside the band", "")
        style.head(axes, f"predicted: {100 * predicted:.3g} %", "left")
        axes.tick_params(axis="y", length=0, labelsize=style.NORMAL)
    _head(figure, title)
    return figure


def _bar(axes: Axes, at: float, width: float, seeds: FloatArray, colour: str) -> None:
    mean, spread = float(seeds.mean()), float(seeds.std())
    axes.bar(at, mean, width, color=colour, alpha=0.85, lw=0.0)
    axes.vlines(at, max(mean - spread, 0.0), mean + spread, color=palette.INK, lw=0.9)
    # Side by side in their order, not jittered at random.
    places = at + 0.5 * width * np.linspace(-0.7, 0.7, len(seeds)) if len(seeds) > 1 else [at]
    axes.plot(places, seeds, "o", ms=1.8, mfc=palette.INK, mew=0.0, alpha=0.45)


def _known(objects: Mapping[str, Sequence[float]]) -> dict[str, FloatArray]:
    """Return the values that are numbers, of the objects that have some."""
    arrays = {name: np.asarray(seeds, dtype=np.float64) for name, seeds in objects.items()}
    numbers = {name: seeds[~np.isnan(seeds)] for name, seeds in arrays.items()}
    return {name: seeds for name, seeds in numbers.items() if len(seeds)}


def _over_objects(of: Mapping[str, FloatArray]) -> FloatArray:
    """Return the mean over objects, of each seed where all have the same number of them."""
    counts = {len(seeds) for seeds in of.values()}
    if len(counts) == 1:
        return np.asarray(np.mean(list(of.values()), axis=0))
    return np.array([np.mean([seeds.mean() for seeds in of.values()])]) if of else np.empty(0)


def _statistics(name: str, table: npt.ArrayLike, levels: int) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation over repeats, shape (levels,), NaN left out."""
    values = np.asarray(table, dtype=np.float64)
    if values.ndim != 2 or len(values) != levels:
        raise InvalidOptionError(
            f"values of {name} must have shape ({levels}, repeats), one row a level; they have"
            f" {values.shape}",
            option=name,
            value=table,
        )
    masked = np.ma.masked_invalid(values)
    mean, spread = masked.mean(axis=1), masked.std(axis=1)
    return np.ma.filled(mean, np.nan), np.ma.filled(spread, np.nan)


def _handle(name: str, label: str, **style: Any) -> Line2D:
    """Return an estimator's line in the legend."""
    return Line2D(
        [], [], color=palette.estimator_colour(name), label=label, solid_capstyle="butt", **style
    )


def _head(figure: Figure, title: str, handles: Sequence[Line2D] = (), *, columns: int = 5) -> None:
    """Write a chart's title and, below it, its legend."""
    inches = figure.get_figheight()
    if title:
        figure.text(
            0.012, 1.0 - 0.06 / inches, title, fontsize=style.LARGE, color=palette.INK, va="top"
        )
    if handles:
        figure.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(0.005, 1.0 - (0.25 if title else 0.0) / inches),
            ncols=min(len(handles), columns),
            frameon=False,
            fontsize=style.SMALL,
            labelcolor=palette.INK,
            handlelength=1.4,
            columnspacing=1.4,
        )
