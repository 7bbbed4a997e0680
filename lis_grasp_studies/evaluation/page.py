"""Results page of an evaluation, as Markdown and as HTML: answers, tables and charts by part."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp_studies.evaluation.configuration import Configuration
from lis_grasp_studies.evaluation.grasp_parts import GraspsPart
from lis_grasp_studies.evaluation.grasp_tables import beside_table
from lis_grasp_studies.evaluation.part import Answer
from lis_grasp_studies.harness.page import write_page
from lis_grasp_studies.harness.tables import Table, write_tables

_METHOD = (
    "Objects are the units of intervals for “other objects”: whole objects are drawn, each with all"
    " its trials. Other intervals of rates are for other seeds on the same objects. All are of"
    " 95 %. A trial without a surface or a grasp counts as not held. The first table of a part has"
    " its losses."
)


def published_numbers(
    configuration: Configuration, rows: Sequence[Row]
) -> dict[str, dict[str, float]]:
    """Return the numbers of the answers by part and question, for pages that quote them."""
    answers = _answers(configuration, configuration.ordered(rows))
    return {f"{part}: {answer.question}": answer.numbers for part, answer in answers}


def write_results(
    folder: Path,
    configuration: Configuration,
    rows: Sequence[Row],
    *,
    command: str,
    earlier: Sequence[Row] = (),
) -> None:
    """Write ``results.md``, ``report.html``, ``numbers.json``, every table and every chart.

    Parameters
    ----------
    folder
        Exists already.
    configuration
        Parts without rows are left out.
    rows
        Of the evaluation.
    command
        That repeats it.
    earlier
        Rows of the study of unknown objects by an earlier version, compared trial by trial.
    """
    parts = configuration.ordered(rows)
    answers = _answers(configuration, parts)
    title = "Results"
    head = _header(configuration, parts, command)
    table = Table(
        "answers",
        "Numbers first",
        ("question", "answer", "part"),
        tuple((answer.question, answer.answer, part) for part, answer in answers),
    )
    markdown = [f"# {title}\n\n{head}\n", table.markdown(), _METHOD + "\n"]
    marked = re.sub("`([^`]*)`", r"<code>\1</code>", escape(head))
    html = [f"<h1>{title}</h1><p>{marked}</p>", table.section(), f"<p>{escape(_METHOD)}</p>"]
    for name, of in parts.items():
        if not of:
            continue
        part = configuration.parts[name]
        tables, pictures = part.tables(of), part.pictures(of)
        if isinstance(part, GraspsPart) and earlier:
            tables.insert(0, beside_table(of, earlier, part.objects))
        tables = [table for table in tables if table.body]
        counts = _counts(of)
        markdown.append(f"## {part.title}\n\n{counts}\n")
        html.append(f"<h1>{escape(part.title)}</h1><p>{escape(counts)}</p>")
        for picture in pictures:
            picture.save(folder / "charts" / name)
            file = f"charts/{name}/{picture.file_name}.png"
            markdown.append(f"![{picture.title}]({file})\n\n*{picture.caption}*\n")
        html += [picture.html() for picture in pictures]
        for table in tables:
            markdown.append(f"### {table.title}\n\n{table.markdown()}")
            html.append(table.section())
        write_tables(folder / "tables" / name, tables)
    write_text(folder / "results.md", "\n".join(markdown))
    write_page(folder / "report.html", title, html)
    numbers = json.dumps(published_numbers(configuration, rows), indent=1)
    write_text(folder / "numbers.json", f"{numbers}\n")


def _answers(
    configuration: Configuration, parts: Mapping[str, list[Row]]
) -> list[tuple[str, Answer]]:
    return [
        (name, answer)
        for name, rows in parts.items()
        if rows
        for answer in configuration.parts[name].answers(rows)
    ]


def _header(configuration: Configuration, parts: Mapping[str, list[Row]], command: str) -> str:
    rows = [row for of in parts.values() for row in of]
    versions = sorted({str(row["version"]) for row in rows})
    commits = sorted({str(row["commit"]) for row in rows})
    trials = list(configuration.jobs(None))
    whole = {(job.trial, job.variants) for job in trials}
    left = [j for j in configuration.missing(None, rows) if (j.trial, j.variants) in whole]
    text = (
        f"Measured with lis_grasp {', '.join(versions)}, commit {', '.join(commits)}, by"
        f" `{command}`: {len(rows)} rows of {len(trials) - len(left)} of {len(trials)} trials."
    )
    return text if len(commits) == 1 else f"{text} Rows of several commits are mixed."


def _counts(rows: Sequence[Row]) -> str:
    counts = [
        f"{len({row[column] for row in rows})} {text}"
        for column, text in (("object", "objects"), ("hand", "hands"), ("seed", "seeds"))
        if column in rows[0]
    ]
    hours = sum({(row["job_seconds"]) for row in rows}) / 3600.0
    return f"{len(rows)} rows: {', '.join(counts)}; {hours:.2f} hours of jobs."
