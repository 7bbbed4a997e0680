"""Configuration of an evaluation: its parts, their order, and the jobs of all rounds of seeds."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from lis_grasp.exceptions import InvalidOptionError, LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.io.schemas import checked
from lis_grasp.io.yaml_files import read_yaml
from lis_grasp.robots.hand import Hand
from lis_grasp_studies.evaluation.part import Places
from lis_grasp_studies.evaluation.parts import KINDS, AnyPart
from lis_grasp_studies.harness.rows import Job
from lis_grasp_studies.harness.tables import split

SHIPPED = Path(__file__).parent
"""Folder of the shipped configurations, ``published.yaml`` and ``quick.yaml``."""

_EVERYWHERE = Places(Path())  # as if all mesh files were there
_FileName = Annotated[str, Field(pattern=r"^\w[\w.-]*$")]


class Configuration(BaseModel):
    """The parts of an evaluation by name, the most important first."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    parts: dict[_FileName, Annotated[AnyPart, Field(discriminator="measure")]] = Field(min_length=1)

    @classmethod
    def load(cls, path: Path, names: Sequence[str] | None = None) -> Configuration:
        """Return the configuration in a YAML file, or some of its parts.

        The key ``shared`` is for lists that several parts refer to.

        Raises
        ------
        InvalidFileError
            If the file cannot be read, or a value is not permitted; the message names it.
        InvalidOptionError
            If there is no part of a name.
        """
        content = read_yaml(path)
        if isinstance(content, dict):
            content.pop("shared", None)
        known = checked(cls, content, path, "configuration")
        for name in names or ():
            if name not in known.parts:
                raise InvalidOptionError.not_one_of("--parts", name, tuple(known.parts))
        chosen = {
            name: part for name, part in known.parts.items() if name in (names or known.parts)
        }
        return cls.model_construct(parts=chosen)

    def jobs(self, places: Places | None) -> Iterator[Job]:
        """Yield every job: rounds of seeds, in a round the parts in order of their importance.

        What cannot be run is left out: mesh files that are nowhere, hands whose models are not
        installed, another version without a folder. Without places, nothing is.
        """
        rounds = [part.rounds(places or _EVERYWHERE) for part in self.parts.values()]
        for of_parts in zip_longest(*rounds, fillvalue=()):
            for (name, part), trials in zip(self.parts.items(), of_parts, strict=True):
                for trial in trials:
                    variants = tuple(part.variants)
                    if places is not None:
                        variants = _runnable(variants, part.experiment.facts(trial), places)
                    if variants:
                        yield Job(PartTrial(name, part.measure, trial), variants)

    def missing(self, places: Places | None, rows: Sequence[Row]) -> list[Job]:
        """Return the jobs that lack rows, with the variants that they lack."""
        known = {key for key, _ in self._keyed(rows)}
        return [
            Job(job.trial, variants)
            for job in self.jobs(places)
            if (variants := tuple(v for v in job.variants if job.trial.key(v) not in known))
        ]

    def ordered(self, rows: Sequence[Row]) -> dict[str, list[Row]]:
        """Return the rows of each part that has some, in the order of its trials."""
        keys = (job.trial.key(name) for job in self.jobs(None) for name in job.variants)
        places = {key: place for place, key in enumerate(keys)}
        keyed = [(places[key], row) for key, row in self._keyed(rows) if key in places]
        keyed.sort(key=lambda pair: pair[0])
        found = split((row for _, row in keyed), "part")
        return {name: found[name] for name in self.parts if name in found}

    def _keyed(self, rows: Sequence[Row]) -> Iterator[tuple[Any, Row]]:
        """Yield the rows of all parts, each after its key."""
        trials = ((n, chain(*part.rounds(_EVERYWHERE))) for n, part in self.parts.items())
        first = {name: trial for name, of_part in trials for trial in islice(of_part, 1)}
        for row in rows:
            if (name := row["part"]) in first:
                yield (name, *self.parts[name].experiment.key_of(row, first[name])), row


def _runnable(variants: tuple[str, ...], facts: Row, places: Places) -> tuple[str, ...]:
    """Return the variants of a trial that can be run."""
    if not _is_installed(facts.get("hand")):
        return ()
    return tuple(name for name in variants if name != "beside" or places.beside)


@lru_cache
def _is_installed(hand: str | None) -> bool:
    try:
        return hand is None or bool(Hand.load(hand))
    except LisGraspError:
        return False


@dataclass(frozen=True, slots=True)
class PartTrial:
    """A trial of a part."""

    part: str
    measure: str
    trial: Any

    def key(self, variant: str) -> tuple[Any, ...]:
        """Return the key of the rows of a variant."""
        return self.part, *KINDS[self.measure].experiment.key(self.trial, variant)


def measure_part(job: Job) -> list[Row]:
    """Return the rows of a job of a `PartTrial`, with the part and the time of the job [s]."""
    start = time.perf_counter()
    rows = KINDS[job.trial.measure].experiment.run(Job(job.trial.trial, job.variants))
    cost = {"part": job.trial.part, "job_seconds": time.perf_counter() - start}
    return [row | cost for row in rows]
