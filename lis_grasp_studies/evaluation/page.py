"""Results page of an evaluation, as Markdown and as HTML: answers, tables and charts by part."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp.io.limits import reading
from lis_grasp_studies.evaluation.configuration import Configuration
from lis_grasp_studies.evaluation.grasp_parts import GraspsPart
from lis_grasp_studies.evaluation.grasp_tables import beside_table
from lis_grasp_studies.evaluation.part import Part
from lis_grasp_studies.harness.page import write_page
from lis_grasp_studies.harness.tables import Table, split, write_tables

_METHOD = (
    "Objects are the units of intervals for “other objects”: whole objects are drawn, each with all"
    " its trials. Other intervals of rates are for other seeds on the same objects. All are of"
    " 95 %. A trial without a surface or a grasp counts as not held. The first table of a part has"
    " its losses."
)


Parts = Mapping[str, list[Row]]
"""Rows by part, each in the order of its trials, as `Configuration.ordered` returns them."""


def published_numbers(configuration: Configuration, parts: Parts) -> dict[str, dict[str, float]]:
    """Return the numbers of each part that has rows, for pages that quote them."""
    return {
        name: {"objects": len({row.get("object", row.get("shape")) for row in of})}
        | configuration.parts[name].numbers(of)
        for name, of in parts.items()
    }


def fill_template(
    template: Path, configuration: Configuration, parts: Parts, earlier: Sequence[Row] = ()
) -> str:
    """Return a page: a text in which numbers, tables and the measured state are fields.

    Fields are those of Python's format: ``{grasps[blend]:.0f}`` is a number of a part,
    ``{tables[lies.lies]:main | first 5}`` lines of a table (see `Table`), ``{state}`` the version
    and the commits, ``{hours}`` those of one core. Arguments as of `write_results`.

    Raises `InvalidFileError` if the rows have no such number, table or line.
    """
    tables = {
        f"{name}.{table.name}": table
        for name, of in parts.items()
        for table in _tables(configuration.parts[name], of, earlier)
    }
    measured = {"tables": tables, "state": state_of(parts), "hours": hours_of(parts)}
    fields = published_numbers(configuration, parts) | measured
    with reading(template, "text"):
        text = template.read_text(encoding="utf-8")
    try:
        return text.format_map(fields)
    except (LookupError, ValueError, AttributeError, TypeError) as error:
        raise InvalidFileError(
            f"{template} must have fields that the rows fill; one is wrong: {error}", path=template
        ) from None


def _tables(part: Part, rows: Sequence[Row], earlier: Sequence[Row]) -> list[Table]:
    """Return the tables of a part that have lines."""
    tables = part.tables(rows)
    if isinstance(part, GraspsPart) and earlier:
        tables.insert(0, beside_table(rows, earlier, part.objects))
    return [table for table in tables if table.body]


def state_of(parts: Parts) -> str:
    """Return the version and the commit of all rows; of several, the parts of each."""
    states = split((row for of in parts.values() for row in of), "version", "commit")
    texts = []
    for (version, commit), rows in states.items():
        named = f" ({', '.join(split(rows, 'part'))})" if len(states) > 1 else ""
        texts.append(f"version {version} at commit {commit}{named}")
    return " and ".join(texts)


def write_results(
    folder: Path,
    configuration: Configuration,
    parts: Parts,
    *,
    command: str,
    earlier: Sequence[Row] = (),
) -> None:
    """Write ``results.md``, ``report.html``, ``numbers.json``, every table and every chart.

    Parameters
    ----------
    folder
        Exists already.
    configuration, parts
        Of the evaluation, and its rows; parts without rows are left out.
    command
        That repeats it.
    earlier
        Rows of the study of unknown objects by an earlier version, compared trial by trial.
    """
    answers = tuple(
        (*answer, name)
        for name, of in parts.items()
        for answer in configuration.parts[name].answers(of).items()
    )
    title = "Results"
    head = _header(configuration, parts, command)
    table = Table("answers", "Numbers first", ("question", "answer", "part"), answers)
    markdown = [f"# {title}\n\n{head}\n", table.markdown(), _METHOD + "\n"]
    marked = re.sub("`([^`]*)`", r"<code>\1</code>", escape(head))
    html = [f"<h1>{title}</h1><p>{marked}</p>", table.section(), f"<p>{escape(_METHOD)}</p>"]
    for name, of in parts.items():
        part = configuration.parts[name]
        tables, pictures = _tables(part, of, earlier), part.pictures(of)
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
    numbers = json.dumps(published_numbers(configuration, parts), indent=1)
    write_text(folder / "numbers.json", f"{numbers}\n")


def _header(configuration: Configuration, parts: Parts, command: str) -> str:
    rows = [row for of in parts.values() for row in of]
    trials = list(configuration.jobs(None))
    whole = {(job.trial, job.variants) for job in trials}
    left = [j for j in configuration.missing(None, rows) if (j.trial, j.variants) in whole]
    return (
        f"Measured with {state_of(parts)}, by `{command}`: {len(rows)} rows of"
        f" {len(trials) - len(left)} of {len(trials)} trials."
    )


def _counts(rows: Sequence[Row]) -> str:
    counts = [
        f"{len({row[column] for row in rows})} {text}"
        for column, text in (("object", "objects"), ("hand", "hands"), ("seed", "seeds"))
        if column in rows[0]
    ]
    return f"{len(rows)} rows: {', '.join(counts)}; {hours_of({'': rows}):.2f} hours of jobs."


def hours_of(parts: Mapping[str, Sequence[Row]]) -> float:
    """Return the time of the jobs of some rows [h]; the rows of a job have the same."""
    return sum({row["job_seconds"] for of in parts.values() for row in of}) / 3600.0
