"""A table of texts, as HTML, CSV, Markdown and LaTeX."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

_LATEX = str.maketrans(
    {
        "%": r"\%",
        "_": r"\_",
        "&": r"\&",
        "#": r"\#",
        "β": r"$\beta$",
        "−": "$-$",
        "–": "--",
        "<": "$<$",
    }
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
        return csv_text([self.head, *self.body])

    def markdown(self) -> str:
        """Return the table as Markdown."""
        lines = [self.head, ("---",) * len(self.head), *self.body]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

    def latex(self) -> str:
        """Return the table for LaTeX with the package booktabs."""
        lines = [" & ".join(text.translate(_LATEX) for text in row) for row in self.body]
        head = " & ".join(text.translate(_LATEX) for text in self.head)
        rows = "".join(f"{line} \\\\\n" for line in lines)
        return (
            f"% {self.title}\n\\begin{{tabular}}{{l{'r' * (len(self.head) - 1)}}}\n\\toprule\n"
            f"{head} \\\\\n\\midrule\n{rows}\\bottomrule\n\\end{{tabular}}\n"
        )


def csv_text(rows: Iterable[Sequence[str]]) -> str:
    """Return rows of texts as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
