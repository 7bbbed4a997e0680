"""`lis-grasp view`: local web server for the scene of a folder of results."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from tempfile import TemporaryDirectory

from lis_grasp.cli.progress import complain, say
from lis_grasp.exceptions import InvalidFileError, LisGraspError
from lis_grasp.pipeline.results_folder import scene_is_outdated
from lis_grasp.pipeline.run_scene import scene_of
from lis_grasp.visualization.scene_server import LOCALHOST, SCENE_FILE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("directory", type=Path, metavar="DIR", help="folder of results")
    parser.add_argument("--port", type=int, default=7000, help="port on localhost (default: 7000)")
    parser.add_argument(
        "--host",
        default=LOCALHOST,
        metavar="ADDRESS",
        help="address to listen on; 0.0.0.0 in a container whose port is published, else this"
        f" machine alone (default: {LOCALHOST})",
    )
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Serve the scene until Ctrl-C; write it whenever it is missing or older than its files.

    The scene of a folder that cannot be written to is in a temporary one.
    """
    from lis_grasp.visualization import serve_scene

    if not os.path.isdir(options.directory):
        raise InvalidFileError(
            f"{options.directory} is not a folder: name a folder of results",
            path=options.directory,
        )
    with TemporaryDirectory(prefix="lis-grasp-") as temporary:
        scene = options.directory / SCENE_FILE
        if not os.access(options.directory, os.W_OK):
            scene = Path(temporary) / SCENE_FILE
        if _renew(options.directory, scene):
            say(f"wrote {scene}")

        def renew() -> None:
            try:
                _renew(options.directory, scene)
            except LisGraspError as error:  # the folder is being written to, perhaps
                complain(f"lis-grasp: the scene is of earlier results: {error}")

        serve_scene(scene.parent, port=options.port, host=options.host, renew=renew)


def _renew(directory: Path, scene: Path) -> bool:
    """Write the scene of a folder's results if it is outdated; return whether it was."""
    outdated = scene_is_outdated(directory, scene)
    if outdated:
        scene_of(directory).save(scene)
    return outdated
