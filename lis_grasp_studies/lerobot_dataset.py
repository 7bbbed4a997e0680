"""Runs as a LeRobot data set, version 3.0: an episode each, with a frame for each probe."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidFileError, LisGraspError, needed_package
from lis_grasp.io.atomic_writing import whole_file, write_text
from lis_grasp.io.json_lines import Row
from lis_grasp_studies.dataset import read_runs, run_row

VERSION = "v3.0"
"""Version of the format that is written."""

_FRAMES_PER_SECOND = 1  # the format needs a constant rate: frames are probes, not seconds
_EPISODES = 500  # of a file
_FILES = 1000  # of a chunk, which is one folder: all that are written here

_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_FELT = ("touched", "x", "y", "z", "normal_x", "normal_y", "normal_z", "seconds")
_PROBE = ("target_x", "target_y", "target_z", "direction_x", "direction_y", "direction_z")
_CONTACT = _FELT[1:7]

AnyArray = npt.NDArray[Any]

Features = Mapping[str, tuple[str, tuple[int, ...], list[str] | None]]
"""Type, shape and names of each column."""


@dataclass(frozen=True, slots=True)
class Episode:
    """A run as arrays, with a row for each of its T probes."""

    run: str
    task: str
    columns: Mapping[str, AnyArray]
    points: AnyArray
    """Contacts (N, 6) in the order of touches."""
    counts: AnyArray
    """Contacts before each probe, (T,)."""

    @property
    def length(self) -> int:
        """Number of frames T."""
        return len(self.counts)

    def contacts(self, most: int) -> AnyArray:
        """Return the contacts before each probe, (T, most, 6), with zeros after the last."""
        padded = np.zeros((self.length, most, 6), dtype=np.float32)
        for frame, count in enumerate(self.counts):
            padded[frame, :count] = self.points[:count]
        return padded


def write_lerobot(
    folder: Path,
    runs: Sequence[Path],
    *,
    report: Callable[[int], None] = lambda done: None,
    skip: Callable[[Path, LisGraspError], None] | None = None,
) -> int:
    """Write runs as a LeRobot data set in a folder, and return the number of episodes.

    Parameters
    ----------
    folder
        A new or empty one.
    runs
        Folders of runs.
    report
        Called with the number of runs read so far.
    skip
        Called with a run that cannot be read or has no touch or lift, and why; None to raise then.

    Raises
    ------
    InvalidFileError
        If the folder is not empty, or no run can be written.

    Examples
    --------
    >>> _ = run("box", "wsg50", folder="runs/0", known=True, prober="kinematic", touches=12)
    >>> write_lerobot(Path("touches"), run_folders(Path("runs")))
    1
    >>> from pyarrow.parquet import read_table
    >>> frames = read_table("touches/data/chunk-000/file-000.parquet")
    >>> len(frames), frames["observation.count"].to_pylist()[:3]
    (12, [0, 1, 2])
    """
    with needed_package("pyarrow", "study"):
        import pyarrow  # noqa: F401
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidFileError.of(folder, "must be a new or an empty folder for a LeRobot data set")
    episodes = list(read_runs(runs, _episode, report, skip))
    if not episodes:
        raise InvalidFileError.of(folder, "needs a run with touches and a lift; there is none")
    _write(folder, episodes)
    return len(episodes)


def _episode(run: Path) -> Episode:
    row = run_row(run)
    probes, contacts, lift = row["probes"], row["contacts"], row["lift"]
    if not probes or contacts is None or lift is None:
        raise InvalidFileError(f"{run} has no touches, or no lift: run it again", path=run)
    points = np.hstack([np.asarray(contacts["points"]), np.asarray(contacts["normals"])])
    made = np.minimum(np.cumsum([probe["contacts"] for probe in probes]), len(points))
    before = np.concatenate([[0], made[:-1]])
    felt = np.zeros((len(probes), len(_FELT)), dtype=np.float32)
    for frame in range(1, len(probes)):
        felt[frame, -1] = probes[frame - 1]["seconds"]
        if made[frame - 1] > before[frame - 1]:
            felt[frame, :-1] = [1.0, *points[before[frame - 1]]]
    last = np.arange(len(probes)) == len(probes) - 1
    held = last & bool(lift["held"])
    columns = {
        "observation.state": felt,
        "observation.count": before.astype(np.int64),
        "action": np.array([[*p["target"], *p["direction"]] for p in probes], dtype=np.float32),
        "next.reward": held.astype(np.float32),
        "next.done": last,
        "next.success": held,
    }
    task = f"Touch the {row['object']} until the {row['hand']} can grasp it."
    return Episode(row["run"], task, columns, points.astype(np.float32), before)


def _write(folder: Path, episodes: Sequence[Episode]) -> None:
    most = max(len(episode.points) for episode in episodes)
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    features = _features(most)
    listed: list[Row] = []
    frames = 0
    for first in range(0, len(episodes), _EPISODES):
        tables = []
        for number, episode in enumerate(episodes[first : first + _EPISODES], start=first):
            table = _table(episode, number, frames, tasks, most)
            place = {"chunk_index": first // _EPISODES // _FILES}
            place["file_index"] = first // _EPISODES % _FILES
            listed.append(
                {
                    "episode_index": number,
                    "tasks": [episode.task],
                    "length": episode.length,
                    "run": episode.run,
                    "dataset_from_index": frames,
                    "dataset_to_index": frames + episode.length,
                    **{f"data/{name}": value for name, value in place.items()},
                    **dict.fromkeys(("meta/episodes/chunk_index", "meta/episodes/file_index"), 0),
                    **_flat_statistics(table),
                }
            )
            frames += episode.length
            tables.append(table)
        joined = {name: np.concatenate([table[name] for table in tables]) for name in features}
        _write_frames(folder / _DATA.format(**place), joined, features)
    _write_meta(folder, listed, tasks, features, frames)


def _table(
    episode: Episode, number: int, first: int, tasks: Sequence[str], most: int
) -> dict[str, AnyArray]:
    """Return the columns of an episode, whose first frame has an index in the data set."""
    frame = np.arange(episode.length)
    return {
        **episode.columns,
        "observation.contacts": episode.contacts(most),
        "timestamp": (frame / _FRAMES_PER_SECOND).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(episode.length, number),
        "index": first + frame,
        "task_index": np.full(episode.length, tasks.index(episode.task)),
    }


def _features(most: int) -> Features:
    numbers = ("frame_index", "episode_index", "index", "task_index")
    return {
        "observation.state": ("float32", (len(_FELT),), list(_FELT)),
        "observation.contacts": ("float32", (most, 6), list(_CONTACT)),
        "observation.count": ("int64", (1,), None),
        "action": ("float32", (len(_PROBE),), list(_PROBE)),
        "next.reward": ("float32", (1,), None),
        "next.done": ("bool", (1,), None),
        "next.success": ("bool", (1,), None),
        "timestamp": ("float32", (1,), None),
        **dict.fromkeys(numbers, ("int64", (1,), None)),
    }


def _write_frames(path: Path, columns: Mapping[str, AnyArray], features: Features) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}
    arrays, fields = [], []
    for name, (kind, shape, _) in features.items():
        of_type = kinds[kind]
        for length in () if shape == (1,) else reversed(shape):
            # A matrix is a list of lists; a vector has its length in its type.
            of_type = pa.list_(of_type) if len(shape) > 1 else pa.list_(of_type, length)
        arrays.append(pa.array(columns[name].tolist(), of_type))
        fields.append(pa.field(name, of_type))
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        parquet.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), temporary)


def _write_meta(
    folder: Path, listed: Sequence[Row], tasks: Sequence[str], features: Features, frames: int
) -> None:
    import pandas
    import pyarrow as pa
    from pyarrow import parquet

    path = folder / "meta/episodes/chunk-000/file-000.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        parquet.write_table(pa.Table.from_pylist(list(listed)), temporary)
    with whole_file(folder / "meta/tasks.parquet") as temporary:
        named = pandas.DataFrame({"task_index": range(len(tasks))}, index=list(tasks))
        named.to_parquet(temporary)
    info = {
        "codebase_version": VERSION,
        "robot_type": None,
        "total_episodes": len(listed),
        "total_frames": frames,
        "total_tasks": len(tasks),
        "chunks_size": _FILES,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": _FRAMES_PER_SECOND,
        "splits": {"train": f"0:{len(listed)}"},
        "data_path": _DATA,
        "video_path": None,
        "features": {
            name: {"dtype": kind, "shape": shape, "names": names}
            for name, (kind, shape, names) in features.items()
        },
    }
    write_text(folder / "meta/stats.json", json.dumps(_joined_statistics(listed), indent=4) + "\n")
    write_text(folder / "meta/info.json", json.dumps(info, indent=4) + "\n")


def _flat_statistics(table: Mapping[str, AnyArray]) -> Row:
    """Return the statistics of an episode, one column of the list of episodes for each.

    Of a matrix they are over its rows, too, as LeRobot has them.
    """
    found: Row = {}
    for name, values in table.items():
        width = 1 if np.ndim(values) == 1 else np.shape(values)[-1]
        numbers = np.asarray(values, dtype=np.float64).reshape(-1, width)
        each = {"min": numbers.min(axis=0), "max": numbers.max(axis=0)}
        each |= {"mean": numbers.mean(axis=0), "std": numbers.std(axis=0)}
        found |= {f"stats/{name}/{key}": value.tolist() for key, value in each.items()}
        found[f"stats/{name}/count"] = [len(values)]
    return found


def _joined_statistics(listed: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """Return the statistics of all frames from those of episodes."""
    weights = np.array([row["length"] for row in listed], dtype=np.float64)
    weights /= weights.sum()
    joined: dict[str, dict[str, Any]] = {}
    for name in [key.split("/")[1] for key in listed[0] if key.endswith("/mean")]:
        low, high, means, deviations, counts = (
            np.array([row[f"stats/{name}/{key}"] for row in listed], dtype=np.float64)
            for key in ("min", "max", "mean", "std", "count")
        )
        mean = weights @ means
        found = {"min": low.min(axis=0), "max": high.max(axis=0), "mean": mean}
        found["std"] = np.sqrt(weights @ (deviations**2 + (means - mean) ** 2))
        joined[name] = {key: value.tolist() for key, value in found.items()}
        joined[name]["count"] = [int(counts.sum())]
    return joined
