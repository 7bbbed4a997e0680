"""`lis-grasp figure`: a figure of a folder of results, for a paper."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli.progress import say
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.atomic_writing import write_bytes

HELP = "draw object, estimate, contacts and best grasp of a run as a figure for a paper"
EXAMPLES = (("results/demo --output demo.pdf", "two columns of a page, from two views"),)

_KINDS = (".pdf", ".svg", ".png")
_WIDTH = 7.16  # [in], two columns of an IEEE page
_NARROWEST = 2.0  # [in], where the colour bar still has room for its text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("folder", type=Path, metavar="RUN", help="folder of results")
    parser.add_argument(
        "--output",
        type=Path,
        metavar="FILE",
        help=f"the figure, one of {', '.join(_KINDS)} (default: the folder's name, here, as PDF)",
    )
    parser.add_argument(
        "--width",
        type=float,
        default=_WIDTH,
        metavar="INCHES",
        help=f"width in inches; text keeps its size (default: {_WIDTH}, two columns of a page)",
    )
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Draw and write the figure."""
    folder = options.folder
    path = options.output or Path(f"{folder.resolve().name}{_KINDS[0]}")
    if path.suffix.lower() not in _KINDS:
        raise InvalidOptionError(
            f"a figure is a file of one of {', '.join(_KINDS)}; `output` is {path}",
            option="output",
            value=str(path),
        )
    if not options.width >= _NARROWEST:
        needed = f"at least {_NARROWEST:g} inches"
        raise InvalidOptionError.out_of_range("width", options.width, needed)
    # They load matplotlib.
    from lis_grasp.pipeline import Run
    from lis_grasp_studies.figures.run_figures import DOTS_PER_INCH, run_figure
    from lis_grasp_studies.figures.style import file_of

    figure = run_figure(Run.load(folder), options.width)
    write_bytes(path, file_of(figure, path.suffix.lower()[1:], dots_per_inch=DOTS_PER_INCH))
    say(f"wrote {path}")
