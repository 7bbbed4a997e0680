"""Hostile clients of `next --serve` and of a page: each ends, and the server goes on answering."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from cases import TIMES

from lis_grasp.exploration import load_outcomes
from lis_grasp.io.request_lines import LOCALHOST

_LONGEST = 20.0  # [s] an answer may take while the machine is busy
_VERB = [sys.executable, "-m", "lis_grasp.cli.main"]
_OPTIONS = ["--hand", "wsg50", "--size", "0.12", "--support", "-0.06"]
Connect = Callable[[], socket.socket]


@contextmanager
def _started(command: list[str], stream: str) -> Iterator[str]:
    """Start a server; yield its address, and require that it ends by SIGINT without a traceback."""
    pipe = subprocess.PIPE
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    server = subprocess.Popen([*_VERB, *command], stdout=pipe, stderr=pipe, text=True)
    signal.signal(signal.SIGINT, before)
    try:
        yield getattr(server, stream).readline().split()[1]
    finally:
        server.send_signal(2)
        _, errors = server.communicate(timeout=_LONGEST)
        assert "Traceback" not in errors
        assert "Exception" not in errors


@pytest.fixture(scope="module")
def short_folder() -> Iterator[Path]:
    """Yield a folder for a socket, whose path has at most 107 bytes: pytest's may have more."""
    with TemporaryDirectory(dir="/tmp") as name:
        yield Path(name)


@pytest.fixture(scope="module", params=["port", "socket"])
def touches(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, short_folder: Path
) -> Connect:
    folder, place = tmp_path_factory.mktemp("touches"), short_folder / "touch.sock"
    where = ["--port", "0"] if request.param == "port" else ["--socket", str(place)]
    command = ["next", "--serve", *where, *_OPTIONS, "--output", str(folder)]
    with _started(command, "stdout") as address:

        def connect() -> socket.socket:
            if request.param == "port":
                return socket.create_connection((LOCALHOST, int(address.split(":")[1])), _LONGEST)
            client = socket.socket(socket.AF_UNIX)
            client.settimeout(_LONGEST)
            client.connect(address)
            return client

        yield connect
    assert {path.name for path in folder.iterdir()} <= {".lock", "touches.jsonl"}
    if (folder / "touches.jsonl").exists():
        assert not load_outcomes(folder / "touches.jsonl")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Connect:
    folder = tmp_path_factory.mktemp("page")
    (folder / "secret.txt").write_text("SECRET")
    (folder / "scene.html").write_text("<p>scene")
    (folder / "contacts.ply").write_bytes(b"ply\n\xff")  # newer than the scene, and damaged
    with _started(["view", str(folder), "--follow", "--port", "0"], "stderr") as address:
        port = int(address.rstrip("/").rpartition(":")[2])
        yield lambda: socket.create_connection((LOCALHOST, port), _LONGEST)


def _ask(connect: Connect, text: bytes = b'{"id": 1}\n') -> dict:
    with connect() as client:
        client.sendall(text)
        return dict(json.loads(client.makefile("rb").readline()))


def _got(connect: Connect, request: bytes) -> bytes:
    """Return what a server sends until it closes the connection."""
    with connect() as client, suppress(OSError):
        client.sendall(request)
        client.shutdown(socket.SHUT_WR)
        return client.makefile("rb").read()
    return b""


def _abort(client: socket.socket) -> None:
    """Close a connection by a reset, as of a program that was killed."""
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    client.close()


_LINES = {
    "garbage": np.random.default_rng(5).bytes(100_000),
    "garbage in lines": np.random.default_rng(6).bytes(3000).replace(b"\1", b"\n") + b"\n",
    "endless line": b"x" * 5_000_000,
    "deep list": b"[" * 900_000 + b"\n",
    "deep object": b'{"a":' * 100_000 + b"\n",
    "deep id": b'{"id": ' + b"[" * 900 + b"]" * 900 + b"}\n",
    "infinite id": b'{"id": 1e999}\n',
    "NaN": b'{"points": [[NaN, 0, 0]]}\n',
    "infinity": b'{"points": [[1e999, 0, 0]], "normals": [[0, 0, 1]]}\n',
    "huge number": b'{"points": [[1e300, 0, 0]], "normals": [[0, 0, 1]]}\n',
    "many digits": b'{"points": [[' + b"9" * 4000 + b", 0, 0]]}\n",
    "surrogate": b'{"request": "\\ud800"}\n',
    "other folder": b'{"request": "grasp", "file": "../../etc/passwd"}\n',
    "a web page": b"POST / HTTP/1.1\r\nHost: localhost\r\n\r\n{}\n",
}


