"""A run's scene on a local web server, for `lis-grasp view`."""

from __future__ import annotations

import os
import sys
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError

SCENE_FILE = "scene.html"
_LOCALHOST = "127.0.0.1"


class SceneServer(ThreadingHTTPServer):
    """Serves one folder's scene.html, as it is at each request, to this machine only.

    Parameters
    ----------
    directory
        Folder that holds ``scene.html``.
    port
        Port on 127.0.0.1; 0 takes a free one.

    Raises
    ------
    InvalidFileError
        If the folder holds no scene.
    InvalidOptionError
        If the port cannot be used.
    """

    daemon_threads = True
    # A port left a moment ago can be taken again; one in use cannot.
    allow_reuse_address = True

    def __init__(self, directory: Path | str, *, port: int) -> None:
        self.scene = Path(directory) / SCENE_FILE
        if not os.path.isfile(self.scene):
            raise InvalidFileError(
                f"{self.scene} does not exist: name a folder that holds a {SCENE_FILE}"
            )
        if not 0 <= port <= 65535:
            raise InvalidOptionError(f"a port is a number from 0 to 65535; {port} came")
        try:
            super().__init__((_LOCALHOST, port), _SceneHandler)
        except OSError as error:
            raise InvalidOptionError(
                f"port {port} cannot be used ({error.strerror}): choose another, 0 for any free one"
            ) from None

    @property
    def address(self) -> str:
        """Where a browser finds the scene."""
        return f"http://{_LOCALHOST}:{self.server_address[1]}/"


class _SceneHandler(BaseHTTPRequestHandler):
    server: SceneServer

    def do_GET(self) -> None:
        """Send the scene, or say that there is nothing else."""
        self._answer(body=True)

    def do_HEAD(self) -> None:
        """Send what `do_GET` would send, without the page."""
        self._answer(body=False)

    def _answer(self, *, body: bool) -> None:
        if self.path.split("?")[0] not in ("/", f"/{SCENE_FILE}"):
            self.send_error(HTTPStatus.NOT_FOUND, "only the scene is served here")
            return
        try:
            page = self.server.scene.read_bytes()
        except OSError as error:
            self.send_error(HTTPStatus.NOT_FOUND, f"the scene cannot be read: {error.strerror}")
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(page)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        if body:
            self.wfile.write(page)

    def log_message(self, format: str, *args: Any) -> None:
        """Keep quiet about every request."""


def serve_scene(directory: Path | str, *, port: int) -> None:
    """Serve a folder's scene.html until Ctrl-C, and say where.

    The page is read anew at each request: reload it to see a newer run. The server answers this
    machine only, and with nothing but the scene.

    Parameters
    ----------
    directory
        Folder that holds ``scene.html``.
    port
        Port on 127.0.0.1; 0 takes a free one.

    Raises
    ------
    InvalidFileError
        If the folder holds no scene.
    InvalidOptionError
        If the port cannot be used.
    """
    with SceneServer(directory, port=port) as server:
        print(f"scene: {server.address} (Ctrl-C ends)", file=sys.stderr, flush=True)
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            print(file=sys.stderr)
