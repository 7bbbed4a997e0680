"""Figures of the paper's report: drawings, bar charts, noise curves, calibration of bands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from lis_grasp.experiments.figures import (
    CHART_CAPTIONS,
    FIGURES,
    bars,
    calibration,
    curve_panels,
    png_of,
)
from lis_grasp.experiments.paper.paper_contacts import NOISE_LEVELS
from lis_grasp.experiments.paper.paper_tables import experiment_table
from lis_grasp.experiments.report_page import Picture
from lis_grasp.experiments.statistics import MeasureTable
from lis_grasp.io.json_lines import Row

_SHOWN = ("gpis", "lis", "blend")
_UNDER_NOISE = (*_SHOWN, "gpis_thin_plate", "hermite_rbf")

Entry = tuple[str, str, Callable[[], Figure]]


def draw_pictures(
    rows: Sequence[Row], *, progress: Callable[[int, int], None] | None = None
) -> Iterator[Picture]:
    """Draw the figures one after the other; `progress` gets the figures drawn, and their total."""
    entries = [
        *(_drawn(number) for number in (1, 2, 4, 5, 6, 7, 8)),
        *_charts_of_objects(rows),
        _drawn(11),
        *_charts_of_bands(rows),
    ]
    for k, (title, caption, draw) in enumerate(entries):
        yield Picture(title, caption, png_of(draw()))
        if progress is not None:
            progress(k + 1, len(entries))


def _drawn(number: int) -> Entry:
    figure = FIGURES[number]
    return f"Figure {number}: {figure.title}", figure.caption, figure.draw


def _charts_of_objects(rows: Sequence[Row]) -> list[Entry]:
    either = " The paper shows one direction of the two and does not say which."
    # Title and caption of the figure; measure, and title of the chart.
    charts = (
        ("Figure 9, estimate to truth", CHART_CAPTIONS[9] + either, "rmsd", "Estimate to truth"),
        (
            *("Figure 9, truth to estimate", CHART_CAPTIONS[9]),
            *("rmsd_truth_to_estimate", "Truth to estimate"),
        ),
        ("Figure 10", CHART_CAPTIONS[10], "edge_rmsd", "True edges to estimate"),
    )
    return [
        (title, caption, partial(_bars, experiment_table(rows, "whole", measure), chart))
        for title, caption, measure, chart in charts
    ]


def _charts_of_bands(rows: Sequence[Row]) -> list[Entry]:
    labels = [
        f"{1e3 * noise.position:g} mm\n{np.degrees(noise.normal):g}°" for noise in NOISE_LEVELS
    ]
    panels = {
        "at the edge": _levels(experiment_table(rows, "wedge", "edge_rmsd")),
        "truth to estimate": _levels(experiment_table(rows, "wedge", "rmsd_truth_to_estimate")),
    }
    bands = [experiment_table(rows, "noisy", f"within_{k}_sigma") for k in ("1", "1.96")]
    covered = {
        name: np.array([table.per_object(name) for table in bands])
        for name in _SHOWN
        if name in bands[0].estimators
    }
    return [
        (
            "Figure 12",
            CHART_CAPTIONS[12],
            lambda: curve_panels(
                labels, panels, xlabel="noise of positions and normals", ylabel="RMSD [mm]"
            ),
        ),
        (
            "Beyond the paper: uncertainty",
            "Fraction of the explored truth within 1 and 1.96 standard deviations of the estimate."
            " Contacts have 1 mm and 3 degrees of noise, which the estimators are given. Means over"
            " objects, lines one standard deviation between objects.",
            lambda: calibration((0.683, 0.95), covered, title="Bands of uncertainty"),
        ),
    ]


def _bars(table: MeasureTable, title: str) -> Figure:
    """Draw the values of the estimators shown, in mm; objects without any are left out."""
    values: dict[str, dict[str, list[float]]] = {
        estimator: {
            name: (1e3 * table.of(estimator)[k]).tolist()
            for k, name in enumerate(table.objects)
            if not np.isnan(table.of(estimator)[k]).all()
        }
        for estimator in _SHOWN
        if estimator in table.estimators
    }
    return bars(values, title=title, ylabel="RMSD [mm]")


def _levels(table: MeasureTable) -> dict[str, np.ndarray]:
    return {name: 1e3 * table.of(name) for name in _UNDER_NOISE if name in table.estimators}
