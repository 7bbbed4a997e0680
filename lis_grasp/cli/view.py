"""`lis-grasp view`: local web server for the scene of a folder of results."""

from __future__ import annotations

import argparse
import os
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from lis_grasp.cli.progress import complain, say
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.results.folder import scene_is_outdated
from lis_grasp.results.live_page import Watched, follow, renewer
from lis_grasp.results.page import scene_of
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
    parser.add_argument(
        "--follow",
        action="store_true",
        help="show what another command writes there as it comes; the folder may be missing yet",
    )
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Serve the scene until Ctrl-C; write it whenever it is missing or older than its files.

    If the folder cannot be written to, the scene is in a temporary one.
    """
    from lis_grasp.visualization import serve_scene

    folder = options.directory
    if options.follow:
        follow(folder, port=options.port, host=options.host)
        return
    if not os.path.isdir(folder):
        raise InvalidFileError(f"{folder} is not a folder: name a folder of results", path=folder)
    with TemporaryDirectory(prefix="lis-grasp-") as temporary:
        scene = folder / SCENE_FILE
        if not os.access(folder, os.W_OK):
            scene = Path(temporary) / SCENE_FILE
        if scene_is_outdated(folder, scene):
            scene_of(folder).save(scene)
            say(f"wrote {scene}")
        outdated = "lis-grasp: the scene is of earlier results: "
        renew = renewer(folder, scene, lambda text: complain(outdated + text))
        serve_scene(scene.parent, port=options.port, host=options.host, renew=renew)


@contextmanager
def watched(folder: Path | None) -> Iterator[None]:
    """Show a growing folder in the browser, afterwards until Ctrl-C; nothing for None."""
    if folder is None:
        yield
        return
    with Watched(folder) as page:
        complain(f"watch: {page.address}")
        if sys.platform == "darwin" or os.environ.keys() & {"DISPLAY", "WAYLAND_DISPLAY"}:
            webbrowser.open(page.address)
        yield
        complain(f"the page stays at {page.address} until Ctrl-C")
        page.wait()
