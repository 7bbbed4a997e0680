"""Requests as JSON lines: whatever a client sends ends in an answer, and the next one is read."""

from __future__ import annotations

import io
import json
import socket
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from lis_grasp.exceptions import InvalidInputError, InvalidOptionError
from lis_grasp.io.request_lines import LOCALHOST, answer_lines, serve_socket

LIMIT = 2**20


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    match request.get("request"):
        case "double":
            return {"value": 2 * request["value"]}
        case "refuse":
            raise InvalidInputError("a plain sentence")
    raise RuntimeError("a defect")


BAD = {
    "no JSON": b"GET / HTTP/1.1",
    "empty": b"",
    "no object": b"[1, 2]",
    "no text": b"\xff\xfe\x00",
    "not finite": b'{"request": "double", "value": NaN}',
    "deep": b"[" * 500_000,
    "digits": b'{"value": ' + b"9" * 10_000 + b"}",
    "too long": b'{"x": "' + b"x" * LIMIT + b'"}',
    "refused": b'{"request": "refuse"}',
    "defect": b'{"request": 7}',
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_line_has_an_answer_and_the_next_one_too(name: str) -> None:
    good = b'{"request": "double", "value": 4, "id": "a"}'
    answers = io.BytesIO()
    stopped = answer_lines(_answer, io.BytesIO(BAD[name] + b"\n" + good + b"\n"), answers)
    first, second = map(json.loads, answers.getvalue().splitlines())
    assert not stopped
    assert first["ok"] is False
    assert 0 < len(first["error"]) < 300
    assert second == {"id": "a", "ok": True, "value": 8}


class _Endless(io.BytesIO):
    """A stream without line ends, which counts what was read of it."""

    size = 0

    def readline(self, size: int | None = -1, /) -> bytes:
        assert size is not None
        assert 0 < size <= LIMIT + 1
        self.size += size
        return b"x" * size


def test_an_endless_line_is_answered_after_the_limit() -> None:
    endless, answers = _Endless(), io.BytesIO()
    answer_lines(_answer, endless, answers, trusted=False)
    assert json.loads(answers.getvalue())["ok"] is False
    assert endless.size == LIMIT + 1


@contextmanager
def _serving(address: int | Path) -> Iterator[Callable[[], socket.socket]]:
    places: list[str] = []
    ready = threading.Event()

    def started(place: str) -> None:
        places.append(place)
        ready.set()

    thread = threading.Thread(target=serve_socket, args=(_answer, address, started))
    thread.start()
    assert ready.wait(60.0)

    def connect() -> socket.socket:
        if isinstance(address, Path):
            client = socket.socket(socket.AF_UNIX)
            client.connect(str(address))
            return client
        host, port = places[0].split(":")
        assert host == LOCALHOST
        return socket.create_connection((host, int(port)), timeout=60.0)

    try:
        yield connect
    finally:
        stopped = False
        while not stopped:  # places of clients that have gone are free a little later
            with connect() as client:
                client.sendall(b'{"request": "stop"}\n')
                stopped = json.loads(client.makefile().readline())["ok"]
        thread.join(60.0)
        assert not thread.is_alive()


@pytest.mark.parametrize("kind", ["port", "socket"])
def test_clients_of_a_socket_are_answered_until_one_stops(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # the path of a socket has at most 107 bytes
    address = 0 if kind == "port" else Path("touch.sock")
    with _serving(address) as connect, connect() as silent, connect() as client:
        silent.sendall(b'{"request": ')  # and never the rest
        with client.makefile() as lines:
            for value in (1, 2):
                client.sendall(json.dumps({"request": "double", "value": value}).encode() + b"\n")
                assert json.loads(lines.readline())["value"] == 2 * value
        if isinstance(address, Path):
            assert stat.S_IMODE(address.stat().st_mode) == 0o600
            with pytest.raises(InvalidOptionError) as error:
                serve_socket(_answer, address)
            assert error.value.option == "port"
    if isinstance(address, Path):
        assert not address.exists()
        stale = socket.socket(socket.AF_UNIX)  # of a process that was killed
        stale.bind(str(address))
        stale.close()
        with _serving(address):
            pass


def test_a_web_page_that_posts_to_the_port_asks_nothing() -> None:
    post = b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    with _serving(0) as connect, connect() as client:
        client.sendall(post + b'{"request": "double", "value": 1}\n')
        lines = client.makefile().read().splitlines()  # to the end: the connection is closed
    assert [json.loads(line)["ok"] for line in lines] == [False]


def test_many_clients_are_answered_that_there_are_many() -> None:
    with _serving(0) as connect:
        clients = [connect() for _ in range(8)]
        for client in clients:
            client.sendall(b'{"request": "double", "value": 1}\n')
            assert json.loads(client.makefile().readline())["ok"]
        with connect() as another:
            assert "8 connections" in json.loads(another.makefile().readline())["error"]
        for client in clients:
            client.shutdown(socket.SHUT_RDWR)
            client.close()


@pytest.mark.parametrize("address", [70_000, -1, Path("/nowhere/touch.sock"), Path("x" * 200)])
def test_an_address_that_cannot_be_used_is_one_sentence(address: int | Path) -> None:
    with pytest.raises(InvalidOptionError) as error:
        serve_socket(_answer, address)
    assert error.value.option == "port"
