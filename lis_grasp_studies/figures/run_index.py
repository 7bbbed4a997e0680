"""Index page of the runs of several objects: a picture, the main numbers and the page of each.

lis-grasp run box mallet --output results/two
python -m lis_grasp_studies.figures.run_index results/two
"""

from __future__ import annotations

import base64
import sys
from collections.abc import Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.pipeline import Run
from lis_grasp.results.summary import headline
from lis_grasp_studies.figures.static_scene import draw_still
from lis_grasp_studies.figures.style import add_panel, new_figure, png_of
from lis_grasp_studies.harness.program import exit_code, read_options

_SIZE = 2.0  # [in] of a picture
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
    figure = new_figure(_SIZE, _SIZE, drawn_width=_SIZE)
    axes = add_panel(figure, 0.0, 0.0, 1.0, 1.0)
    draw_still(axes, truth=run.truth, estimate=run.mesh, contacts=run.contacts)
    picture = base64.b64encode(png_of(figure, dots_per_inch=100)).decode()
    numbers = headline(run.report or {})
    listed = "".join(f"<dt>{escape(n)}</dt><dd>{escape(what)}</dd>" for n, what in numbers)
    name = escape(run.folder.name)
    page = f'<a href="{quote(run.folder.name)}/scene.html"><img alt="{name}" src="data:image/png'
    return f'{page};base64,{picture}"><h2>{name}</h2><dl>{listed}</dl></a>\n'


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page; return the exit code."""
    options = read_options(__doc__, arguments, folder=Path)
    return exit_code("run_index", lambda: print(f"wrote {write_index(options.folder)}"))


if __name__ == "__main__":
    sys.exit(main())
