"""Index page of the runs of several objects: a picture, the main numbers and the page of each.

lis-grasp run box mallet --output results/two
python -m lis_grasp_studies.figures.run_index results/two
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.pipeline import Run
from lis_grasp.results.folder import PAGE
from lis_grasp.results.summary import headline
from lis_grasp.visualization.notebook import image
from lis_grasp_studies.harness.program import exit_code, read_options

_WIDTH = 220  # [pixels] of a picture
_HEAD = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Runs</title><style>
body { font: 14px system-ui, sans-serif; margin: 2rem; color: #20242b; background: #eef0f2;
  display: grid; grid-template-columns: repeat(auto-fill, minmax(220px, 1fr)); gap: 16px; }
a { background: #fff; border-radius: 12px; padding: 16px; color: inherit; text-decoration: none; }
img { display: block; margin: auto; max-width: 100%; } h2 { font-size: 16px; } dl { margin: 0; }
dt { font-weight: 650; float: left; clear: left; width: 6em; } dd { color: #6a717d; }
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
    picture = run.png()
    numbers = headline(run.report or {})
    listed = "".join(f"<dt>{escape(n)}</dt><dd>{escape(what)}</dd>" for n, what in numbers)
    name = escape(run.folder.name)
    shown = "" if picture is None else image(picture, _WIDTH)
    page = f'<a href="{quote(run.folder.name)}/{PAGE}">'
    return f"{page}{shown}<h2>{name}</h2><dl>{listed}</dl></a>\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page; return the exit code."""
    options = read_options(__doc__, arguments, folder=Path)
    return exit_code("run_index", lambda: print(f"wrote {write_index(options.folder)}"))


if __name__ == "__main__":
    sys.exit(main())
