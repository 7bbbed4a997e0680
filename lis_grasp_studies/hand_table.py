"""Table of hands: findings of doctor, planning time, and objects held, from one command.

``python -m lis_grasp_studies.hand_table`` runs it; interrupted, it continues.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import check_hand
from lis_grasp.robots.shipped_models import READY_HANDS
from lis_grasp.shapes import NAMES
from lis_grasp_studies.harness.runner import local_scheduler, run_trials
from lis_grasp_studies.study.results import StudyResults
from lis_grasp_studies.study.run import run_trial
from lis_grasp_studies.study.study import Study

FURTHER_OBJECTS = ("bottle", "bean", "vase", "rounded_box", "dumbbell", "l_bracket")
"""Test objects beside the built-in shapes."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the missing trials, and write and print the table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hands", nargs="+", default=READY_HANDS)
    parser.add_argument("--objects", nargs="+", default=[*NAMES, *FURTHER_OBJECTS])
    parser.add_argument("--seeds", type=int, default=3, help="(default: 3)")
    parser.add_argument("--touches", type=int, default=40, help="(default: 40)")
    parser.add_argument("--jobs", type=int, help="processes (default: the machine's cores)")
    parser.add_argument("--output", type=Path, default=Path("results/hands"))
    options = parser.parse_args(arguments)
    try:
        table = hand_table(
            options.hands,
            options.objects,
            seeds=options.seeds,
            touches=options.touches,
            output=options.output,
            jobs=options.jobs,
        )
    except LisGraspError as error:
        print(f"hand_table: {error}", file=sys.stderr)
        return 1
    write_text(options.output / "hands.md", table)
    print(table)
    return 0


def hand_table(
    hands: Sequence[str],
    objects: Sequence[str],
    *,
    seeds: int,
    touches: int,
    output: Path,
    jobs: int | None = None,
) -> str:
    """Return the table in Markdown, after running the trials that are missing in `output`.

    A hand whose model is not installed has a line that says how to get it. Each trial explores an
    object with the kinematic prober and an ideal sensor, estimates it by `blend`, and lifts the
    best grasp once.
    """
    found: dict[str, Hand] = {}
    lines = ["| hand | doctor | planning, median | held |", "|---|---|---|---|"]
    missing = []
    for name in hands:
        try:
            found[name] = Hand.load(name)
        except LisGraspError as error:
            missing.append(f"| `{name}` | {error} | | |")
    if found:
        rows = _rows(list(found), objects, seeds, touches, output, jobs)
        lines += [_line(name, hand, rows) for name, hand in found.items()]
    return "\n".join([*lines, *missing]) + "\n"


def _rows(
    hands: list[str],
    objects: Sequence[str],
    seeds: int,
    touches: int,
    output: Path,
    jobs: int | None,
) -> list[Row]:
    study = Study.from_facts(
        {
            "objects": list(objects),
            "estimators": ["blend"],
            "reference": "blend",
            "touches": [touches],
            "noise": ["none"],
            "hands": hands,
            "seeds": seeds,
        }
    )
    study.require_files()
    results = StudyResults(output)
    total = len(study.trials())
    todo = results.missing(study)
    for done, of in run_trials(todo, total, results.lines, local_scheduler(jobs), run_trial):
        print(f"{done} of {of} trials", file=sys.stderr)
    return results.of(study)


def _line(name: str, hand: Hand, rows: Sequence[Row]) -> str:
    own = [row for row in rows if row["hand"] == Path(name).name]
    findings = check_hand(hand)
    faults = sum(not finding.fine for finding in findings)
    doctor = "ok" if not faults else f"{faults} of {len(findings)} to fix"
    seconds = [row["seconds_grasp"] for row in own if row["seconds_grasp"] is not None]
    planning = f"{np.median(seconds):.0f} s" if seconds else ""
    held = sum(bool(row["held"]) for row in own)
    return f"| `{name}` | {doctor} | {planning} | {held} of {len(own)} |"


if __name__ == "__main__":
    sys.exit(main())
