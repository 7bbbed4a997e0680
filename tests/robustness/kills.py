"""Kill explorations, runs and studies at random moments, run them again, and compare the files.

    python tests/robustness/kills.py --count 200                      # an hour on two cores
    python tests/robustness/kills.py --count 50 --verbs explore       # a few minutes

Each command is killed one to three times, by SIGKILL, SIGTERM or SIGINT, at a random moment or just
after a file in its folder has changed; then it runs to its end. After every kill, files under their
final names must be complete; the files of touches and rows, which grow, must be beginnings of the
uninterrupted ones. At the end all files must equal those of an uninterrupted run, byte for byte
except for times. Exit code 1 if any does not. On SIGTERM it finishes the current command and
reports the commands so far.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lis_grasp_studies.study.study_results import without_times

COMMANDS = {
    "explore": "explore box --known --prober kinematic --touches 8 --position-noise 0.001",
    "run": "run box --known --prober kinematic --touches 8 --grasps 1 --estimator patch",
    "compare": "compare --objects box --estimators patch gpis --reference gpis --touches 4"
    " --noise none --seeds 2 --jobs 1",
}
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
LOGS = ("touches.jsonl", "rows.jsonl")  # the files that grow
# An uninterrupted command takes seconds; after this time it hangs [s].
_LONGEST = 600.0
_POLL = 0.002


@dataclass(frozen=True)
class Uninterrupted:
    """The files of an uninterrupted command, without times, and its duration."""

    files: dict[str, bytes]
    seconds: float


def start(verb: str, folder: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "lis_grasp.cli.main", *COMMANDS[verb].split()]
    quiet = subprocess.DEVNULL
    return subprocess.Popen([*command, "--output", str(folder)], stdout=quiet, stderr=quiet)


def uninterrupted(verb: str, folder: Path) -> Uninterrupted:
    began = time.monotonic()
    if start(verb, folder).wait(_LONGEST):
        raise SystemExit(f"the uninterrupted {verb} failed")
    return Uninterrupted(files_in(folder), time.monotonic() - began)


def files_in(folder: Path) -> dict[str, bytes]:
    """Return the contents of the finished files of a folder, without times."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.name.startswith("."):
            found[str(path.relative_to(folder))] = content_of(path, folder)
    return found


def content_of(path: Path, folder: Path) -> bytes:
    if path.name == "report.json":
        report = json.loads(path.read_bytes())
        report.pop("timings")
        return json.dumps(report).encode()
    if path.name == "rows.jsonl":
        header, *rows = path.read_bytes().splitlines(keepends=True) or [b""]
        whole = (json.loads(row) for row in rows if row.endswith(b"\n"))
        return header + b"".join(json.dumps(without_times(row)).encode() + b"\n" for row in whole)
    if path.name in ("rows.parquet", "rows.csv"):
        return b""  # made of rows.jsonl, with its times
    return path.read_bytes().replace(str(folder).encode(), b"FOLDER")


def kill_once(
    verb: str, folder: Path, plain: Uninterrupted, rng: np.random.Generator
) -> tuple[str, list[str]]:
    """Start, kill and check; return the signal, or "none" if the command had ended, and faults."""
    name = SIGNALS[rng.integers(len(SIGNALS))]
    process = start(verb, folder)
    end = time.monotonic() + float(rng.uniform(0.0, 1.1 * plain.seconds))
    if rng.random() < 0.6:
        wait_for_changes(folder, int(rng.integers(1, len(plain.files) + 12)), process)
        end = time.monotonic() + float(rng.exponential(0.005))
    while time.monotonic() < end and process.poll() is None:
        time.sleep(_POLL)
    late = process.poll() is not None
    if not late:
        process.send_signal(name)
    process.wait(_LONGEST)
    return "none" if late else name.name, half_written(folder, plain)


def wait_for_changes(folder: Path, count: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until files of the folder, unfinished ones too, have changed `count` times."""
    before, seen = -1, 0
    began = time.monotonic()
    while seen < count and process.poll() is None and time.monotonic() - began < _LONGEST:
        state = hash(tuple((p.name, size_of(p)) for p in sorted(folder.rglob("*"))))
        seen += state != before
        before = state
        time.sleep(_POLL)


def size_of(path: Path) -> int:
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
) -> tuple[list[str], list[str]]:
    """Kill a command one to three times, then run it to its end; return signals and faults."""
    signals, faults = [], []
    for _ in range(int(rng.integers(1, 4))):
        sent, found = kill_once(verb, folder, plain, rng)
        signals.append(sent)
        faults += found
    code = start(verb, folder).wait(_LONGEST)
    if code:
        faults.append(f"run again, it ended with {code}")
    left = files_in(folder)
    faults += [
        f"{name} in the end"
        for name in sorted({*left, *plain.files})
        if left.get(name) != plain.files.get(name)
    ]
    return signals, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20, help="commands to interrupt, of all verbs")
    parser.add_argument("--verbs", nargs="+", choices=list(COMMANDS), default=list(COMMANDS))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    asked_to_stop: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: asked_to_stop.append(number))
    failed = 0
    for number, verb in enumerate(options.verbs):
        if asked_to_stop:
            break
        count = options.count // len(options.verbs)
        count += number < options.count % len(options.verbs)
        signals: Counter[str] = Counter()
        faulty = done = 0
        with tempfile.TemporaryDirectory(prefix="kills-") as name:
            plain = uninterrupted(verb, Path(name) / "plain")
            for index in range(count):
                if asked_to_stop:
                    break
                rng = np.random.default_rng([options.seed, number, index])
                sent, faults = interrupted(verb, Path(name) / f"killed{index}", plain, rng)
                signals.update(sent)
                faulty += bool(faults)
                done += 1
                for fault in faults:
                    print(f"{verb} {index}, {', '.join(sent)}: {fault}", flush=True)
        failed += faulty
        listed = ", ".join(f"{key} {value}" for key, value in sorted(signals.items()))
        print(f"{verb}: {done} interrupted, {faulty} with faults; kills: {listed}", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
