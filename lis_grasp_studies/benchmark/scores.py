"""Scores: what the rows of a track say of one plug-in, beside the baselines, losses first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray
from lis_grasp_studies.evaluation.task_geometry import FAILED
from lis_grasp_studies.evaluation.touched_shapes import COUNTS
from lis_grasp_studies.harness.statistics import interval_over_objects
from lis_grasp_studies.harness.tables import NONE, Table

Better = Literal["lower", "higher"]


@dataclass(frozen=True, slots=True)
class Measure:
    """A number of one row; None where the row has none to give."""

    name: str
    unit: str
    better: Better
    value: Callable[[Row], float | None]
    count: int | None = None
    """Number of contacts of the rows that it is of; None for all rows."""


def _length(*columns: str) -> Callable[[Row], float | None]:
    """Return a mean of columns in mm; what failed has the largest length."""

    def value(row: Row) -> float | None:
        return 1e3 * float(np.mean([row.get(name, FAILED) for name in columns]))

    return value


def _percent(part: str, whole: str | None = None) -> Callable[[Row], float | None]:
    """Return a part in percent, of a whole or of 1; what failed has 0."""

    def value(row: Row) -> float | None:
        if "failure" in row:
            return 0.0
        total = 1.0 if whole is None else float(row[whole])
        return 100.0 * float(row[part]) / total if total and row.get(part) is not None else None

    return value


def _at_edges(row: Row) -> float | None:
    """Return the error at edges in mm; None of an object without any."""
    return None if row["family"] == "blob" else _length("edge_rmsd")(row)


def _superfluous(row: Row) -> float | None:
    """Return the share of the surface more than 3 mm outside of the truth, in percent."""
    return 100.0 * float(row.get("beyond_3mm", 1.0))


def _miscalibration(row: Row) -> float | None:
    """Return by how much a predicted success is wrong, squared (Brier 1950)."""
    predicted = row.get("predicted")
    return None if predicted is None else (float(predicted) - float(row["held"])) ** 2


_TASKS = tuple(
    Measure(name, unit, better, value, count)  # type: ignore[arg-type]
    for count in COUNTS[::-1]
    for name, unit, better, value in (
        ("slot", "mm", "lower", _length("slot", "slot_x", "slot_y")),
        ("walls", "mm", "lower", _length("wall", "wall_turned")),
        ("truth to estimate", "mm", "lower", _length("rmsd_truth_to_estimate")),
        ("estimate to truth", "mm", "lower", _length("rmsd")),
        ("edges", "mm", "lower", _at_edges),
        ("superfluous", "%", "lower", _superfluous),
        ("cups found", "%", "higher", _percent("accepted", "true")),
        ("cups that seal", "%", "higher", _percent("kept", "said")),
        ("stands", "%", "higher", _percent("stands")),
        ("extents inside", "%", "higher", _percent("inside")),
    )
)
_LIFTS = (
    Measure("held", "%", "higher", _percent("held")),
    Measure("Brier score", "", "lower", _miscalibration),
)

MEASURES: Mapping[str, tuple[Measure, ...]] = MappingProxyType(
    {
        "stored_tasks": _TASKS,
        "stored_lifts": _LIFTS,
        "stored_hands": _LIFTS,
        "stored_policies": (
            Measure("touches until known", "", "lower", lambda row: float(row["touches"])),
            Measure("error, 20 touches", "mm", "lower", _length("error_20")),
            Measure("error, 40 touches", "mm", "lower", _length("error_40")),
        ),
    }
)
"""The measures of each kind of track, the primary one first."""


@dataclass(frozen=True, slots=True)
class Score:
    """A measure of a plug-in, and its difference to a baseline on the same objects."""

    track: str
    measure: Measure
    objects: int
    mean: float
    interval: tuple[float | None, float | None]
    """95 %, by a bootstrap over objects."""
    baseline: str = ""
    baseline_mean: float | None = None
    """Of the baseline on the same objects; None without one."""
    pairs: int = 0
    """Objects of both."""
    difference: tuple[float | None, float | None] = (None, None)
    """95 % interval of the plug-in minus the baseline, paired by objects."""

    @property
    def verdict(self) -> Literal["loss", "win", ""]:
        """Whether the interval of the difference is on one side of 0."""
        low, high = self.difference
        if low is None or high is None or low <= 0.0 <= high:
            return ""
        return "loss" if (low > 0.0) == (self.measure.better == "lower") else "win"


def scores(
    track: str, measures: Sequence[Measure], rows: Sequence[Row], others: Mapping[str, list[Row]]
) -> list[Score]:
    """Return the scores of the rows of a plug-in in a track, against the rows of each baseline."""
    found = []
    for measure in measures:
        mine = _values(measure, rows)
        if not mine:
            continue
        numbers = np.array(list(mine.values()))
        interval = _interval(list(mine), numbers)
        alone = Score(track, measure, len(mine), float(numbers.mean()), interval)
        against = [_against(alone, mine, name, _values(measure, of)) for name, of in others.items()]
        found += [score for score in against if score is not None] or [alone]
    return found


def _against(
    alone: Score, mine: Mapping[str, float], name: str, theirs: Mapping[str, float]
) -> Score | None:
    """Return the score against a baseline; None without objects of both."""
    both = [key for key in mine if key in theirs]
    if not both:
        return None
    first, second = (np.array([of[key] for key in both]) for of in (mine, theirs))
    return replace(
        alone,
        baseline=name,
        baseline_mean=float(second.mean()),
        pairs=len(both),
        difference=_interval(both, first - second),
    )


def _values(measure: Measure, rows: Sequence[Row]) -> dict[str, float]:
    """Return the value of each object."""
    of_count = [row for row in rows if measure.count in (None, row.get("count"))]
    values = {row["object"]: measure.value(row) for row in of_count}
    return {name: value for name, value in values.items() if value is not None}


def _interval(names: Sequence[str], values: FloatArray) -> tuple[float | None, float | None]:
    return interval_over_objects([{"object": name} for name in names], values)


def score_table(found: Sequence[Score], name: str) -> Table:
    """Return all scores as a table: losses first, then what is not decided, then wins."""
    order = {"loss": 0, "": 1, "win": 2}
    body = []
    for score in sorted(found, key=lambda score: order[score.verdict]):
        measure = score.measure
        of = f" at {measure.count}" if measure.count else ""
        unit = f" [{measure.unit}]" if measure.unit else ""
        theirs = NONE if score.baseline_mean is None else f"{score.baseline_mean:.2f}"
        body.append(
            (
                f"{score.track}: {measure.name}{of}{unit}",
                f"{score.mean:.2f} ({_ends(score.interval)})",
                score.baseline or NONE,
                theirs,
                _ends(score.difference),
                score.verdict,
                f"{score.pairs or score.objects}",
            )
        )
    head = ("measure", "mean (95 %)", "baseline", "its mean", "difference, 95 %", "", "objects")
    return Table("scores", f"{name}, losses first", head, tuple(body))


def _ends(interval: tuple[float | None, float | None]) -> str:
    low, high = interval
    return NONE if low is None or high is None else f"{low:+.2f} to {high:+.2f}".replace("+", "")
