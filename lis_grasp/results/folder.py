"""Folders of results: default names, facts in files' headers, and earlier results set aside."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from filecmp import cmp
from pathlib import Path
from typing import Any, Literal

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.exploration import LoggedProbe
from lis_grasp.exploration.touch_log import read_log
from lis_grasp.io.atomic_writing import cannot_write, whole_file
from lis_grasp.io.json_lines import read_lines
from lis_grasp.results.progress import SILENT, Progress
from lis_grasp.task.recorded_facts import checked_facts, read_facts
from lis_grasp.task.task import KNOWN, Task, plain_value

LOG = "touches.jsonl"
"""The touch log of an exploration."""

VIEW = "view.npz"
"""The first view of an exploration; others are view_2.npz, and so on."""

SCENE = "scene.yaml"
"""The task of a run."""

EARLIER = "earlier"
"""The folder of results that other ones replaced, in folders 1, 2 and so on."""

Earlier = Literal["resume", "fresh", "remake"]
"""What an exploration does with results of its folder."""

PAGE, PICTURE = "scene.html", "scene.png"
"""The page of a run, and a small picture of it."""

RUN_FILES = ("contacts.ply", "surface.ply", "grasps.json", "report.json", PAGE, PICTURE)
"""What a run writes for its reader, in order."""

# Files of each stage, in order; each stage reads the files of the earlier ones.
_STAGES = (
    ("contacts.ply",),
    ("surface.ply",),
    ("grasps.json",),
    (
        "grasps.isaac.yaml",
        "grasps.moveit.yaml",
        "motion.npz",
        "lifts.json",
        "labels.jsonl",
        "grasps.parquet",
        "report.json",
        SCENE,
        PAGE,
        PICTURE,
    ),
)

# Files whose content must show that this package wrote them.
_RECOGNISED = ("contacts.ply", "surface.ply", "grasps.json", "report.json")

# Options in every folder's name; others are added where they differ from their defaults.
_NAMED = ("object", "hand", "estimator", "seed")
# Longest part of a folder's name; a file's name is limited to 255 bytes.
_LONGEST_PART = 40


def read_touches(path: Path) -> tuple[dict[str, Any], tuple[LoggedProbe, ...]]:
    """Return the facts of a touch log (see `read_facts`) and its probes (see `read_log`)."""
    facts, probes = read_log(path)
    return checked_facts(facts, path), probes


def results_folder(task: Task, named: Path | str | None) -> Path:
    """Return the folder of a run: the one that is named, or `default_output`.

    Raises `InvalidOptionError` if the folder has results of another object or, as a default
    folder, of another task, such as one with a file of the same name elsewhere. Raises
    `InvalidFileError` if it has files of other programs that the run would replace.
    """
    folder = default_output(task) if named is None else Path(named)
    facts = task.facts()
    recorded: dict[str, Any] = read_lines(folder / LOG, advice="name another `folder`")[0]
    distinguished = facts if named is None else ("object",)
    differing = [n for n in distinguished if n in recorded and recorded[n] != facts[n]]
    if differing:
        raise InvalidOptionError(
            f"{folder} has results of another {' and '.join(differing)}"
            f" ({recorded[differing[0]]}): name another folder by `folder`",
            option="folder",
            value=str(folder),
        )
    for name in _RECOGNISED:
        require_own(folder / name)
    return folder


def view_paths(folder: Path, count: int) -> list[Path]:
    """Return the paths of a number of views in a folder."""
    return [folder / (VIEW if k == 1 else f"view_{k}.npz") for k in range(1, count + 1)]


def default_output(task: Task) -> Path:
    """Return the default folder of a run; other options give another one."""
    facts, usual = task.facts(), Task().facts()
    parts = [Path(task.world.object).stem, Path(task.robot.hand).stem, facts["estimator"]]
    parts.append(f"seed{task.seed}")
    usual["free"] = task.world.prober == "dynamic"
    known = {name: plain_value(value) for name, value in KNOWN.items()}
    if all(facts[option] == value for option, value in known.items()):
        parts.append("known")
        usual |= known
    for name, value in facts.items():
        if name not in _NAMED and value != usual[name]:
            shown = Path(value).stem if name in ("cloud", "pose") and value else f"{value}"
            shown = Path(value).name if name == "world" else shown
            shown = Path(value[0]).stem if name == "views" and value else shown
            parts.append({"True": name, "False": f"no_{name}"}.get(shown, f"{name}_{shown}"))
    name = "-".join(re.sub(r"[^\w.+-]", "_", part)[:_LONGEST_PART] for part in parts)
    return Path("results") / name


def require_own(path: Path) -> None:
    """Raise `InvalidFileError` if a file exists that this package did not write."""
    if not path.exists() or read_facts(path):
        return
    if path.name != "report.json" or b'"version"' not in path.read_bytes():
        raise InvalidFileError(
            f"{path} would be replaced, and is not a file of lis_grasp: name another by `folder`",
            path=path,
        )


@contextmanager
def result_file(path: Path, progress: Progress = SILENT, *, again: bool = False) -> Iterator[Path]:
    """Yield a temporary path for a stage's file, as `whole_file` does; later files then go.

    Files of later stages were made from the replaced file, and would seem to belong to the new one:
    with it they are moved (see `set_aside`), or removed if the same run makes them `again`. They
    are kept if the new file is equal to it. A file of another program is not replaced: see
    `require_own`.
    """
    require_own(path)
    with whole_file(path) as temporary:
        yield temporary
        if path.exists() and not cmp(path, temporary, shallow=False):
            later, why = made_from(path), f"made from an earlier {path.name}"
            if again:
                remove(later)
            elif later:
                set_aside([path, *later], progress, why)


def made_from(path: Path) -> list[Path]:
    """Return the files that later stages made from a stage's file, the last stage's first.

    There are none if the file is missing or was not written by this package.
    """
    if not path.exists() or not read_facts(path):
        return []
    stages = (number for number, names in enumerate(_STAGES) if path.name in names)
    stage = next(stages, len(_STAGES))  # files of other names have no later files
    later = [path.with_name(name) for names in _STAGES[stage + 1 :] for name in names]
    return [file for file in reversed(later) if file.exists()]


def remove(files: Sequence[Path]) -> None:
    """Remove results that the same task makes again."""
    for file in files:
        file.unlink()


def set_aside(files: Sequence[Path], progress: Progress, why: str) -> None:
    """Move results of one folder that other ones replace into a new folder in `EARLIER`.

    Reports their names and why. Missing files are left out.
    """
    present = [file for file in files if file.exists()]
    if not present:
        return
    places = present[0].parent / EARLIER
    number = 1 + max((int(p.name) for p in places.glob("*") if p.name.isdecimal()), default=0)
    place = places / str(number)
    try:
        place.mkdir(parents=True)
        for file in present:
            file.rename(place / file.name)
    except OSError as error:
        raise cannot_write(place, error) from None
    names = ", ".join(sorted(file.name for file in present))
    progress.say(f"moved {names} to {place}: {why}")


def scene_is_outdated(directory: Path, scene: Path | None = None) -> bool:
    """Return whether the scene of a folder, or one elsewhere, is missing or older than its files.

    The report is newer than the folder's own scene, which already contains it.
    """
    scene = scene or directory / PAGE
    if not scene.exists():
        return True
    shown = [LOG, "contacts.ply", "surface.ply", "grasps.json", "motion.npz"]
    shown += [] if scene.parent == directory else ["report.json"]
    times = [p.stat().st_mtime_ns for p in (directory / name for name in shown) if p.exists()]
    return max(times, default=0) > scene.stat().st_mtime_ns
