"""Report of the paper's experiments as one page that opens offline: claims, figures, tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import lis_grasp
from lis_grasp.experiments.paper.paper_tables import (
    changes_table,
    claims_table,
    exactness_table,
    failures_table,
    measures_table,
    objects_table,
)
from lis_grasp.experiments.report_page import Picture, write_page
from lis_grasp.io.json_lines import Row

_EXPERIMENTS = {
    "whole": "Fully explored objects",
    "half": "Half-explored objects",
    "few": "5 to 8 contacts",
    "noisy": "Fully explored objects, 1 mm and 3 degrees of noise",
    "random": "As many contacts, drawn at random from the surface",
    "wedge": "Twelve contacts round an edge, all levels of noise",
}


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
        f" {escape(lis_grasp.__version__)}: 8 objects of 20 cm, {seeds} seeds. Errors are root mean"
        " square deviations over the explored part, within 50 mm of a contact. All estimators get"
        " the same contacts, from a walk over the true surface in steps of a quarter of the size."
        " Such even contacts favour estimators with sharp edges: the experiment with random"
        " contacts shows by how much. Intervals are 95 % bootstrap intervals over seeds,"
        " paired.</p>",
    ]
    sections += [
        claims_table(rows).section(),
        changes_table(rows, estimator, _EXPERIMENTS).section(),
        exactness_table(estimator).section(),
    ]
    sections += ["<h2>Figures</h2>", *(picture.html() for picture in pictures)]
    present = {row["experiment"] for row in rows}
    tables = [
        measures_table(rows, name, title) for name, title in _EXPERIMENTS.items() if name in present
    ]
    for measure, what in (
        ("rmsd", "estimate to truth"),
        ("rmsd_truth_to_estimate", "truth to estimate"),
        ("edge_rmsd", "true edges to estimate"),
    ):
        for experiment in ("whole", "random"):
            if experiment in present:
                title = f"{_EXPERIMENTS[experiment]}, {what} [mm]: mean and deviation over seeds"
                tables.append(objects_table(rows, experiment, measure, title))
    sections += [table.section() for table in (*tables, failures_table(rows))]
    write_page(path, "Local implicit surfaces: the paper again", sections)
