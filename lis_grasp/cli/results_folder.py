"""Outdated files in a folder of results: removal after a stage is run again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lis_grasp.cli.progress import say
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import whole_file

# Files of each stage, in order; each stage reads the files of the earlier ones.
_STAGES = (
    ("contacts.ply",),
    ("surface.ply",),
    ("grasps.json",),
    ("grasps.isaac.yaml", "motion.npz", "lifts.json", "report.json", "scene.html"),
)


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


def scene_is_outdated(directory: Path) -> bool:
    """Return whether a folder's scene is missing or older than a file that it shows."""
    scene = directory / "scene.html"
    if not scene.exists():
        return True
    shown = ("contacts.ply", "surface.ply", "grasps.json", "motion.npz")
    times = [p.stat().st_mtime_ns for p in (directory / name for name in shown) if p.exists()]
    return max(times, default=0) > scene.stat().st_mtime_ns
