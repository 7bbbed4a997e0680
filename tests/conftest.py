"""Settings of every test run: threads of linear algebra, and the marker of a folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Workers share the processors already: a second thread in each made them wait for each other.
# The libraries read this when they are imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

_STUDIES = Path(__file__).parent / "studies"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if _STUDIES in item.path.parents:
            item.add_marker(pytest.mark.experiments)
