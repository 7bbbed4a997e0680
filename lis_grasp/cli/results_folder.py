"""Folders of results: default names, and removal of outdated files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lis_grasp.cli.progress import say
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.io.json_lines import read_lines
from lis_grasp.pipeline.conditions import KNOWN, UNKNOWN
from lis_grasp.pipeline.run_config import RunConfig

LOG = "touches.jsonl"
"""The touch log of an exploration."""

# Files of each stage, in order; each stage reads the files of the earlier ones.
_STAGES = (
    ("contacts.ply",),
    ("surface.ply",),
    ("grasps.json",),
    ("grasps.isaac.yaml", "motion.npz", "lifts.json", "report.json", "scene.html"),
)

# Every folder's name has these; other options only where they differ from their defaults.
_NAMED = ("object", "hand", "estimator", "seed")
# Longest part of a folder's name; a file's name is limited to 255 bytes.
_LONGEST_PART = 40


def default_output(config: RunConfig) -> Path:
    """Return the folder that a run writes to when none is named.

    Other options give another folder. Files of the same name in different folders, which the name
    does not distinguish, are refused.

    Raises
    ------
    InvalidOptionError
        If the folder has an exploration of another configuration.
    """
    facts, usual = config.facts(), RunConfig().facts()
    parts = [Path(config.object).stem, Path(config.hand).stem, config.estimator]
    parts.append(f"seed{config.seed}")
    usual |= {**UNKNOWN, "free": config.prober == "dynamic"}
    if all(facts[option] == value for option, value in KNOWN.items()):
        parts.append("known")
        usual |= KNOWN
    for name, value in facts.items():
        if name not in _NAMED and value != usual[name]:
            shown = Path(value).stem if name in ("cloud", "pose") and value else f"{value}"
            parts.append({"True": name, "False": f"no_{name}"}.get(shown, f"{name}_{shown}"))
    name = "-".join(re.sub(r"[^\w.+-]", "_", part)[:_LONGEST_PART] for part in parts)
    folder = Path("results") / name
    recorded: dict[str, Any] = read_lines(folder / LOG)[0]
    differing = [n for n in facts if n in recorded and recorded[n] != facts[n]]
    if differing:
        raise InvalidOptionError(
            f"{folder} has results of another {' and '.join(differing)}"
            f" ({recorded[differing[0]]}): name a folder with --output",
            option="--output",
            value=str(folder),
        )
    return folder


@contextmanager
def result_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path for a stage's file, as `whole_file` does; then remove later files.

    Files of later stages were made from the replaced file, and would seem to be of the new one.
    """
    with whole_file(path) as temporary:
        yield temporary
        remove_made_from(path)


def remove_made_from(path: Path, *, with_itself: bool = False) -> None:
    """Remove the files that later stages made from a stage's file, and print their names.

    `with_itself` removes the file itself too. Nothing is removed if the file is missing or was not
    written by this package.
    """
    if not path.exists() or not provenance.read(path):
        return
    stage = next(number for number, names in enumerate(_STAGES) if path.name in names)
    later = [path.with_name(name) for names in _STAGES[stage + 1 :] for name in names]
    made = [file for file in later if file.exists()]
    for file in reversed([path, *made] if with_itself else made):
        file.unlink()
    if made:
        names = ", ".join(file.name for file in made)
        say(f"removed {names}: made from an earlier {path.name}")


def scene_is_outdated(directory: Path, scene: Path | None = None) -> bool:
    """Return whether a folder's scene is missing or older than a file that it shows."""
    scene = scene or directory / "scene.html"
    if not scene.exists():
        return True
    shown = ("contacts.ply", "surface.ply", "grasps.json", "motion.npz")
    times = [p.stat().st_mtime_ns for p in (directory / name for name in shown) if p.exists()]
    return max(times, default=0) > scene.stat().st_mtime_ns