@pytest.mark.parametrize("name", _LINES)
def test_a_hostile_line_is_refused_and_the_service_goes_on(touches: Connect, name: str) -> None:
    answers = _got(touches, _LINES[name]).splitlines()
    assert all(json.loads(line)["ok"] is False for line in answers)
    assert answers or len(_LINES[name]) > 50_000  # unread bytes reset the connection
    assert _ask(touches)["ok"]


def test_silent_clients_give_way_to_the_next_ones(touches: Connect) -> None:
    with ExitStack() as clients:
        for part in (b"", b'{"id"', b"{" * 1000):
            for _ in range(10):
                clients.enter_context(touches()).sendall(part)
        assert _ask(touches)["ok"]


def test_a_hundred_clients_at_once_are_answered(touches: Connect) -> None:
    with ExitStack() as open_clients:
        clients = [open_clients.enter_context(touches()) for _ in range(100)]
        for client in clients:
            with suppress(OSError):
                client.sendall(b'{"id": "a"}\n')
        answers = []
        for client in clients:
            with suppress(OSError):
                answers.append(client.makefile("rb").readline())
    assert sum(b'"ok": true' in answer for answer in answers) >= 8
    assert _until_answered(touches)


def test_clients_that_vanish_leave_their_places(touches: Connect) -> None:
    for part in (b"", b'{"id": 1}\n', b'{"id": 1}\n{"id"'):
        for _ in range(12):
            client = touches()
            client.sendall(part)
            _abort(client)
    assert _until_answered(touches)


def _until_answered(connect: Connect) -> bool:
    """Ask until there is a place: those of clients that have gone are free a little later."""
    end = time.monotonic() + _LONGEST
    while time.monotonic() < end:
        with suppress(OSError, ValueError):
            if _ask(connect)["ok"]:
                return True
        time.sleep(0.05)
    return False


_HEAD = b"\r\nHost: localhost\r\n\r\n"
_PATHS = (
    *(b"/secret.txt", b"/../secret.txt", b"/%2e%2e/secret.txt", b"//secret.txt", b"/./secret.txt"),
    *(b"/scene.html/../secret.txt", b"/..%2fsecret.txt", b"/%00", b"/etc/passwd", b"secret.txt"),
    *(b"http://evil/secret.txt", b"file:///etc/passwd", b"/" + b"a" * 70_000, b"/\xff\xfe", b"*"),
)
_REQUESTS = (
    *(b"GET " + path + b" HTTP/1.1" + _HEAD for path in _PATHS),
    *(b"POST /", b"PUT /scene.html", b"DELETE /scene.html", b"TRACE /", b"CONNECT a:1"),
    *(b"GET / HTTP/9.9" + _HEAD, b"GET /", b"\0" * 1000, b"\x16\x03\x01\x02\0\1", b"{}\n" * 9),
    b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 1000 + b"\r\n",
    b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: " + b"h" * 100_000,
)


def _is_shown(page: Connect) -> bool:
    return b"200 OK" in _got(page, b"GET / HTTP/1.1" + _HEAD)


@pytest.mark.parametrize("number", range(len(_REQUESTS)))
def test_a_page_has_no_other_file_and_no_other_host(page: Connect, number: int) -> None:
    answer = _got(page, _REQUESTS[number])
    assert b"SECRET" not in answer
    assert b"root:" not in answer
    assert b"200 OK" not in answer or _REQUESTS[number].startswith((b"GET / HTTP/9", b"GET /"))
    assert _is_shown(page)


@pytest.mark.slow
def test_a_page_outlasts_clients_that_vanish_or_wait(page: Connect) -> None:
    with ExitStack() as waiting:
        for _ in range(100):
            waiting.enter_context(page()).sendall(b"GET / HTTP/1.1\r\nHost")
        for _ in range(100):
            client = page()
            client.sendall(b"GET / HTTP/1.1" + _HEAD)
            _abort(client)
        assert _is_shown(page)
    rng = np.random.default_rng() if TIMES > 1 else np.random.default_rng(7)
    for _ in range(30 * TIMES):
        _got(page, rng.bytes(rng.integers(1, 3000)))
    assert _is_shown(page)
