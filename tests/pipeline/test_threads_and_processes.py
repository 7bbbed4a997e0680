"""Runs in threads, event loops and other processes: the same numbers as in the main thread."""

from __future__ import annotations

import asyncio
import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from tempfile import TemporaryDirectory

import pytest

import lis_grasp

pytestmark = pytest.mark.slow


def numbers(seed: int = 0) -> tuple[bytes, bytes]:
    """Return contacts and the best grasp of a short run, as bytes."""
    how = {"prober": "kinematic", "touches": 10, "seed": seed, "attempts": 1}
    with TemporaryDirectory() as folder:
        run = lis_grasp.run("box", "wsg50", folder=folder, **how)
    return run.contacts.points.tobytes(), run.grasps[0].X_OH.tobytes()


async def in_a_loop() -> tuple[bytes, bytes]:
    return numbers()


@pytest.fixture(scope="module")
def expected() -> tuple[bytes, bytes]:
    return numbers()


def test_a_worker_thread_and_an_event_loop_give_the_same_numbers(
    expected: tuple[bytes, bytes],
) -> None:
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(numbers).result() == expected
    assert asyncio.run(in_a_loop()) == expected


def test_two_threads_at_once_do_not_disturb_each_other(expected: tuple[bytes, bytes]) -> None:
    with ThreadPoolExecutor(2) as pool:
        first, other = pool.map(numbers, (0, 1))
    assert first == expected
    assert other != expected


@pytest.mark.parametrize("method", ["spawn", "forkserver", "fork"])
def test_a_process_gives_the_same_numbers(method: str, expected: tuple[bytes, bytes]) -> None:
    context = multiprocessing.get_context(method)
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        assert pool.submit(numbers).result(timeout=300) == expected
