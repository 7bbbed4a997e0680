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
from lis_grasp_studies.evaluation.touched_shapes import COUNTS, NOISE
from lis_grasp_studies.harness.statistics import (
    LEAST_CLUSTERS,
    detectable_difference,
    equivalence_p_value,
    interval_over_objects,
)
from lis_grasp_studies.harness.tables import NONE, Table

Better = Literal["lower", "higher"]
Verdict = Literal["loss", "win", "equal", "unclear", ""]

EQUAL = 0.05
"""Significance of each of the two one-sided tests that show equality."""


@dataclass(frozen=True, slots=True)
class Margin:
    """Size below which a difference does not matter, in the unit of its measures, and why."""

    size: float
    source: str
    largest: float | None = None
    """Difference of one object that is rare but possible where none was seen."""


# Chosen after the first rows were known, but from sources that do not depend on them.
LENGTH = Margin(1e3 * NOISE["position_noise"], "the noise of a touch's position")
SHARE = Margin(10.0, "that of the study of doses, fixed before its runs", 100.0)
SURFACE = Margin(100.0 / max(COUNTS), "the surface of one of 40 contacts")
BRIER = Margin((0.01 * SHARE.size) ** 2, "all predictions off by 10 points more", 1.0)
TOUCHES = Margin(5.0, "the touches between two estimates", 40.0)


@dataclass(frozen=True, slots=True)
class Measure:
    """A number of one row; None where the row has none to give."""

    name: str
    unit: str
    better: Better
    value: Callable[[Row], float | None]
    margin: Margin = LENGTH
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
    replace(measure, count=count)
    for count in COUNTS[::-1]
    for measure in (
        Measure("slot", "mm", "lower", _length("slot", "slot_x", "slot_y")),
        Measure("walls", "mm", "lower", _length("wall", "wall_turned")),
        Measure("truth to estimate", "mm", "lower", _length("rmsd_truth_to_estimate")),
        Measure("estimate to truth", "mm", "lower", _length("rmsd")),
        Measure("edges", "mm", "lower", _at_edges),
        Measure("superfluous", "%", "lower", _superfluous, SURFACE),
        Measure("cups found", "%", "higher", _percent("accepted", "true"), SHARE),
        Measure("cups that seal", "%", "higher", _percent("kept", "said"), SHARE),
        Measure("stands", "%", "higher", _percent("stands"), SHARE),
        Measure("extents inside", "%", "higher", _percent("inside"), SHARE),
    )
)
_LIFTS = (
    Measure("held", "%", "higher", _percent("held"), SHARE),
    Measure("Brier score", "", "lower", _miscalibration, BRIER),
)

MEASURES: Mapping[str, tuple[Measure, ...]] = MappingProxyType(
    {
        "stored_tasks": _TASKS,
        "stored_lifts": _LIFTS,
        "stored_planners": _LIFTS,
        "stored_hands": _LIFTS,
        "stored_policies": (
            Measure("touches until known", "", "lower", lambda row: float(row["touches"]), TOUCHES),
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
    p_equal: float = 1.0
    """Of two one-sided t-tests that the difference is within the measure's margin."""
    detectable: float | None = None
    """Difference that so many objects show with a power of 80 %."""

    @property
    def verdict(self) -> Verdict:
        """Loss or win if the interval of the difference is on one side of 0, else equal or unclear.

        Equal is what both one-sided tests show. Unclear is what has too few objects to tell a
        difference from none. Without a baseline, nothing is said.
        """
        low, high = self.difference
        if not self.baseline:
            return ""
        if low is None or high is None or low <= 0.0 <= high:
            return "equal" if self.p_equal < EQUAL else "unclear"
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
    change, margin = first - second, alone.measure.margin
    p_equal = equivalence_p_value(change, margin.size, largest=margin.largest)
    return replace(
        alone,
        baseline=name,
        baseline_mean=float(second.mean()),
        pairs=len(both),
        difference=_interval(both, change),
        p_equal=p_equal if len(both) >= LEAST_CLUSTERS else 1.0,
        detectable=detectable_difference(change),
    )


def _values(measure: Measure, rows: Sequence[Row]) -> dict[str, float]:
    """Return the value of each object."""
    of_count = [row for row in rows if measure.count in (None, row.get("count"))]
    values = {row["object"]: measure.value(row) for row in of_count}
    return {name: value for name, value in values.items() if value is not None}


def _interval(names: Sequence[str], values: FloatArray) -> tuple[float | None, float | None]:
    return interval_over_objects([{"object": name} for name in names], values)


def score_table(found: Sequence[Score], name: str) -> Table:
    """Return all scores as a table: losses first, then what is unclear, equal or won."""
    order = {"loss": 0, "unclear": 1, "": 2, "equal": 3, "win": 4}
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
                score.baseline.rpartition(":")[2] or NONE,
                theirs,
                _ends(score.difference),
                score.verdict,
                f"{measure.margin.size:g}",
                f"{score.p_equal:.3f}" if score.baseline else NONE,
                NONE if score.detectable is None else f"{score.detectable:.2f}",
                f"{score.pairs or score.objects}",
            )
        )
    first = ("measure", "mean (95 %)", "baseline", "its mean", "difference, 95 %", "verdict")
    head = (*first, "margin", "p (equal)", "found with 80 %", "objects")
    return Table("scores", f"{name}, losses first", head, tuple(body))


def _ends(interval: tuple[float | None, float | None]) -> str:
    low, high = interval
    return NONE if low is None or high is None else f"{low:+.2f} to {high:+.2f}".replace("+", "")
