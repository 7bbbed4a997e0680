"""Paths of worlds: a file, or one scenario in it."""

from __future__ import annotations

import os
from pathlib import Path


def file_of(world: str | Path) -> Path:
    """Return the file of a world.

    Examples
    --------
    >>> file_of("scenarios.yaml#Bins"), scenario_of("scenarios.yaml#Bins")
    (PosixPath('scenarios.yaml'), 'Bins')
    """
    return _split(world)[0]


def scenario_of(world: str | Path) -> str | None:
    """Return the name of the scenario in its file; None if the path names none."""
    return _split(world)[1]


def _split(world: str | Path) -> tuple[Path, str | None]:
    name, mark, scenario = str(world).rpartition("#")
    if not mark or os.path.exists(world):
        return Path(world), None
    return Path(name), scenario
