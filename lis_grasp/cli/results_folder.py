"""What a folder of results holds, and what of it goes out of date when a stage is run again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lis_grasp.cli.progress import say
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import whole_file

# What the first stage makes, and what is made from that and from each other.
_STAGES = (
    ("contacts.ply",),
    ("surface.ply",),
    ("grasps.json",),
    ("grasps.isaac.yaml", "motion.npz", "lifts.json", "report.json", "scene.html"),
)


@contextmanager
def result_file(path: Path) -> Iterator[Path]:
    """Give a temporary path for a stage's file, as `whole_file` does; then later stages' files go.

    They were made from the file that is replaced, and would be taken for the new one's.
    """
    with whole_file(path) as temporary:
        yield temporary
        remove_made_from(path)


def remove_made_from(path: Path, *, with_itself: bool = False) -> None:
    """Remove the files that later stages made from a stage's file, and say so.

    Where the file is missing, or is not one of this package's, its neighbours are somebody's own
    and stay.

    Parameters
    ----------
    path
        Of ``contacts.ply``, ``surface.ply`` or ``grasps.json``.
    with_itself
        Whether the file goes too.
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
    """Return whether a folder's scene is missing, or older than a file that it shows."""
    scene = directory / "scene.html"
    if not scene.exists():
        return True
    shown = ("contacts.ply", "surface.ply", "grasps.json", "motion.npz")
    times = [p.stat().st_mtime_ns for p in (directory / name for name in shown) if p.exists()]
    return max(times, default=0) > scene.stat().st_mtime_ns
