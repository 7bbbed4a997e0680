"""Report of the study: a Markdown page, every table and every row as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp_studies.contact_study.score import CELLS, EXPLORED, TRUTH
from lis_grasp_studies.contact_study.tables import (
    FLOOR,
    WORST,
    ErrorRatio,
    by_family_table,
    by_kind_table,
    by_object_table,
    calibration_table,
    error_ratios,
    error_table,
    losses_table,
    with_truth,
)
from lis_grasp_studies.figures import charts, estimator_label
from lis_grasp_studies.figures.style import COLUMN
from lis_grasp_studies.harness.page import Picture
from lis_grasp_studies.harness.tables import Table, rows_csv, write_tables

_BOXES = {
    "contacts": "the contacts' box grown by the margin of `gpis`, the same for all estimators",
    "explored": "the contacts' box grown by the explored radius, the same for all estimators",
    "own": "the box of each estimator's own bounds",
}


def write_contact_report(
    folder: Path,
    rows: Sequence[Row],
    *,
    subject: str,
    reference: str,
    estimators: Sequence[str],
    command: str,
) -> Picture:
    """Write ``surfaces.md``, one CSV file for each table, and ``rows.csv``; return the chart.

    Parameters
    ----------
    folder
        Exists already.
    rows
        Of `run_surface_trial`.
    subject, reference
        The estimator in question, and the one that ratios are to; both among `estimators`.
    estimators
        In the order of the columns, without the clipped truth.
    command
        That repeats the study.
    """
    ratios = [r for r in error_ratios(rows, reference) if r.estimator != TRUTH]
    others = [name for name in estimators if name != reference]
    tables = (
        by_kind_table(ratios, others),
        by_family_table(ratios, subject),
        by_object_table(ratios, others),
        error_table(rows, with_truth(rows, estimators)),
        calibration_table(rows, [subject, reference]),
        losses_table(ratios, subject),
    )
    write_tables(folder, tables)
    write_text(folder / "rows.csv", rows_csv(rows, list(rows[0]) if rows else []))
    page = [_introduction(rows, reference, command)]
    page += [f"## {table.title}\n\n{_note(table)}{table.markdown()}" for table in tables[:-1]]
    page.append(_worst(tables[-1]))
    write_text(folder / "surfaces.md", "\n".join(page))
    return family_chart(ratios, reference, others)


def family_chart(ratios: Sequence[ErrorRatio], reference: str, others: Sequence[str]) -> Picture:
    """Return the chart of ratios by family."""
    values: dict[str, dict[str, list[float]]] = {name: {} for name in others}
    for ratio in ratios:
        if ratio.estimator in values:
            both = 0.5 * (ratio.truth_to_estimate + ratio.estimate_to_truth)
            values[ratio.estimator].setdefault(ratio.family, []).append(both)
    label = estimator_label(reference)
    words = f"error / error of {label}"
    draw = partial(charts.bars, values, title="Errors by family", ylabel=words)
    return Picture.of(
        "Errors of surfaces by family",
        f"Error over that of {label}, mean of truth to estimate and estimate to truth. Dots are"
        " contact sets, bars their means, lines one standard deviation.",
        draw(),
        draw(width=COLUMN),
    )


def _introduction(rows: Sequence[Row], reference: str, command: str) -> str:
    objects = {row["object"] for row in rows}
    sets = {(row["object"], row["case"], row["seed"]) for row in rows}
    boxes = " and ".join(_BOXES[box] for box in sorted({row["box"] for row in rows}))
    return (
        f"# Errors on {len(sets)} contact sets of {len(objects)} objects\n\n"
        "Root mean square distances within the explored part:"
        f" {EXPLORED:g} of the object's size from a contact. A ratio is"
        f" (error + {FLOOR:g} size) / (error of `{reference}` + {FLOOR:g} size); means are"
        " geometric; intervals (95 %) draw whole objects. Each cell: truth to estimate / estimate"
        f" to truth. Meshed with {CELLS} cells along {boxes}. A failed estimate counts with the"
        " explored radius as its errors.\n\n"
        f"```sh\n{command}\n```\n"
    )


def _note(table: Table) -> str:
    if table.name == "errors":
        return (
            "Truth to estimate / estimate to truth / true edges to estimate. `truth` is the true"
            " surface clipped by the box: no estimate can do better.\n\n"
        )
    if table.name == "calibration":
        return (
            "Fraction within one and 1.96 standard deviations, over the estimate / over the true"
            " surface; bold: more than 5 points off.\n\n"
        )
    return ""


def _worst(losses: Table) -> str:
    large = [line for line in losses.body if max(float(line[4]), float(line[5])) > WORST]
    shown = Table(losses.name, losses.title, losses.head, tuple(large))
    return (
        f"## {losses.title}\n\n{len(losses.body)} sets, of which {len(large)} with a ratio above"
        f" {WORST:g}, which follow; all are in `losses.csv`.\n\n{shown.markdown()}"
    )
