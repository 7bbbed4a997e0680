"""Index page of several runs in one folder: a picture, the main numbers and the page of each."""

from __future__ import annotations

from html import escape
from pathlib import Path
from urllib.parse import quote

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.pipeline.results import Run
from lis_grasp.pipeline.summary import headline
from lis_grasp.visualization.thumbnail import svg_of

_HEAD = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Runs</title><style>
body { font: 14px system-ui, sans-serif; margin: 2rem; color: #20242b; background: #eef0f2;
  display: grid; grid-template-columns: repeat(auto-fill, minmax(220px, 1fr)); gap: 16px; }
a { background: #fff; border-radius: 12px; padding: 16px; color: inherit; text-decoration: none; }
svg { width: 100%; height: 180px; } h2 { font-size: 16px; } dl { margin: 0; }
dt { font-weight: 650; float: left; clear: left; width: 5em; } dd { color: #6a717d; }
</style>"""


def write_index(folder: Path) -> Path:
    """Write index.html of the runs in the folders of a folder, and return its path.

    InvalidFileError if there are none, or results cannot be read.
    """
    runs = [Run.load(path.parent) for path in sorted(folder.glob("*/report.json"))]
    if not runs:
        raise InvalidFileError(f"{folder} has no folders of runs", path=folder)
    write_text(folder / "index.html", f"{_HEAD}{''.join(map(_card, runs))}</html>\n")
    return folder / "index.html"


def _card(run: Run) -> str:
    numbers = headline(run.report or {})
    listed = "".join(f"<dt>{escape(n)}</dt><dd>{escape(what)}</dd>" for n, what in numbers)
    picture, name = "" if run.mesh is None else svg_of(run.mesh), escape(run.folder.name)
    page = f'<a href="{quote(run.folder.name)}/scene.html">'
    return f"{page}{picture}<h2>{name}</h2><dl>{listed}</dl></a>\n"
