"""Coverage-guided fuzzing of one reader with atheris: what reaches new code is kept and changed.

    python -m pip install atheris
    python tests/robustness/coverage_fuzz.py contacts.csv --seconds 600
    python tests/robustness/coverage_fuzz.py --list

Inputs begin with the sound file of `fuzzing/file_cases.py`, and with `corpus/READER/` if it exists.
A failure (see `fuzzing/cases.py`) ends the process; its input is written to the folder --crashes.
Sizes are limited to 64 kB, memory to 4 GB, an input to 20 s.
"""

from __future__ import annotations

import argparse
import base64
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import atheris
import numpy as np

_HERE = Path(__file__).parent
_INSTRUMENTED = ("lis_grasp.io", "lis_grasp.hands", "lis_grasp.shapes", "lis_grasp.exploration")
# Parsers in Python that the readers use; the other libraries are compiled.
_PARSERS = ("yaml", "plyfile", "trimesh.exchange", "yourdfpy", "json", "csv", "zipfile")

with atheris.instrument_imports(include=[*_INSTRUMENTED, *_PARSERS]):
    import trimesh
    from fuzzing.cases import Case, verdict_of
    from fuzzing.file_cases import READERS
    from fuzzing.hand_cases import check_loaded, write_hand
    from fuzzing.log_cases import check_log

    from lis_grasp.io.contact_files import read_point_file
    from lis_grasp.robots.link_bodies import load_mesh
    from lis_grasp.shapes import load

_LONGEST = 65_536
_MEMORY = 4096  # [MB]
_SLOWEST = 20  # [s] of one input
_REPORT_EVERY = 10.0  # [s]


def _box(ending: str) -> bytes:
    exported = trimesh.creation.box(extents=(0.05, 0.06, 0.07)).export(file_type=ending)
    return exported if isinstance(exported, bytes) else exported.encode()


def _gltf() -> bytes:
    """Return a box as glTF with its buffer inside."""
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box()))
    header = json.loads(files["model.gltf"])
    for buffer in header["buffers"]:
        content = base64.b64encode(files[buffer["uri"]]).decode()
        buffer["uri"] = f"data:application/octet-stream;base64,{content}"
    return json.dumps(header).encode()


_LOG = b"time,force,x,y,z\n" + b"".join(
    b"%.2f,%.2f,0.01,0.02,%.3f\n" % (0.1 * k, 0.3 * (k > 5), 0.1 - 0.01 * min(k, 6))
    for k in range(12)
)
# Name of the file, its sound content, and the check of a damaged one.
_MORE: dict[str, tuple[str, Callable[[], bytes], Callable[[Path], object]]] = {
    "body dae": ("body.dae", lambda: _box("dae"), lambda path: load_mesh(path, None)),
    "mesh gltf": ("mesh.gltf", _gltf, load),
    "points xyz": ("points.xyz", lambda: b"0 0 0.1\n0 0.1 0\n0.1 0 0\n", read_point_file),
    "log csv": ("log.csv", lambda: _LOG, check_log),
}
_READERS = READERS | _MORE


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("reader", nargs="?", choices=list(_READERS), metavar="READER")
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--crashes", type=Path, default=Path("crashes"))
    parser.add_argument("--keep", type=Path, help="folder for the inputs that reach new code")
    parser.add_argument("--list", action="store_true", help="print the readers, and end")
    options = parser.parse_args()
    if options.list or options.reader is None:
        print("\n".join(_READERS))
        return
    fuzz(options)


def _target(reader: str, folder: Path) -> tuple[Path, bytes, Callable[[], object]]:
    """Return the file to change, its sound content, and the check."""
    if reader.startswith("hand "):
        kind = reader.removeprefix("hand ")
        hand, model = write_hand(folder, kind, np.random.default_rng(1))
        file = hand if kind == "yaml" else model
        return file, file.read_bytes(), lambda: check_loaded(hand)
    name, content, check = _READERS[reader]
    return folder / name, content(), lambda: check(folder / name)


def fuzz(options: argparse.Namespace) -> None:
    path, seed, check = _target(options.reader, Path(tempfile.mkdtemp(prefix="fuzz-")))
    kept = options.keep or Path(tempfile.mkdtemp(prefix="corpus-"))
    kept.mkdir(parents=True, exist_ok=True)
    (kept / "sound").write_bytes(seed)
    options.crashes.mkdir(parents=True, exist_ok=True)
    verdicts = Counter[str]()
    start = shown = time.monotonic()

    def one_input(data: bytes) -> None:
        nonlocal shown
        path.write_bytes(data)
        verdict, message = verdict_of(Case(options.reader, check))
        verdicts[verdict.split()[0]] += 1
        if time.monotonic() - shown > _REPORT_EVERY or verdict.startswith("failed"):
            shown = time.monotonic()
            counts = ", ".join(f"{word} {count}" for word, count in sorted(verdicts.items()))
            print(f"{options.reader}: {shown - start:.0f} s, {counts}", flush=True)
        if verdict.startswith("failed"):
            raise RuntimeError(f"{verdict}: {message}")

    corpus = _HERE / "corpus" / options.reader
    arguments = [
        *(sys.argv[0], f"-max_total_time={options.seconds}", f"-max_len={_LONGEST}"),
        *(f"-rss_limit_mb={_MEMORY}", f"-timeout={_SLOWEST}", f"-seed={options.seed}"),
        *(f"-artifact_prefix={options.crashes}/", "-verbosity=0", "-print_final_stats=1"),
        str(kept),
        *([str(corpus)] if corpus.is_dir() else []),
    ]
    atheris.Setup(arguments, one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
