"""Coverage-guided fuzzing with atheris: what reaches new code is kept and changed.

    python -m pip install atheris
    PYTHONPATH=tests python tests/robustness/coverage_fuzz.py contacts.csv --seconds 600

Inputs are the choices of a hypothesis test (`cases.py`); without a kind, the kinds are listed. A
failure ends the process; its input is written to the folder --crashes. Memory is limited to 4 GB.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import atheris

# The package, and the parsers in Python that the readers use; other libraries are compiled.
_PARSERS = ("yaml", "plyfile", "trimesh.exchange", "yourdfpy", "json", "csv", "zipfile")

with atheris.instrument_imports(include=["lis_grasp", *_PARSERS]):
    from cases import TESTS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", nargs="?", choices=list(TESTS), metavar="KIND")
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--crashes", type=Path, default=Path("crashes"))
    options = parser.parse_args()
    if options.kind is None:
        print("\n".join(TESTS))
        return
    options.crashes.mkdir(parents=True, exist_ok=True)
    arguments = [
        *(sys.argv[0], f"-max_total_time={options.seconds}", "-max_len=65536"),
        *("-rss_limit_mb=4096", f"-seed={options.seed}", f"-artifact_prefix={options.crashes}/"),
    ]
    atheris.Setup(arguments, TESTS[options.kind]().hypothesis.fuzz_one_input)  # type: ignore[attr-defined]
    atheris.Fuzz()


if __name__ == "__main__":
    main()
