"""Tables of the paper's report: claims, change from GPIS, means, errors by object, failures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lis_grasp.experiments.figures.palette import estimator_label
from lis_grasp.experiments.paper.claims import (
    change_text,
    experiment_table,
    noise_label,
    paper_claims,
)
from lis_grasp.experiments.paper.exactness import cube_edge_error, meshing_loss
from lis_grasp.experiments.paper.wedge import NOISE_LEVELS
from lis_grasp.experiments.report_page import TextTable, csv_text
from lis_grasp.io.json_lines import Row

# Measure, heading, factor to what is printed.
_MEASURES = (
    ("rmsd", "RMSD, estimate to truth [mm]", 1e3),
    ("rmsd_truth_to_estimate", "RMSD, truth to estimate [mm]", 1e3),
    ("edge_rmsd", "RMSD, edges to estimate [mm]", 1e3),
    ("chamfer", "Chamfer [mm]", 1e3),
    ("hausdorff_95", "Hausdorff 95 % [mm]", 1e3),
    ("f_score_1mm", "F-score 1 mm [%]", 1e2),
    ("f_score_2mm", "F-score 2 mm [%]", 1e2),
    ("f_score_5mm", "F-score 5 mm [%]", 1e2),
    ("iou", "IoU [%]", 1e2),
    ("normal_error", "normals [deg]", 180.0 / np.pi),
    ("within_1_sigma", "truth within 1 sigma [%]", 1e2),
    ("within_1.96_sigma", "within 1.96 sigma [%]", 1e2),
)
_ERRORS = _MEASURES[:3]

# Cells of the meshes whose loss at edges is measured [m].
_COARSE = 0.008


def claims_table(rows: Sequence[Row]) -> TextTable:
    """Return the paper's claims beside the values measured here."""
    head = ("", "the paper", "measured here (95 % interval)", "")
    body = tuple((c.statement, c.claimed, c.measured, c.verdict) for c in paper_claims(rows))
    return TextTable("claims", "Claims of the paper", head, body)


def changes_table(rows: Sequence[Row], estimator: str, titles: Mapping[str, str]) -> TextTable:
    """Return the change of an estimator's errors from GPIS in every experiment.

    Below each experiment on objects is the change on the object where it is largest.
    """
    body = []
    for experiment, title in titles.items():
        tables = [experiment_table(rows, experiment, measure) for measure, _, _ in _ERRORS]
        if not {estimator, "gpis"} <= set(tables[0].estimators):
            continue
        if experiment == "wedge":
            for level in range(len(NOISE_LEVELS)):
                if str(level) in tables[0].objects:
                    cells = (change_text(table.only(str(level)), estimator) for table in tables)
                    body.append((f"at an edge, {noise_label(level)}", *cells))
            continue
        body.append((title, *(change_text(table, estimator) for table in tables)))
        worst = []
        for table in tables:
            ratios = table.per_object(estimator) / table.per_object("gpis")
            k = int(np.nanargmax(ratios))
            worst.append(f"{ratios[k]:.2f} times ({table.objects[k]})")
        body.append(("… worst object", *worst))
    head = ("", *(heading for _, heading, _ in _ERRORS))
    title = f"Change of the errors of {estimator_label(estimator)} from GPIS, with 95 % intervals"
    return TextTable("changes", title, head, tuple(body))


def exactness_table(estimator: str) -> TextTable:
    """Return the errors of estimates that should be exact, measured now, without trials."""
    cube, loss = cube_edge_error(estimator), meshing_loss(_COARSE)
    body = (
        ("a cube from six contacts, at its edges", f"{1e3 * cube:.4f}"),
        (f"loss of meshing with cells of {1e3 * _COARSE:g} mm, at edges", f"{1e3 * loss:.4f}"),
    )
    return TextTable("exactness", "Errors that should be 0", ("", "RMSD [mm]"), body)


def measures_table(rows: Sequence[Row], experiment: str, title: str) -> TextTable:
    """Return an experiment's measures, means over objects and seeds, estimators in rows."""
    tables = [
        (experiment_table(rows, experiment, measure), factor) for measure, _, factor in _MEASURES
    ]
    body = tuple(
        (estimator_label(name), *(_number(factor * t.overall(name)) for t, factor in tables))
        for name in tables[0][0].estimators
    )
    head = ("", *(heading for _, heading, _ in _MEASURES))
    return TextTable(experiment, title, head, body)


def objects_table(rows: Sequence[Row], experiment: str, measure: str, title: str) -> TextTable:
    """Return one measure in mm, mean and standard deviation over seeds, objects in rows."""
    table = experiment_table(rows, experiment, measure)
    body = tuple(
        (name, *(_spread(1e3 * table.of(estimator)[k]) for estimator in table.estimators))
        for k, name in enumerate(table.objects)
    )
    head = ("", *(estimator_label(name) for name in table.estimators))
    return TextTable(f"{experiment}_{measure}", title, head, body)


def failures_table(rows: Sequence[Row]) -> TextTable:
    """Return every estimate that failed, with its reason."""
    body = tuple(
        (
            estimator_label(r["estimator"]),
            r["experiment"],
            r["object"],
            str(r["seed"]),
            r["failure"],
        )
        for r in rows
        if "failure" in r
    )
    head = ("estimator", "experiment", "object", "seed", "reason")
    return TextTable("failures", "Estimates that failed", head, body)


def rows_as_csv(rows: Sequence[Row]) -> str:
    """Return all rows as CSV, ordered, so that equal results are equal files."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    order = ("experiment", "object", "seed", "estimator")
    ordered = sorted(rows, key=lambda row: tuple(row[name] for name in order))
    return csv_text([columns, *([row.get(name) for name in columns] for row in ordered)])


def _spread(values: np.ndarray) -> str:
    known = values[~np.isnan(values)]
    return f"{_number(known.mean())} ± {_number(known.std())}" if len(known) else "–"


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}" if value < 99.95 else f"{value:.0f}"
