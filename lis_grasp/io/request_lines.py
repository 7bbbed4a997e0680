"""Requests and answers as JSON, one object a line, over standard streams or a local socket."""

from __future__ import annotations

import json
import os
import socket
import socketserver
from collections.abc import Callable
from contextlib import suppress
from io import BufferedIOBase
from pathlib import Path
from threading import BoundedSemaphore, Lock
from typing import Any, BinaryIO, TypeAlias

from lis_grasp.exceptions import InvalidOptionError, LisGraspError
from lis_grasp.io.limits import MEBIBYTE

_Stream: TypeAlias = BinaryIO | BufferedIOBase
Answer = Callable[[dict[str, Any]], dict[str, Any]]
"""Returns the answer to a request; its errors of this package become answers."""

LOCALHOST = "127.0.0.1"
"""The address of the socket: only this machine can connect."""

_MOST_BYTES = MEBIBYTE  # in a request
_MOST_CLIENTS = 8  # at once


def answer_lines(
    answer: Answer, requests: _Stream, answers: _Stream, *, trusted: bool = True
) -> bool:
    """Answer each line of a stream until it ends; return whether a request was to stop.

    A request may have an ``id``, a text or a whole number, which its answer repeats. An answer has
    ``ok``, and an ``error`` in words if it is false: a line that is no JSON object, that is longer
    than 1 MiB (the rest of it is skipped), or a request that cannot be carried out.
    ``{"request": "stop"}`` ends.

    A stream that is not `trusted` ends after the first line that is not a request: a web page that
    posts to the port sends header lines first.
    """
    while line := requests.readline(_MOST_BYTES + 1):
        is_whole = len(line) <= _MOST_BYTES
        request = _parsed(line) if is_whole else f"a request has at most {_MOST_BYTES} bytes"
        stop = isinstance(request, dict) and request.get("request") == "stop"
        if isinstance(request, str):
            written = {"ok": False, "error": request}
        else:
            written = {"ok": True} if stop else _answered(answer, request)
            written = {name: request[name] for name in ("id",) if name in request} | written
        answers.write(json.dumps(written, allow_nan=False).encode() + b"\n")
        answers.flush()
        if stop or (isinstance(request, str) and not trusted):
            return stop
        while not is_whole and line and not line.endswith(b"\n"):
            line = requests.readline(_MOST_BYTES)
    return False


def _parsed(line: bytes) -> dict[str, Any] | str:
    """Return the request of a line, or what is wrong with it."""
    try:
        request = json.loads(line, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        return f"a request is one JSON object a line; this is not ({str(error)[:100]})"
    if not isinstance(request, dict):
        return f"a request is a JSON object; this is of type {type(request).__name__}"
    if not isinstance(request.get("id", ""), str | int):  # the answer repeats it as JSON
        return "the id of a request is a text or a whole number"
    return request


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no number")


def _answered(answer: Answer, request: dict[str, Any]) -> dict[str, Any]:
    try:
        return {"ok": True, **answer(request)}
    except LisGraspError as error:
        return {"ok": False, "error": str(error)}
    except Exception as error:  # noqa: BLE001 - a service goes on
        return {"ok": False, "error": f"the request failed: {type(error).__name__}: {error}"}


class _Connection(socketserver.StreamRequestHandler):
    server: _Server

    def handle(self) -> None:
        try:
            if not self.server.admit(self.connection):
                busy = {"ok": False, "error": f"there are {_MOST_CLIENTS} connections already"}
                self.wfile.write(json.dumps(busy).encode() + b"\n")
                return
            try:
                stop = answer_lines(self._answer, self.rfile, self.wfile, trusted=False)
            finally:
                self.server.silent.pop(self.connection, None)
                self.server.places.release()
        except OSError:  # the client is gone
            return
        if stop:
            self.server.shutdown()

    def _answer(self, request: dict[str, Any]) -> dict[str, Any]:
        self.server.silent.pop(self.connection, None)
        return self.server.answer(request)


class _Server(socketserver.ThreadingMixIn, socketserver.TCPServer):
    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = 128

    def __init__(self, address: tuple[str, int] | str, answer: Answer) -> None:
        self.address_family = socket.AF_UNIX if isinstance(address, str) else socket.AF_INET
        self.places, self._answer, self._answering = BoundedSemaphore(_MOST_CLIENTS), answer, Lock()
        self._admitting = Lock()
        self.silent: dict[socket.socket, None] = {}  # clients that have sent no request
        super().__init__(address, _Connection)  # type: ignore[arg-type]

    def admit(self, client: socket.socket) -> bool:
        """Return whether a client has a place; if none is free, the first silent one gives way."""
        with self._admitting:  # else another client takes the free place
            free = self.places.acquire(blocking=False)
            for other in () if free else tuple(self.silent):
                if self.silent.pop(other, False) is None:
                    with suppress(OSError):  # it has gone
                        other.shutdown(socket.SHUT_RDWR)
                    free = self.places.acquire(timeout=5.0)  # [s] for it to end
                    break
            if free:
                self.silent[client] = None
            return free

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        with self._answering:
            return self._answer(request)


def serve_socket(
    answer: Answer, address: int | Path, started: Callable[[str], None] = lambda name: None
) -> None:
    """Answer the lines of every client of a local socket, one request at a time, until one stops.

    Parameters
    ----------
    answer
        Answers a request.
    address
        Port of 127.0.0.1, 0 for a free one, or the path of a Unix socket, which only this user can
        open. It is removed at the end.
    started
        Called with the address when clients can connect.

    Raises
    ------
    InvalidOptionError
        If the address cannot be used.
    """
    path = address if isinstance(address, Path) else None
    before = os.umask(0o177)  # the socket is this user's alone
    try:
        if path is not None and path.is_socket() and not _is_answered(path):
            path.unlink()
        server = _Server((LOCALHOST, address) if isinstance(address, int) else str(address), answer)
    except (OSError, OverflowError) as error:
        where = f"port {address}" if path is None else str(path)
        reason = getattr(error, "strerror", None) or error
        raise InvalidOptionError(f"cannot listen at {where}: {reason}", option="port") from None
    finally:
        os.umask(before)
    try:
        with server:
            started(str(path) if path else f"{LOCALHOST}:{server.server_address[1]}")
            server.serve_forever(poll_interval=0.1)
    finally:
        if path is not None:
            path.unlink(missing_ok=True)


def _is_answered(path: Path) -> bool:
    """Return whether a process listens at a Unix socket."""
    with socket.socket(socket.AF_UNIX) as client:
        return client.connect_ex(str(path)) == 0
