"""Self-contained HTML report pages, and their pictures."""

from __future__ import annotations

import argparse
import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from lis_grasp.cli.progress import say
from lis_grasp.io.atomic_writing import whole_file, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of a report: its title, its caption, and the figure as PNG and PDF."""

    title: str
    caption: str
    png: bytes
    pdf: bytes
    narrow: Picture | None = None  #: the same for one column of a page

    @classmethod
    def of(cls, title: str, caption: str, figure: Figure, narrow: Figure | None = None) -> Picture:
        """Return the picture of a drawn figure, perhaps with another for one column."""
        # The option of the command line needs no matplotlib.
        from lis_grasp_studies.figures.style import pdf_of, png_of

        column = None if narrow is None else cls.of(f"{title}, one column", caption, narrow)
        return cls(title, caption, png_of(figure), pdf_of(figure), column)

    @property
    def file_name(self) -> str:
        """Name of its files, without suffix."""
        return re.sub(r"\W+", "_", self.title.lower()).strip("_")

    def save(self, folder: Path) -> None:
        """Write the figure as PNG and PDF into a folder."""
        for suffix, content in ((".png", self.png), (".pdf", self.pdf)):
            with whole_file(folder / f"{self.file_name}{suffix}") as temporary:
                temporary.write_bytes(content)
        if self.narrow is not None:
            self.narrow.save(folder)

    def html(self) -> str:
        """Return the figure with its caption as HTML."""
        title, data = escape(self.title), base64.b64encode(self.png).decode()
        return (
            f'<figure><img alt="{title}" src="data:image/png;base64,{data}">'
            f"<figcaption><b>{title}.</b> {escape(self.caption)}</figcaption></figure>"
        )


def add_figures(parser: argparse.ArgumentParser) -> None:
    """Add the option to write the figures as files."""
    parser.add_argument(
        "--figures",
        type=Path,
        metavar="DIR",
        help="also write each figure as PDF and PNG, as wide as two columns of an IEEE page,"
        " charts of bars for one column too",
    )


def write_figures(folder: Path | None, pictures: Sequence[Picture]) -> None:
    """Write the pictures as PDF and PNG, named after their titles, and say so; None for nowhere."""
    if folder is None:
        return
    for picture in pictures:
        picture.save(folder)
    number = sum(1 if picture.narrow is None else 2 for picture in pictures)
    say(f"wrote {number} figures as .pdf and .png to {folder}")


def write_page(path: Path, title: str, sections: Sequence[str]) -> None:
    """Write HTML sections as one page that needs no other file."""
    write_text(
        path,
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>"
        f"<body>{''.join(sections)}</body></html>\n",
    )
