"""A part of an evaluation: an experiment, its trials by rounds of seeds, tables and numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

from lis_grasp.io.json_lines import Row
from lis_grasp.shapes import FORMATS
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.page import Picture
from lis_grasp_studies.harness.tables import Table

Groups = Mapping[Any, Sequence[str]]
"""Objects by their groups, such as families."""


@dataclass(frozen=True, slots=True)
class Places:
    """Folders that a configuration does not name."""

    meshes: Path | None = None
    """Of the mesh files, such as scans."""
    beside: Path | None = None
    """Of another version of the package, whose commands are timed in turns with this one's."""

    def find(self, names: Sequence[str]) -> list[str]:
        """Return names of objects, mesh files by their paths; without a folder, without these."""
        meshes = {name for name in names if Path(name).suffix.lower() in FORMATS}
        if self.meshes is None:
            return [name for name in names if name not in meshes]
        return [str(self.meshes / name) if name in meshes else name for name in names]


class Part(BaseModel):
    """What all parts have."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    title: str
    variants: list[str] = Field(min_length=1)
    seconds: float = Field(gt=0.0)
    """Expected time of a job on one core, for all variants, until there are rows [s]."""

    experiment: ClassVar[Experiment]

    def rounds(self, places: Places) -> list[list[Any]]:
        """Return the trials of each round of seeds."""
        raise NotImplementedError

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the tables of some rows, losses first."""
        raise NotImplementedError

    def pictures(self, rows: Sequence[Row]) -> list[Picture]:
        """Return the charts of some rows."""
        return []

    def answers(self, rows: Sequence[Row]) -> dict[str, str]:
        """Return the answers of some rows that are published first, by their questions."""
        return {}

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return numbers of some rows that pages quote, by their names."""
        return {}


class SeedsPart(Part):
    """A part whose trials are those of seeds."""

    seeds: list[int | list[int]] = Field(min_length=1)
    """One or several for each round."""

    def rounds(self, places: Places) -> list[list[Any]]:
        """Return the trials of each round of seeds."""
        rounds = [[seeds] if isinstance(seeds, int) else seeds for seeds in self.seeds]
        return [[t for seed in seeds for t in self.trials(seed, places)] for seeds in rounds]

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        """Yield the trials of a seed."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class SaltedTrial:
    """One object of a salt, touched with one seed."""

    salt: str
    number: int
    seed: int


class SaltedPart(SeedsPart):
    """A part whose trials are those of seeds, of objects with flat faces that a salt makes."""

    salt: str
    objects: int = Field(ge=6)

    def trials(self, seed: int, places: Places) -> Iterator[SaltedTrial]:
        """Yield the trials of a seed."""
        for number in range(self.objects):
            yield SaltedTrial(self.salt, number, seed)


def interleaved(groups: Groups) -> list[tuple[str, str]]:
    """Return groups and members so that each beginning has of each group about its fraction."""
    places = [
        ((k + 0.5) / len(members), group, name)
        for group, members in groups.items()
        for k, name in enumerate(members)
    ]
    return [(group, name) for _, group, name in sorted(places, key=lambda place: place[0])]


def group_of(groups: Groups) -> dict[str, str]:
    """Return the group of each member, by the names in rows."""
    return {name: group for group, members in groups.items() for name in members}
