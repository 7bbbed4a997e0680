"""The report as one page that opens offline: claims, figures, tables."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import lis_grasp
from lis_grasp.experiments.paper.claims import exact_claims, our_claims, paper_claims
from lis_grasp.experiments.paper.paper_tables import (
    claims_table,
    failures_list,
    measures_table,
    objects_table,
)
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row

_EXPERIMENTS = {
    "whole": "Fully explored objects",
    "half": "Half-explored objects",
    "few": "5 to 8 contacts",
    "noisy": "Fully explored objects, 1 mm and 3 degrees of noise",
    "wedge": "Twelve contacts round an edge, all levels of noise",
}

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; margin: 2rem auto; max-width: 62rem;
  padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.25rem; margin-top: 2.5rem; }
figure { margin: 2rem 0; } img { max-width: 100%; height: auto; }
figcaption { color: #444; font-size: .92rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .85rem; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #ddd; }
tbody th, td:first-child, th:first-child { text-align: left; font-weight: 500; }
.reproduces, .met { color: #0a6b3d; } .does, .missed { color: #b3261e; font-weight: 600; }
code { background: #f3f3f3; padding: .1rem .3rem; }
"""


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of the report: its title, what to see on it, and the PNG."""

    title: str
    caption: str
    png: bytes


def write_report(
    path: Path, rows: Sequence[Row], pictures: Iterable[Picture], *, command: str, estimator: str
) -> None:
    """Write the report.

    Parameters
    ----------
    path
        Of the HTML file.
    rows
        Results of the trials.
    pictures
        In the order of the page.
    command
        That makes the report again.
    estimator
        Whose claims are ours: the default.
    """
    seeds = len({row["seed"] for row in rows})
    sections = [
        "<h1>Local implicit surfaces, from touch: the paper's experiments again</h1>",
        f"<p>S. Ottenhaus, M. Miller, D. Schiebener, N. Vahrenkamp and T. Asfour, <i>Local Implicit"
        " Surface Estimation for Haptic Exploration</i>, Humanoids 2016. Every figure and table of"
        f" its evaluation, made by <code>{escape(command)}</code> with lis_grasp"
        f" {escape(lis_grasp.__version__)}: 8 objects of 20 cm, {seeds} seeds. Errors are root mean"
        " square deviations over the explored part, within 50 mm of a contact; all estimators get"
        " the same contacts, which a walk over the true surface makes, a quarter of the size a"
        " step. Intervals are 95 % bootstrap intervals over seeds, paired.</p>",
        "<h2>What the paper claims</h2>",
        scroll(claims_table(paper_claims(rows), "the paper")),
        f"<h2>What we claim for <code>{escape(estimator)}</code>, against GPIS</h2>",
        scroll(claims_table([*our_claims(rows, estimator), *exact_claims(estimator)], "claimed")),
        "<h2>Figures</h2>",
        *(figure_of(picture) for picture in pictures),
    ]
    present = [name for name in _EXPERIMENTS if any(r["experiment"] == name for r in rows)]
    for name in present:
        sections += [f"<h2>{_EXPERIMENTS[name]}</h2>", scroll(measures_table(rows, name))]
    for measure, title in (
        ("rmsd", "Fully explored, estimate to truth, mm: mean and spread over seeds"),
        ("rmsd_truth_to_estimate", "The same, truth to estimate"),
        ("edge_rmsd", "The same, true edges to estimate"),
    ):
        sections += [f"<h2>{title}</h2>", scroll(objects_table(rows, "whole", measure))]
    sections += ["<h2>Estimates that failed</h2>", failures_list(rows)]
    write_page(path, "Local implicit surfaces: the paper again", sections)


def write_page(path: Path, title: str, sections: Sequence[str]) -> None:
    """Write HTML sections as one page that needs no other file."""
    write_text(
        path,
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>"
        f"<body>{''.join(sections)}</body></html>\n",
    )


def figure_of(picture: Picture) -> str:
    """Return a figure with its caption as HTML."""
    title, data = escape(picture.title), base64.b64encode(picture.png).decode()
    return (
        f'<figure><img alt="{title}" src="data:image/png;base64,{data}">'
        f"<figcaption><b>{title}.</b> {escape(picture.caption)}</figcaption></figure>"
    )


def scroll(table: str) -> str:
    """Return a table that scrolls where it is wider than the page."""
    return f'<div class="scroll">{table}</div>'
