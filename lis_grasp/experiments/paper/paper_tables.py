"""Tables of the report, as HTML and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from html import escape

import numpy as np

from lis_grasp.experiments.figures.palette import estimator_label
from lis_grasp.experiments.paper.claims import Claim
from lis_grasp.experiments.paper.summary import tabulate
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


def claims_table(claims: Sequence[Claim], heading: str) -> str:
    """Return claims as an HTML table."""
    body = "".join(
        f"<tr><td>{escape(c.statement)}</td><td>{escape(c.claimed)}</td>"
        f"<td>{escape(c.measured)}</td>"
        f'<td class="{c.verdict.split()[0]}">{escape(c.verdict)}</td></tr>'
        for c in claims
    )
    return (
        f"<table><thead><tr><th></th><th>{escape(heading)}</th><th>measured here"
        f" (95 % interval)</th><th></th></tr></thead><tbody>{body}</tbody></table>"
    )


def measures_table(rows: Sequence[Row], experiment: str) -> str:
    """Return an experiment's measures, means over objects and seeds, estimators in rows."""
    tables = [tabulate(rows, experiment, measure) for measure, _, _ in _MEASURES]
    head = "".join(f"<th>{escape(heading)}</th>" for _, heading, _ in _MEASURES)
    body = ""
    for name in tables[0].estimators:
        cells = "".join(
            f"<td>{_number(factor * table.overall(name))}</td>"
            for table, (_, _, factor) in zip(tables, _MEASURES, strict=True)
        )
        body += f"<tr><th>{escape(estimator_label(name))}</th>{cells}</tr>"
    return f"<table><thead><tr><th></th>{head}</tr></thead><tbody>{body}</tbody></table>"


def objects_table(rows: Sequence[Row], experiment: str, measure: str) -> str:
    """Return one measure in mm, mean and spread over seeds, objects in rows."""
    table = tabulate(rows, experiment, measure)
    head = "".join(f"<th>{escape(estimator_label(name))}</th>" for name in table.estimators)
    body = ""
    for k, name in enumerate(table.objects):
        cells = ""
        for estimator in table.estimators:
            values = 1e3 * table.of(estimator)[k]
            values = values[~np.isnan(values)]
            if len(values):
                cells += f"<td>{_number(values.mean())} ± {_number(values.std())}</td>"
            else:
                cells += "<td>–</td>"
        body += f"<tr><th>{escape(name)}</th>{cells}</tr>"
    return f"<table><thead><tr><th></th>{head}</tr></thead><tbody>{body}</tbody></table>"


def failures_list(rows: Sequence[Row]) -> str:
    """Return every estimate that failed, with its reason, as an HTML list."""
    items = [
        f"<li>{escape(r['experiment'])}, {escape(r['object'])}, seed {r['seed']},"
        f" {escape(estimator_label(r['estimator']))}: {escape(r['failure'])}</li>"
        for r in rows
        if "failure" in r
    ]
    return f"<ul>{''.join(items)}</ul>" if items else "<p>No estimate failed.</p>"


def rows_as_csv(rows: Sequence[Row]) -> str:
    """Return all rows as CSV, ordered, so that equal results are equal files."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        sorted(rows, key=lambda r: (r["experiment"], r["object"], r["seed"], r["estimator"]))
    )
    return text.getvalue()


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}" if value < 99.95 else f"{value:.0f}"
