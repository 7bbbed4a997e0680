"""Self-contained HTML report pages, and tables as HTML, CSV, Markdown and LaTeX."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from lis_grasp.io.atomic_writing import write_text

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; margin: 2rem auto; max-width: 62rem;
  padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.25rem; margin-top: 2.5rem; }
figure { margin: 2rem 0; } img { max-width: 100%; height: auto; }
figcaption { color: #444; font-size: .92rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .85rem; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #ddd; }
td:first-child, th:first-child { text-align: left; font-weight: 500; }
.reproduced { color: #0a6b3d; } .not { color: #b3261e; font-weight: 600; }
code { background: #f3f3f3; padding: .1rem .3rem; }
"""

_VERDICTS = ("reproduced", "not reproduced")

_LATEX = str.maketrans(
    {**{c: f"\\{c}" for c in "%_&#"}, "β": r"$\beta$", "−": "$-$", "–": "--", "<": "$<$"}
)


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of a report: its title, its caption, and the PNG."""

    title: str
    caption: str
    png: bytes

    def html(self) -> str:
        """Return the figure with its caption as HTML."""
        title, data = escape(self.title), base64.b64encode(self.png).decode()
        return (
            f'<figure><img alt="{title}" src="data:image/png;base64,{data}">'
            f"<figcaption><b>{title}.</b> {escape(self.caption)}</figcaption></figure>"
        )


@dataclass(frozen=True, slots=True)
class TextTable:
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

    def csv(self) -> str:
        """Return the table as CSV."""
        return csv_text([self.head, *self.body])

    def markdown(self) -> str:
        """Return the table as Markdown."""
        lines = [self.head, ("---",) * len(self.head), *self.body]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

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


def _cell(text: str) -> str:
    # A verdict has a colour: its first word is its CSS class.
    verdict = f' class="{text.split()[0]}"' if text in _VERDICTS else ""
    return f"<td{verdict}>{escape(text)}</td>"


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV; None is an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def write_page(path: Path, title: str, sections: Sequence[str]) -> None:
    """Write HTML sections as one page that needs no other file."""
    write_text(
        path,
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>"
        f"<body>{''.join(sections)}</body></html>\n",
    )
