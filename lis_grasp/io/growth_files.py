"""Intermediate surface estimates of an exploration: the folder growth/ of a folder of results.

Each estimate is a surface file named after its number of contacts, for example ``growth/13.ply``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import trimesh

from lis_grasp.io import provenance
from lis_grasp.io.surface_files import load_surface, save_surface


def save_growth(results: Path, contacts: int, mesh: trimesh.Trimesh, header: str) -> None:
    """Write the estimate from the first `contacts` contacts, in O [m]."""
    save_surface(mesh, results / "growth" / f"{contacts}.ply", header=header)


def load_growth(results: Path, facts: Mapping[str, Any]) -> list[tuple[int, trimesh.Trimesh]]:
    """Return the intermediate estimates of a surface, each with its number of contacts, in order.

    `facts` are the provenance of the surface: estimates of another exploration or estimator are
    left out. Raises `InvalidFileError` if a file is damaged.
    """
    growth = []
    for contacts, path in sorted(_files(results).items()):
        made = provenance.read(path)
        # Explorations always carve free space; the version may change between two stages.
        kept = made.keys() - {"version", "free_space"}
        if kept and all(facts.get(name) == made[name] for name in kept):
            growth.append((contacts, load_surface(path)))
    return growth


def remove_growth(results: Path) -> None:
    """Remove the intermediate estimates; files of other programs stay."""
    files = _files(results).values()
    for path in files:
        if provenance.read(path):
            path.unlink()
    if files and not any((results / "growth").iterdir()):
        (results / "growth").rmdir()


def _files(results: Path) -> dict[int, Path]:
    found = (results / "growth").glob("*.ply")
    return {int(path.stem): path for path in found if path.stem.isdecimal()}
