"""Fuzz the package with malformed input; count accepted, refused and failed cases.

    python tests/robustness/fuzz.py                             # a minute or two
    python tests/robustness/fuzz.py --contacts 10000 --files 10000 --seed 0
    python tests/robustness/fuzz.py --only contacts:1234        # one case, in this process

Exit code 1 if any case failed; `fuzzing/cases.py` defines failures.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from fuzzing.cases import case_of
from fuzzing.kinds import KINDS
from fuzzing.workers import Job, Result, run_cases, run_one

from lis_grasp.exceptions import LisGraspError

_DEFAULTS = {"contacts": 400, "meshes": 200, "hands": 100, "files": 600, "logs": 200}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, count in _DEFAULTS.items():
        parser.add_argument(f"--{name}", type=int, default=count, metavar="N")
    parser.add_argument("--first", type=int, default=0, help="index of each kind's first case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--only", metavar="KIND:INDEX", help="run one case and print it")
    options = parser.parse_args()
    if options.only:
        kind, index = options.only.split(":")
        return show(kind, options.seed, int(index))
    counts = {name: getattr(options, name) for name in KINDS}
    results = []
    # Ctrl-C and SIGTERM print the table of the cases so far.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for result in run_cases(jobs_of(counts, options.seed, options.first), options.jobs):
            results.append(result)
            if result.verdict.startswith("failed"):
                where = f"{result.kind}:{result.index}"
                print(f"{where} {result.verdict}: {result.message}", flush=True)
    except KeyboardInterrupt:
        print("interrupted; results so far:")
    print_table(results)
    return int(any(result.verdict.startswith("failed") for result in results))


def jobs_of(counts: dict[str, int], seed: int, first: int = 0) -> Iterator[Job]:
    for kind, count in counts.items():
        for index in range(first, first + count):
            yield kind, seed, index


def show(kind: str, seed: int, index: int) -> int:
    """Run one case in this process; print its input in words and the traceback."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        case = case_of(kind, KINDS, seed, index, Path(folder))
        print(f"{kind}:{index} ({KINDS[kind].group(index)}): {case.text}")
        try:
            case.check()
        except LisGraspError as error:
            print(f"raised {type(error).__name__}: {error}")
        except Exception:  # noqa: BLE001
            traceback.print_exc(file=sys.stdout)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        result = run_one(kind, seed, index, Path(folder))
    print(f"{result.verdict} in {result.seconds:.2f} s {result.message}")
    return int(result.verdict.startswith("failed"))


def print_table(results: list[Result]) -> None:
    print(f"\n| {'kind':26s} | generated | accepted | refused | failed | slowest [s] |")
    print("|---|---|---|---|---|---|")
    groups = [(kind, group) for kind in KINDS for group in KINDS[kind].groups]
    for kind, group in [*groups, *((kind, "") for kind in KINDS)]:
        rows = [r for r in results if r.kind == kind and group in (r.group, "")]
        if rows:
            words = Counter(r.verdict.split()[0] for r in rows)
            slowest = max(r.seconds for r in rows)
            print(
                f"| {f'{kind}, {group}' if group else f'{kind}, all':26s} | {len(rows)}"
                f" | {words['accepted']} | {words['refused']} | {words['failed']}"
                f" | {slowest:.1f} |"
            )
    for word in ("refused", "failed"):
        classes = Counter(r.verdict.split()[1] for r in results if r.verdict.startswith(word))
        listed = ", ".join(f"{name} {count}" for name, count in classes.most_common())
        print(f"\n{word}: {listed or 'none'}")


if __name__ == "__main__":
    sys.exit(main())
