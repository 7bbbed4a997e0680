"""Settings of every test run: threads of linear algebra, the marker of a folder, the smoke run."""

from __future__ import annotations

import gc
import os
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

# Workers share the processors already: a second thread in each made them wait for each other.
# The libraries read this when they are imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from lis_grasp.robots.hand import Hand  # noqa: E402
from lis_grasp.robots.shipped_models import HAND_NAMES  # noqa: E402

# Modules and cases stay alive: to search them for garbage took a third of the collection of cases.
gc.disable()

# Hands are not changed, and reading one takes a tenth of a second: tests share the package's.
_read_hand = Hand.load.__func__  # type: ignore[attr-defined]
_shared_hand = cache(lambda name: _read_hand(Hand, name))
Hand.load = classmethod(  # type: ignore[method-assign, assignment]
    lambda cls, name: _shared_hand(name) if name in HAND_NAMES else _read_hand(cls, name)
)

_STUDIES = Path(__file__).parent / "studies"
_SMOKE_STEP = 20  # About 300 cases; the first of each file enters every folder.


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--smoke",
        action="store_true",
        help=f"run the first selected case of each file, and every {_SMOKE_STEP}th after it",
    )


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> Iterator[None]:
    for item in items:
        if _STUDIES in item.path.parents:
            item.add_marker(pytest.mark.experiments)
        usual = item.get_closest_marker("by_default")
        if usual is not None and item.callspec.id not in usual.args:  # type: ignore[attr-defined]
            item.add_marker(pytest.mark.slow)
    yield  # `-m` and `-k` select
    if config.getoption("smoke"):
        cases: dict[Path, list[pytest.Item]] = defaultdict(list)
        for item in items:
            cases[item.path].append(item)
        kept = {item for of_file in cases.values() for item in of_file[::_SMOKE_STEP]}
        config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = [item for item in items if item in kept]


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no study where all of them are left out."""
    left_out = "not experiments" in config.option.markexpr
    return True if collection_path == _STUDIES and left_out else None
