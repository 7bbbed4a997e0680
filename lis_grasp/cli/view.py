"""`lis-grasp view`: local web server for the scene of a folder of results."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from lis_grasp.cli.progress import say
from lis_grasp.cli.results_folder import scene_is_outdated
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.visualization.run_scene import write_scene_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("directory", type=Path, metavar="DIR", help="folder of results")
    parser.add_argument("--port", type=int, default=7000, help="port on localhost (default: 7000)")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Serve the scene until Ctrl-C; write it first if it is missing or outdated."""
    from lis_grasp.visualization import serve_scene

    if not os.path.isdir(options.directory):
        raise InvalidFileError(
            f"{options.directory} is not a folder: name a folder of results",
            path=options.directory,
        )
    if scene_is_outdated(options.directory):
        say(f"wrote {write_scene_of(options.directory)}")
    serve_scene(options.directory, port=options.port)
