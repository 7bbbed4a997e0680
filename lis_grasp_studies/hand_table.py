"""Table of hands: findings of doctor, planning time, and objects held, from one command.

``python -m lis_grasp_studies.hand_table`` runs it; interrupted, it continues.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import check_hand
from lis_grasp.robots.shipped_models import READY_HANDS
from lis_grasp.shapes import NAMES
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.runner import local_scheduler, run_trials
from lis_grasp_studies.harness.tables import median_cell, where
from lis_grasp_studies.study.results import StudyResults
from lis_grasp_studies.study.run import run_trial
from lis_grasp_studies.study.study import Study

FURTHER_OBJECTS = ("bottle", "bean", "vase", "rounded_box", "dumbbell", "l_bracket")
"""Test objects beside the built-in shapes."""


@dataclass(frozen=True, slots=True)
class HandTable:
    """Trials of hands on objects: explored by geometry alone, estimated by `blend`, lifted once."""

    hands: Sequence[str]
    objects: Sequence[str]
    seeds: int
    touches: int

    def run(self, output: Path, jobs: int | None = None) -> str:
        """Run the trials that are missing in a folder; return the table in Markdown.

        A hand whose model is not installed has a line that says how to get it.
        """
        hands: dict[str, Hand] = {}
        missing = []
        for name in self.hands:
            try:
                hands[name] = Hand.load(name)
            except LisGraspError as error:
                missing.append(f"| `{name}` | {error} | | |")
        lines = ["| hand | doctor | planning, median | held |", "|---|---|---|---|"]
        if hands:
            rows = self._rows(list(hands), output, jobs)
            for name, hand in hands.items():
                lines.append(_line(name, hand, where(rows, hand=Path(name).name)))
        return "\n".join([*lines, *missing]) + "\n"

    def _rows(self, hands: list[str], output: Path, jobs: int | None) -> list[Row]:
        facts: dict[str, Any] = {"estimators": ["blend"], "reference": "blend", "noise": ["none"]}
        facts |= {"objects": list(self.objects), "touches": [self.touches], "seeds": self.seeds}
        study = Study.from_facts(facts | {"hands": hands})
        study.require_files()
        results, total = StudyResults(output), len(study.trials())
        todo, scheduler = results.missing(study), local_scheduler(jobs)
        for done, of in run_trials(todo, total, results.lines, scheduler, run_trial):
            print(f"{done} of {of} trials", file=sys.stderr)
        return results.of(study)


def _line(name: str, hand: Hand, rows: Sequence[Row]) -> str:
    findings = check_hand(hand)
    faults = sum(not finding.fine for finding in findings)
    doctor = "ok" if not faults else f"{faults} of {len(findings)} to fix"
    planning = f"{median_cell('seconds_grasp', digits=0)(rows)} s"
    return f"| `{name}` | {doctor} | {planning} | {len(where(rows, held=True))} of {len(rows)} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the missing trials, and write and print the table; return the exit code."""
    defaults = {"hands": list(READY_HANDS), "objects": [*NAMES, *FURTHER_OBJECTS], "seeds": 3}
    defaults |= {"touches": 40, "jobs": int, "output": Path("results/hands")}
    options = read_options(__doc__, arguments, **defaults)
    table = HandTable(options.hands, options.objects, options.seeds, options.touches)
    try:
        text = table.run(options.output, options.jobs)
    except LisGraspError as error:
        print(f"hand_table: {error}", file=sys.stderr)
        return 1
    write_text(options.output / "hands.md", text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
