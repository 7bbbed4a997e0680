"""Parts that run whole programs: commands, answers of the service, fits by number of contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Literal

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.evaluation.commands import (
    BESIDE,
    COMMANDS,
    FITS,
    SERVICE,
    THIS,
    CommandTrial,
    FitTrial,
    ServiceTrial,
)
from lis_grasp_studies.evaluation.grasp_tables import ALL
from lis_grasp_studies.evaluation.part import Places, SeedsPart
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.statistics import rate_with_interval
from lis_grasp_studies.harness.tables import (
    Column,
    Table,
    grouped_table,
    mean_cell,
    median_cell,
    split,
    values_of,
    where,
)


class CommandsPart(SeedsPart):
    """Commands in processes of their own: what runs achieve, and what commands cost."""

    measure: Literal["commands"]
    commands: dict[str, str]
    """Command lines by their names; see `CommandTrial`."""
    objects: list[str]
    experiment: ClassVar[Experiment] = COMMANDS

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        """Yield the trials of a seed."""
        beside = str(places.beside or "")
        for name in places.find(self.objects):
            for command in self.commands.values():
                yield CommandTrial(command, name, seed, beside)

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the outcomes of runs, and the costs of all commands."""
        rows = self._named(rows)
        lifts = [row for row in rows if row.get("held") is not None]
        costs: list[Column] = [
            ("runs", lambda rows: str(len(where(rows, package=THIS)))),
            *(
                (f"{text}, {what}", _median_of(package, column, digits))
                for column, what, digits in (
                    ("wall", "s", 2),
                    ("processor", "CPU s", 2),
                    ("memory", "MB", 0),
                )
                for package, text in ((THIS, "this version"), (BESIDE, "the other"))
                if package == THIS or where(rows, package=BESIDE)
            ),
        ]
        outcomes: list[Column] = [
            ("held (95 %)", _held),
            ("executed", mean_cell("attempts", digits=2)),
            ("rmsd [mm]", median_cell("rmsd", 1e3, 2)),
            ("motion [s]", median_cell("motion", digits=0)),
            ("other reasons", _reasons),
        ]
        if any(row.get("effort") is not None for row in lifts):  # of an arm
            outcomes[1:1] = [
                ("without violation", _held_within_limits),
                ("effort", median_cell("effort", digits=2)),
                ("speed", median_cell("speed", digits=2)),
            ]
        runs = split(lifts, "command", "object")
        runs |= {(name, ALL): of for name, of in split(lifts, "command").items()}
        title, first = "Runs, lost ones by their reasons", "command | object"
        whole = split(rows, "command", "object")
        return [
            grouped_table("runs", title, first, runs, outcomes),
            grouped_table("costs", "Costs, medians", first, whole, costs),
        ]

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return how often each command held each object, of how many trials, and its cost [s]."""
        found: dict[str, float] = {}
        own = where(self._named(rows), package=THIS)
        for names, of in split(own, "command", "object").items():
            lifts, key = values_of(of, "held"), " ".join(names)
            found |= {key: int(lifts.sum()), f"{key} trials": len(lifts)}
            found[f"{key} CPU"] = float(np.median(values_of(of, "processor")))
        return found

    def _named(self, rows: Sequence[Row]) -> list[Row]:
        """Return rows with the names of their commands."""
        label = {command: name for name, command in self.commands.items()}
        return [row | {"command": label[row["command"]]} for row in rows]


def _count(rows: Sequence[Row]) -> str:
    return str(len(rows))


def _median_of(package: str, column: str, digits: int) -> Any:
    cell = median_cell(column, digits=digits)
    return lambda rows: cell(where(rows, package=package))


def _held(rows: Sequence[Row]) -> str:
    return rate_with_interval(sum(bool(row["held"]) for row in rows), len(rows))


def _held_within_limits(rows: Sequence[Row]) -> str:
    good = [row for row in rows if row["held"] and not row.get("violations")]
    return rate_with_interval(len(good), len(rows))


def _reasons(rows: Sequence[Row]) -> str:
    return ", ".join(str(row["reason"]) for row in rows if not row["held"])


class ServicePart(SeedsPart):
    """Time of an answer of the service that chooses touches."""

    measure: Literal["service"]
    objects: list[str]
    hands: list[str]
    touches: int
    experiment: ClassVar[Experiment] = SERVICE

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        """Yield the trials of a seed."""
        for name in self.objects:
            for hand in self.hands:
                yield ServiceTrial(name, seed, hand, self.touches)

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the times of answers."""
        columns: list[Column] = [
            ("answers", _count),
            ("median [ms]", median_cell("wall", 1e3, 0)),
            ("processor, mean [ms]", mean_cell("processor", 1e3, 0)),
        ]
        title = f"Answers with about {self.touches} contacts"
        groups = split(rows, "hand", "estimator")
        return [grouped_table("answers", title, "hand | estimator", groups, columns)]


class FitsPart(SeedsPart):
    """Cost of estimators by the number of contacts."""

    measure: Literal["fits"]
    contacts: list[int]
    experiment: ClassVar[Experiment] = FITS

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        """Yield the trials of a seed."""
        for count in self.contacts:
            yield FitTrial(count, seed)

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the costs by the number of contacts."""
        columns: list[Column] = [
            ("fit [ms]", median_cell("fit", 1e3)),
            ("field [us/point]", median_cell("field", 1e6, 2)),
            ("mesh [s]", median_cell("mesh", digits=2)),
            ("memory [MB]", median_cell("memory", 2**-20)),
            ("judgement [ms]", median_cell("judge", 1e3)),
        ]
        title = "Fit, field at a point, mesh, memory; judgement of the contacts"
        groups = split(rows, "estimator", "contacts")
        return [grouped_table("fits", title, "estimator | contacts", groups, columns)]

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return the time of the judgement of so many contacts [s]."""
        groups = split([row for row in rows if row.get("judge")], "contacts")
        return {f"judge {n}": float(values_of(of, "judge").min()) for n, of in groups.items()}
