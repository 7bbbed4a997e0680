"""The page of a running task: served, renewed, and followed in a browser."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from lis_grasp.exceptions import LisGraspError
from lis_grasp.results.folder import scene_is_outdated
from lis_grasp.results.page import scene_of
from lis_grasp.visualization.scene_server import LOCALHOST, SCENE_FILE, serve_scene

_SERVE = "from lis_grasp.results.live_page import _serve; _serve()"


def follow(folder: Path, *, port: int = 0, host: str = LOCALHOST) -> None:
    """Serve a page that follows the results in a folder, until Ctrl-C; print its address.

    The folder may still be missing, and another process writes to it.
    """
    with TemporaryDirectory(prefix="lis-grasp-") as temporary:
        scene = Path(temporary) / SCENE_FILE
        serve_scene(temporary, port=port, host=host, renew=renewer(folder, scene), follow=True)


def renewer(
    folder: Path, scene: Path, complain: Callable[[str], None] = lambda _: None
) -> Callable[[], None]:
    """Return a function that writes a folder's scene again if its results are newer.

    `complain` gets a sentence if they cannot be read, perhaps because they are being written.
    """

    def renew() -> None:
        try:
            if folder.is_dir() and scene_is_outdated(folder, scene):
                scene_of(folder).save(scene)
        except (LisGraspError, OSError) as error:  # a file may vanish meanwhile
            complain(str(error))

    return renew


class Watched:
    """Context in which another process serves the page of a folder's run; a notebook displays it.

    Examples
    --------
    >>> with pipeline.Watched("watched_box") as page:
    ...     task = Task.of("box", hand="wsg50", prober="kinematic", touches=3)
    ...     _ = pipeline.explore_object(task, "watched_box")
    >>> page.address.startswith("http://127.0.0.1:")
    True
    """

    def __init__(self, folder: Path | str) -> None:
        command = [sys.executable, "-c", _SERVE, str(folder)]
        pipe = subprocess.PIPE
        self._server = subprocess.Popen(command, stdin=pipe, stderr=pipe, text=True)
        assert self._server.stderr is not None
        line = self._server.stderr.readline()
        if not line.startswith("scene: "):
            raise LisGraspError(line.strip() or "the page of the run cannot be served")
        self.address: str = line.split()[1]

    def __enter__(self) -> Watched:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._server.communicate()  # closes its pipe, which ends it

    def wait(self) -> None:
        """Serve until Ctrl-C."""
        with suppress(KeyboardInterrupt):
            self._server.wait()

    def _repr_html_(self) -> str:
        """Return the page in a frame."""
        return (
            f'<iframe src="{escape(self.address)}" title="A run"'
            ' style="width: 100%; height: 640px; border: 0; border-radius: 8px"></iframe>'
        )


def _serve() -> None:
    """Serve the page, in the process of a `Watched`, until its pipe closes."""

    def end() -> None:
        sys.stdin.read()
        os._exit(0)

    threading.Thread(target=end, daemon=True).start()
    try:
        follow(Path(sys.argv[1]))
    except LisGraspError as error:
        sys.exit(str(error))
