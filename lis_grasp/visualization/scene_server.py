"""Local web server for the scene of a folder of results."""

from __future__ import annotations

import errno
import io
import os
import re
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError

SCENE_FILE = "scene.html"
LOCALHOST = "127.0.0.1"
"""Address at which only this machine can connect."""


class SceneServer(ThreadingHTTPServer):
    """Web server for the scene.html of a folder, which is read at each request.

    With `follow` its page shows each new state of the scene, which may be missing at first, and
    `state` changes with it. It listens on this machine only, unless `host` is another of its
    addresses, such as 0.0.0.0 in a container. Port 0 takes a free port. `renew` is called before
    each answer, one call at a time, and may write the scene again. Requests by another name than
    localhost and `host` are refused: a page of another site, whose name was made to point to this
    machine, cannot read the scene.

    Raises
    ------
    InvalidFileError
        If the folder has no scene.
    InvalidOptionError
        If the port or the host cannot be used.
    """

    daemon_threads = True
    # Ports that were just closed can be used again; ports in use cannot.
    allow_reuse_address = True
    request_queue_size = 128

    def __init__(
        self,
        directory: Path | str,
        *,
        port: int,
        host: str = LOCALHOST,
        renew: Callable[[], None] = lambda: None,
        follow: bool = False,
    ) -> None:
        self.scene, self.follow = Path(directory) / SCENE_FILE, follow
        self._renew, self._renewing = renew, Lock()
        self._host = LOCALHOST if host in ("", "0.0.0.0") else host
        self.names = {LOCALHOST, "localhost", self._host.lower()}
        if not follow and not os.path.isfile(self.scene):
            raise InvalidFileError(f"{self.scene} does not exist", path=self.scene)
        try:
            super().__init__((host, port), _SceneHandler)
        except (OSError, OverflowError, UnicodeError) as error:
            no_name = isinstance(error, UnicodeError | socket.gaierror)
            if no_name or getattr(error, "errno", None) == errno.EADDRNOTAVAIL:
                required = f"an address of this machine ({error})"
                raise InvalidOptionError.out_of_range("host", host, required) from None
            required = f"from 0 to 65535, and free at {host} ({error}); 0 takes any"
            raise InvalidOptionError.out_of_range("port", port, required) from None

    def renew(self) -> None:
        """Let the scene be written again, if it is outdated."""
        with self._renewing:
            self._renew()

    def state(self) -> str:
        """Return what distinguishes the scene from earlier ones; "" if there is none yet."""
        self.renew()
        with suppress(FileNotFoundError):
            return str(self.scene.stat().st_mtime_ns)
        return ""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print the traceback of a defect, but nothing for a client that has gone."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)

    @property
    def address(self) -> str:
        """Address of the scene for a browser."""
        return f"http://{self._host}:{self.server_address[1]}/"


class _SceneHandler(SimpleHTTPRequestHandler):
    server: SceneServer
    timeout = 30.0  # [s] of silence, then a client is dropped

    def translate_path(self, path: str) -> str:
        """Return the file of the scene; for all others an empty path, which is not found."""
        named = path.split("?")[0]
        if named == "/" and self.server.follow:
            return str(resources.files(__package__) / "assets" / "follow.html")
        return str(self.server.scene) if named in ("/", f"/{SCENE_FILE}") else ""

    def send_head(self) -> io.BytesIO | BinaryIO | None:
        """Send the headers and return the file; refuse other names of this machine."""
        named = re.sub(r":\d*$", "", self.headers.get("Host", LOCALHOST)).lower()
        if named not in self.server.names:
            self.send_error(403, "The scene is shown at localhost and the given host only")
            return None
        if not self.server.follow:
            self.server.renew()
        elif self.path == "/state":
            text = self.server.state().encode("ascii")
            self.send_response(200)
            self.send_header("Content-Type", "text/plain")
            self.send_header("Content-Length", str(len(text)))
            self.end_headers()
            return io.BytesIO(text)
        return super().send_head()

    def end_headers(self) -> None:
        """Add to the headers that the page must not be cached."""
        self.send_header("Cache-Control", "no-store")
        super().end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing per request."""


def serve_scene(directory: Path | str, **options: Any) -> None:
    """Serve a folder's scene.html until Ctrl-C, and print its address; see `SceneServer`."""
    with SceneServer(directory, **options) as server:
        print(f"scene: {server.address} (Ctrl-C ends)", file=sys.stderr, flush=True)
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            print(file=sys.stderr)
