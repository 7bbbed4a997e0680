"""Kill explorations, runs and studies at random moments, run them again, and compare the files.

Each command is killed one to three times, by SIGKILL, SIGTERM or SIGINT, at a random moment or just
after a file in its folder has changed; then it runs to its end. After every kill, files under their
final names must be complete; the files of touches and rows, which grow, must be beginnings of the
uninterrupted ones. At the end all files must equal those of an uninterrupted run, byte for byte
except for times.
"""

from __future__ import annotations

import atexit
import json
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp

import numpy as np
import yaml

from lis_grasp import shapes
from lis_grasp_studies.study.results import without_times

COMMANDS = {
    "explore": "explore box --known --prober kinematic --touches 8 --position-noise 0.001",
    "run": "run box --known --prober kinematic --touches 8 --grasps 1 --estimator patch",
    "compare": "compare --objects box --estimators patch gpis --reference gpis --touches 4"
    " --noise none --seeds 2 --jobs 1",
    "evaluate": "evaluate {files}/small.yaml --jobs 1",
    "label": "grasp {files}/box.stl --hand wsg50 --grasps 3 --label --jobs 1",
}
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
LOGS = ("touches.jsonl", "rows.jsonl", "labels.jsonl")  # the files that grow
# An uninterrupted command takes seconds; after this time it hangs [s].
_LONGEST = 600.0
_POLL = 0.002


@dataclass(frozen=True)
class Uninterrupted:
    """The files of an uninterrupted command, without times, and its duration."""

    files: dict[str, bytes]
    seconds: float


@cache
def _files() -> Path:
    """Return a folder with the files that commands read."""
    folder = Path(mkdtemp(prefix="kills-"))
    atexit.register(rmtree, folder)
    shapes.find("box").mesh.export(folder / "box.stl")
    part = {"measure": "paper", "title": "One experiment", "experiments": ["noisy"]}
    part |= {"variants": ["lis"], "seeds": [0], "seconds": 1}
    (folder / "small.yaml").write_text(yaml.safe_dump({"parts": {"paper": part}}))
    return folder


def _start(verb: str, folder: Path) -> subprocess.Popen[bytes]:
    words = COMMANDS[verb].format(files=_files()).split()
    command = [sys.executable, "-m", "lis_grasp.cli.main", *words]
    quiet = subprocess.DEVNULL
    return subprocess.Popen([*command, "--output", str(folder)], stdout=quiet, stderr=quiet)


def uninterrupted(verb: str, folder: Path) -> Uninterrupted:
    began = time.monotonic()
    if _start(verb, folder).wait(_LONGEST):
        raise RuntimeError(f"the uninterrupted {verb} failed")
    return Uninterrupted(files_in(folder), time.monotonic() - began)


def files_in(folder: Path) -> dict[str, bytes]:
    """Return the contents of the finished files of a folder, without times."""
    paths = [p for p in sorted(folder.rglob("*")) if p.is_file() and not p.name.startswith(".")]
    return {str(path.relative_to(folder)): _content(path, folder) for path in paths}


def _content(path: Path, folder: Path) -> bytes:
    if path.name == "report.json":
        report = json.loads(path.read_bytes())
        report.pop("timings")
        return json.dumps(report).encode()
    if path.name == "rows.jsonl":
        header, *rows = path.read_bytes().splitlines(keepends=True) or [b""]
        whole = [json.loads(row) for row in rows if row.endswith(b"\n")]
        for row in whole:
            row.pop("job_seconds", None)
        return header + b"".join(json.dumps(without_times(row)).encode() + b"\n" for row in whole)
    if path.name in ("rows.csv", "rows.parquet") or path.parent.name == "rows":
        return b""  # made of rows.jsonl, with its times
    content = path.read_bytes().replace(str(folder).encode(), b"FOLDER")
    return re.sub(rb"[\d.]+ hours of jobs", b"", content)


def _kill_once(
    verb: str, folder: Path, plain: Uninterrupted, rng: np.random.Generator
) -> list[str]:
    """Start, kill and check; return the faults."""
    sent = SIGNALS[rng.integers(len(SIGNALS))]
    process = _start(verb, folder)
    end = time.monotonic() + float(rng.uniform(0.0, 1.1 * plain.seconds))
    if rng.random() < 0.6:
        _wait_for_changes(folder, int(rng.integers(1, len(plain.files) + 12)), process)
        end = time.monotonic() + float(rng.exponential(0.005))
    while time.monotonic() < end and process.poll() is None:
        time.sleep(_POLL)
    if process.poll() is None:
        process.send_signal(sent)
    process.wait(_LONGEST)
    return [f"{fault}, {sent.name}" for fault in half_written(folder, plain)]


def _wait_for_changes(folder: Path, count: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until files of the folder, unfinished ones too, have changed `count` times."""
    before, seen = -1, 0
    began = time.monotonic()
    while seen < count and process.poll() is None and time.monotonic() - began < _LONGEST:
        state = hash(tuple((p.name, _size(p)) for p in sorted(folder.rglob("*"))))
        seen += state != before
        before = state
        time.sleep(_POLL)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return -1


def half_written(folder: Path, plain: Uninterrupted) -> list[str]:
    """Return files that differ from an uninterrupted run (the log: from its beginning)."""
    faults = []
    for name, content in files_in(folder).items():
        whole = plain.files.get(name)
        if whole is None or not (
            whole.startswith(content[: content.rfind(b"\n") + 1])
            if name in LOGS
            else content == whole
        ):
            faults.append(f"{name} after a kill")
    return faults


def interrupted(
    verb: str, folder: Path, plain: Uninterrupted, rng: np.random.Generator
) -> list[str]:
    """Kill a command one to three times, then run it to its end; return the faults."""
    faults = []
    for _ in range(int(rng.integers(1, 4))):
        faults += _kill_once(verb, folder, plain, rng)
    code = _start(verb, folder).wait(_LONGEST)
    if code:
        faults.append(f"run again, it ended with {code}")
    left = files_in(folder)
    changed = [n for n in sorted({*left, *plain.files}) if left.get(n) != plain.files.get(n)]
    return faults + [f"{name} in the end" for name in changed]
