"""Tables of a study, each as HTML, CSV and LaTeX."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from lis_grasp.json_lines import Row
from lis_grasp.output_files import write_text
from lis_grasp.study.comparison import KINDS, Comparison, agreements, losses, measure_table
from lis_grasp.study.results import COLUMNS
from lis_grasp.visualization.figures.palette import estimator_label

MEASURE_LABELS = {
    "held": "held",
    "epsilon_truth": "epsilon on the truth",
    "epsilon_gap": "gap of epsilon",
    "rmsd": "estimate to truth [mm]",
    "rmsd_truth_to_estimate": "truth to estimate [mm]",
    "edge_rmsd": "edges to estimate [mm]",
}
"""What each measure is called."""

# Measure -> factor to what is printed, and its digits.
_PRINTED = {"held": (1e2, 0), "epsilon_truth": (1.0, 3), "epsilon_gap": (1.0, 3)}
_LENGTH = (1e3, 2)

_LATEX = str.maketrans(
    {"%": r"\%", "_": r"\_", "&": r"\&", "#": r"\#", "β": r"$\beta$", "−": "$-$", "–": "--"}
)


@dataclass(frozen=True, slots=True)
class StudyTable:
    """A table of texts.

    Parameters
    ----------
    name
        Of its files.
    title
        What it shows.
    head
        Of its columns.
    body
        Its rows, each as long as the head.
    """

    name: str
    title: str
    head: tuple[str, ...]
    body: tuple[tuple[str, ...], ...]

    def html(self) -> str:
        """Return the table as HTML."""
        head = "".join(f"<th>{escape(text)}</th>" for text in self.head)
        body = "".join(
            f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in self.body
        )
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def csv(self) -> str:
        """Return the table as CSV."""
        return _csv([self.head, *self.body])

    def latex(self) -> str:
        """Return the table for LaTeX with the package booktabs."""
        lines = [" & ".join(text.translate(_LATEX) for text in row) for row in self.body]
        head = " & ".join(text.translate(_LATEX) for text in self.head)
        rows = "".join(f"{line} \\\\\n" for line in lines)
        return (
            f"% {self.title}\n\\begin{{tabular}}{{l{'r' * (len(self.head) - 1)}}}\n\\toprule\n"
            f"{head} \\\\\n\\midrule\n{rows}\\bottomrule\n\\end{{tabular}}\n"
        )


def all_tables(
    rows: Sequence[Row], comparisons: Sequence[Comparison], reference: str
) -> list[StudyTable]:
    """Return the tables of a study, in the order of the report."""
    return [
        comparisons_table(comparisons),
        agreements_table(rows, reference),
        overview_table(rows),
        *(objects_table(rows, noise) for noise in dict.fromkeys(row["noise"] for row in rows)),
        reasons_table(rows),
        losses_table(rows, reference),
    ]


def write_tables(folder: Path, tables: Iterable[StudyTable], rows: Sequence[Row]) -> None:
    """Write each table as CSV and LaTeX, and all rows as ``rows.csv``."""
    for table in tables:
        write_text(folder / f"{table.name}.csv", table.csv())
        write_text(folder / f"{table.name}.tex", table.latex())
    content = [[_plain(row.get(name)) for name in COLUMNS] for row in rows]
    write_text(folder / "rows.csv", _csv([COLUMNS, *content]))


def comparisons_table(comparisons: Sequence[Comparison]) -> StudyTable:
    """Return every comparison: pairs, means, effect and what it is worth."""
    head = (
        *("estimator", "against", "objects", "noise", "measure", "pairs", "better", "worse"),
        *("mean", "reference", "difference", "95 % interval", "rank-biserial"),
        *("p", "p by object and seed", "p, Holm"),
    )
    body = tuple(
        (
            estimator_label(c.estimator),
            estimator_label(c.reference),
            c.kind,
            c.noise,
            _label(c.measure),
            str(c.pairs),
            str(c.wins),
            str(c.losses),
            printed(c.measure, c.mean),
            printed(c.measure, c.mean_reference),
            printed(c.measure, c.effect, signed=True),
            interval(c),
            "–" if c.rank_biserial is None else f"{c.rank_biserial:+.2f}".replace("-", "−"),
            p_value(c.p),
            p_value(c.p_clustered),
            p_value(c.p_holm),
        )
        for c in comparisons
    )
    return StudyTable("comparisons", "Every comparison, pair by pair", head, body)


def agreements_table(rows: Sequence[Row], reference: str) -> StudyTable:
    """Return whether smaller surface errors go with grasps that hold, pair by pair."""
    body = tuple(
        (_label(a.measure), a.kind, str(a.agree), str(a.disagree), p_value(a.p))
        for a in agreements(rows, reference)
    )
    head = ("error", "objects", "the nearer surface held", "the farther one held", "p")
    title = f"Where only one of two held, of all estimators with {estimator_label(reference)}"
    return StudyTable("agreements", title, head, body)


def overview_table(rows: Sequence[Row]) -> StudyTable:
    """Return the means of every measure, for each estimator, kind of objects and noise."""
    body = []
    for noise in dict.fromkeys(row["noise"] for row in rows):
        for kind in KINDS:
            tables = {m: measure_table(rows, m, kind=kind, noise=noise) for m in MEASURE_LABELS}
            for name in tables["held"].estimators:
                values = [printed(m, t.overall(name)) for m, t in tables.items()]
                body.append((estimator_label(name), kind, noise, *values))
    head = ("estimator", "objects", "noise", *(_label(measure) for measure in MEASURE_LABELS))
    return StudyTable("overview", "Means over objects, hands, touches and seeds", head, tuple(body))


def objects_table(rows: Sequence[Row], noise: str) -> StudyTable:
    """Return how many grasps held of how many, for each object and number of touches."""
    chosen = [row for row in rows if row["noise"] == noise]
    names = list(dict.fromkeys(row["estimator"] for row in chosen))
    cells: dict[tuple[str, str, str], dict[str, list[bool]]] = {}
    for row in chosen:
        cell = cells.setdefault((row["object"], row["hand"], str(row["touches"])), {})
        cell.setdefault(row["estimator"], []).append(bool(row["held"]))
    body = tuple(
        (*cell, *(f"{sum(of[n])} of {len(of[n])}" if n in of else "–" for n in names))
        for cell, of in cells.items()
    )
    head = ("object", "hand", "touches", *(estimator_label(name) for name in names))
    name = "objects_" + noise.replace("/", "_").replace(".", "_")
    return StudyTable(name, f"Grasps that held, noise: {noise}", head, body)


def reasons_table(rows: Sequence[Row]) -> StudyTable:
    """Return how trials ended, counted."""
    names = list(dict.fromkeys(row["estimator"] for row in rows))
    counts: dict[str, dict[str, int]] = {}
    for row in rows:
        of = counts.setdefault(row["reason"], dict.fromkeys(names, 0))
        of[row["estimator"]] += 1
    ordered = sorted(counts, key=lambda reason: (reason != "held", -sum(counts[reason].values())))
    body = tuple((reason, *(str(counts[reason][name]) for name in names)) for reason in ordered)
    head = ("ended as", *(estimator_label(name) for name in names))
    return StudyTable("reasons", "How trials ended", head, body)


def losses_table(rows: Sequence[Row], reference: str) -> StudyTable:
    """Return every trial that the reference held and another estimator did not."""
    head = (
        *("estimator", "object", "hand", "touches", "noise", "seed", "ended as"),
        *("epsilon on the estimate", "on the truth", "estimate to truth [mm]"),
        *("edges to estimate [mm]", f"{estimator_label(reference)}: epsilon on the truth", "key"),
    )
    body = tuple(
        (
            estimator_label(mine["estimator"]),
            *(str(mine[name]) for name in ("object", "hand", "touches", "noise", "seed")),
            str(mine["failure"] or mine["reason"]),
            printed("epsilon_truth", mine["epsilon_estimate"]),
            printed("epsilon_truth", mine["epsilon_truth"]),
            printed("rmsd", mine["rmsd"]),
            printed("edge_rmsd", mine["edge_rmsd"]),
            printed("epsilon_truth", theirs["epsilon_truth"]),
            mine["key"],
        )
        for mine, theirs in losses(rows, reference)
    )
    title = f"Every trial that {estimator_label(reference)} held and another did not"
    return StudyTable("losses", title, head, body)


def printed(measure: str, value: float | None, *, signed: bool = False) -> str:
    """Return a value as it is printed: shares in percent, lengths in mm; a dash for none."""
    if value is None or math.isnan(value):
        return "–"
    factor, digits = _PRINTED.get(measure, _LENGTH)
    return f"{factor * value:{'+' if signed else ''}.{digits}f}".replace("-", "−")


def interval(comparison: Comparison) -> str:
    """Return the interval of a comparison's effect as it is printed."""
    if comparison.low is None:
        return "–"
    ends = (comparison.low, comparison.high)
    return " to ".join(printed(comparison.measure, end, signed=True) for end in ends)


def p_value(p: float) -> str:
    """Return a p-value as it is printed."""
    return f"{p:.3f}" if p >= 0.001 else "< 0.001"


def _label(measure: str) -> str:
    return MEASURE_LABELS[measure] + (" [%]" if measure == "held" else "")


def _csv(rows: Iterable[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _plain(value: object) -> str:
    return "" if value is None else str(value)
