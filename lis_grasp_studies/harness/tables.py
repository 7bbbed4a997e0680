"""Tables from groups of rows and columns of cells, as text, HTML, CSV, Markdown and LaTeX."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray

NONE = "–"
"""Text of a cell without a value."""

_VERDICTS = ("reproduced", "not reproduced")

_LATEX = str.maketrans(
    {**{c: f"\\{c}" for c in "%_&#"}, "β": r"$\beta$", "−": "$-$", "–": "--", "<": "$<$"}
)


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts: the name of its files, its title, column headings and rows."""

    name: str
    title: str
    head: tuple[str, ...]
    body: tuple[tuple[str, ...], ...]

    def section(self) -> str:
        """Return the title, and the table in a box that scrolls, as HTML."""
        title = f"<h2>{escape(self.title)}</h2>"
        if not self.body:
            return f"{title}<p>None.</p>"
        head = "".join(f"<th>{escape(text)}</th>" for text in self.head)
        body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in self.body)
        return (
            f'{title}<div class="scroll"><table><thead><tr>{head}</tr></thead>'
            f"<tbody>{body}</tbody></table></div>"
        )

    def text(self) -> str:
        """Return the table in columns for a terminal, below its title."""
        lines = [self.head, *self.body]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        padded = (
            "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])])
            for row in lines
        )
        return "\n".join([self.title, *(line.rstrip() for line in padded)]) + "\n"

    def csv(self) -> str:
        """Return the table as CSV."""
        return csv_text([self.head, *self.body])

    def markdown(self) -> str:
        """Return the table as Markdown."""
        lines = [self.head, ("---",) * len(self.head), *self.body]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

    def __format__(self, choice: str) -> str:
        """Return some lines and columns as Markdown; all by default.

        A choice is of conditions separated by " | ": "first 5", or texts separated by "; ", one of
        which is a cell of the line, after "touches=" the cell in this column. "columns hand; held"
        keeps these columns alone.
        """
        lines, kept = self.body, list(range(len(self.head)))
        for condition in choice.split(" | ") if choice else ():
            column, equals, texts = condition.rpartition("=")
            if condition.startswith("first "):
                lines = lines[: int(condition.split()[1])]
            elif condition.startswith("columns "):
                names = condition.removeprefix("columns ").split("; ")
                kept = [self.head.index(name) for name in names]
            else:
                k = self.head.index(column) if equals else None
                wanted = {*texts.split("; ")}
                lines = tuple(x for x in lines if wanted & ({*x} if k is None else {x[k]}))
        if not lines:
            raise ValueError(f"table {self.name} has no line {choice!r}")
        head, *body = (tuple(line[k] for k in kept) for line in (self.head, *lines))
        return Table(self.name, self.title, head, tuple(body)).markdown().rstrip()

    def latex(self) -> str:
        """Return the table for LaTeX with the package booktabs."""
        head, *lines = (
            " & ".join(text.translate(_LATEX) for text in row) for row in (self.head, *self.body)
        )
        rows = "".join(f"{line} \\\\\n" for line in lines)
        return (
            f"% {self.title}\n\\begin{{tabular}}{{l{'r' * (len(self.head) - 1)}}}\n\\toprule\n"
            f"{head} \\\\\n\\midrule\n{rows}\\bottomrule\n\\end{{tabular}}\n"
        )


Column = tuple[str, Callable[[Any], str]]
"""Heading of a column, and the text of its cell for a group of rows."""


def grouped_table(
    name: str, title: str, first: str, groups: Mapping[Any, Any], columns: Sequence[Column]
) -> Table:
    """Return a table with a line for each group that is not empty.

    Parameters
    ----------
    name, title
        See `Table`.
    first
        Heading of the first column, which has the names of the groups; several names in a tuple
        are several columns, whose headings `first` separates by " | ".
    groups
        Rows, or pairs of rows, by their names.
    columns
        Further columns.
    """
    body = tuple(
        (*(map(str, label) if isinstance(label, tuple) else [str(label)]), *cells)
        for label, group in groups.items()
        if len(group)
        for cells in [tuple(cell(group) for _, cell in columns)]
    )
    return Table(name, title, (*first.split(" | "), *(head for head, _ in columns)), body)


def where(rows: Iterable[Row], **columns: object) -> list[Row]:
    """Return the rows with these values in these columns."""
    return [row for row in rows if all(row[name] == value for name, value in columns.items())]


def split(rows: Iterable[Row], *columns: str) -> dict[Any, list[Row]]:
    """Return rows by their value in a column, or by their values in several, in order."""
    groups: dict[Any, list[Row]] = {}
    for row in rows:
        values = tuple(row[name] for name in columns)
        groups.setdefault(values if len(columns) > 1 else values[0], []).append(row)
    return groups


def columns_by(
    column: str,
    rows: Iterable[Row],
    cell: Callable[[Sequence[Row]], str],
    label: Callable[[Any], str] = str,
) -> list[Column]:
    """Return a column for each value in a column of rows, with a cell of the rows that have it."""

    def only(value: object) -> Callable[[Any], str]:
        return lambda rows: cell(where(rows, **{column: value}))

    return [(label(value), only(value)) for value in dict.fromkeys(row[column] for row in rows)]


def values_of(rows: Iterable[Row], column: str) -> FloatArray:
    """Return the values of a column that are there, as floating-point numbers, shape (N,)."""
    return np.array([row[column] for row in rows if row.get(column) is not None], dtype=np.float64)


def mean_cell(column: str, factor: float = 1.0, digits: int = 1) -> Callable[[Sequence[Row]], str]:
    """Return a cell with the mean of a column, times a factor."""
    return _statistic(np.mean, column, factor, digits)


def median_cell(
    column: str, factor: float = 1.0, digits: int = 1
) -> Callable[[Sequence[Row]], str]:
    """Return a cell with the median of a column, times a factor."""
    return _statistic(np.median, column, factor, digits)


def _statistic(
    function: Callable[..., Any], column: str, factor: float, digits: int
) -> Callable[[Sequence[Row]], str]:
    def cell(rows: Sequence[Row]) -> str:
        values = values_of(rows, column)
        return f"{factor * function(values):.{digits}f}" if len(values) else NONE

    return cell


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV; None is an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def rows_csv(rows: Sequence[Row], columns: Sequence[str] | None = None) -> str:
    """Return rows as CSV, by default with all columns that occur."""
    if columns is None:
        columns = list(dict.fromkeys(name for row in rows for name in row))
    return csv_text([columns, *([row.get(name) for name in columns] for row in rows)])


def write_tables(folder: Path, tables: Iterable[Table], *, latex: bool = False) -> None:
    """Write each table as CSV into a folder, and as LaTeX."""
    for table in tables:
        write_text(folder / f"{table.name}.csv", table.csv())
        if latex:
            write_text(folder / f"{table.name}.tex", table.latex())


def _cell(text: str) -> str:
    # A verdict has a colour: its first word is its CSS class.
    verdict = f' class="{text.split()[0]}"' if text in _VERDICTS else ""
    return f"<td{verdict}>{escape(text)}</td>"
