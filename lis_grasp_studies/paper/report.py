"""Report of the paper's experiments as one page that opens offline: claims, figures, tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from html import escape
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from lis_grasp.io.json_lines import Row
from lis_grasp.version import __version__
from lis_grasp_studies.figures import CHART_CAPTIONS, FIGURES, charts
from lis_grasp_studies.figures.style import COLUMN, WIDTH
from lis_grasp_studies.harness.page import Picture, write_page
from lis_grasp_studies.harness.statistics import MeasureTable
from lis_grasp_studies.paper import tables
from lis_grasp_studies.paper.tables import experiment_table
from lis_grasp_studies.paper.trials import NOISE_LEVELS

TITLES = {
    "whole": "Fully explored objects",
    "half": "Half-explored objects",
    "few": "5 to 8 contacts",
    "noisy": "Fully explored objects, 1 mm and 3 degrees of noise",
    "random": "As many contacts, drawn at random from the surface",
    "wedge": "Twelve contacts round an edge, all levels of noise",
}
"""Titles of the experiments."""

_SHOWN = ("gpis", "lis", "blend")
_UNDER_NOISE = (*_SHOWN, "gpis_thin_plate", "hermite_rbf")

Entry = tuple[str, str, Callable[..., Figure]]


def write_report(
    path: Path, rows: Sequence[Row], pictures: Iterable[Picture], *, command: str, estimator: str
) -> None:
    """Write the report as one HTML file.

    The page names the command that makes it, and compares the default estimator with GPIS.
    """
    seeds = len({row["seed"] for row in rows})
    sections = [
        "<h1>Local implicit surfaces, from touch: the paper's experiments again</h1>",
        f"<p>S. Ottenhaus, M. Miller, D. Schiebener, N. Vahrenkamp and T. Asfour, <i>Local Implicit"
        " Surface Estimation for Haptic Exploration</i>, Humanoids 2016. Every figure and table of"
        f" its evaluation, made by <code>{escape(command)}</code> with lis_grasp"
        f" {escape(__version__)}: 8 objects of 20 cm, {seeds} seeds. Errors are root mean"
        " square deviations over the explored part, within 50 mm of a contact. All estimators get"
        " the same contacts, from a walk over the true surface in steps of a quarter of the size."
        " Such even contacts favour estimators with sharp edges: the experiment with random"
        " contacts shows by how much. Intervals are 95 % bootstrap intervals over seeds,"
        " paired.</p>",
    ]
    sections += [
        tables.claims_table(rows).section(),
        tables.changes_table(rows, estimator, TITLES).section(),
        tables.exactness_table().section(),
    ]
    sections += ["<h2>Figures</h2>", *(picture.html() for picture in pictures)]
    present = {row["experiment"] for row in rows}
    titles = {name: title for name, title in TITLES.items() if name in present}
    shown = [tables.measures_table(rows, name, title) for name, title in titles.items()]
    for measure, what in (
        ("rmsd", "estimate to truth"),
        ("rmsd_truth_to_estimate", "truth to estimate"),
        ("edge_rmsd", "true edges to estimate"),
    ):
        for experiment in ("whole", "random"):
            if experiment in present:
                title = f"{titles[experiment]}, {what} [mm]: mean and deviation over seeds"
                shown.append(tables.objects_table(rows, experiment, measure, title))
    sections += [table.section() for table in (*shown, tables.failures_table(rows))]
    write_page(path, "Local implicit surfaces: the paper again", sections)


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
        # Charts of bars are drawn for one column too.
        narrow = draw(width=COLUMN) if isinstance(draw, partial) else None
        yield Picture.of(title, caption, draw(), narrow)
        if progress is not None:
            progress(k + 1, len(entries))


def _drawn(number: int) -> Entry:
    figure = FIGURES[number]
    return f"Figure {number}: {figure.title}", figure.caption, figure.draw


def _charts_of_objects(rows: Sequence[Row]) -> list[Entry]:
    either = " The paper shows one direction of the two and does not say which."
    # Title and caption of the figure; measure, and title of the chart.
    entries = (
        ("Figure 9, estimate to truth", CHART_CAPTIONS[9] + either, "rmsd", "Estimate to truth"),
        (
            *("Figure 9, truth to estimate", CHART_CAPTIONS[9]),
            *("rmsd_truth_to_estimate", "Truth to estimate"),
        ),
        ("Figure 10", CHART_CAPTIONS[10], "edge_rmsd", "True edges to estimate"),
    )
    return [
        (title, caption, partial(object_bars, experiment_table(rows, "whole", measure), chart))
        for title, caption, measure, chart in entries
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
            lambda: charts.curve_panels(
                labels, panels, xlabel="noise of positions and normals", ylabel="RMSD [mm]"
            ),
        ),
        (
            "Beyond the paper: uncertainty",
            "Fraction of the explored truth within 1 and 1.96 standard deviations of the estimate."
            " Contacts have 1 mm and 3 degrees of noise, which the estimators are given. Means over"
            " objects, lines one standard deviation between objects.",
            lambda: charts.calibration((0.683, 0.95), covered, title="Bands of uncertainty"),
        ),
    ]


def object_bars(table: MeasureTable, title: str, width: float = WIDTH) -> Figure:
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
    return charts.bars(values, title=title, ylabel="RMSD [mm]", width=width)


def _levels(table: MeasureTable) -> dict[str, np.ndarray]:
    return {name: 1e3 * table.of(name) for name in _UNDER_NOISE if name in table.estimators}
