"""Experiment: what an edge is worth, by tasks on the surfaces of the same touches.

The plan, written before a run. 30 objects with flat faces, of six families, made from a salt that
is taken after everything that is compared is fixed: nobody saw them. Each is fixed at a known place
and touched 40 times by the four-finger hand's kinematic prober, with 0.5 mm and 3 degrees of noise.
The first 20 and all 40 contacts go to each estimator. `hull` is the convex hull of the contacts,
`truth` the true mesh: the floor of each measure.

The primary endpoint is the clearance of a slot that is cut to the estimate's outline and holds the
object, after 40 touches: the geometric mean over objects of the ratios of `blend` to `gpis`, of the
mean over three axes and all seeds of an object, with the 95 % interval over objects and Wilcoxon's
test. Its ratio to `smooth`, the model without edges, and the others to `gpis` follow, adjusted by
Holm. Beside it: clearances that suffice for 80 % of slots, errors at two walls along the object's
axes and at yaws drawn by the seed, suction cups of 10 mm, standing, superfluous surface, and true
extents inside two standard deviations. Losses of `blend` to any other, `hull` too, come first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np

from lis_grasp import Contacts, Hand
from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray
from lis_grasp_studies.evaluation.part import SaltedPart, SaltedTrial
from lis_grasp_studies.evaluation.task_geometry import (
    FAILED,
    Surface,
    extent_bands,
    points_along,
    slot_clearance,
    standing,
    suction,
    surface_excess,
    wall_errors,
)
from lis_grasp_studies.evaluation.touched_shapes import (
    COUNTS,
    HULL,
    TRUTH,
    estimated_mesh,
    touched,
)
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.statistics import (
    holm,
    interval_over_objects,
    sign_flip_p_value,
    signed_ranks,
)
from lis_grasp_studies.harness.tables import (
    NONE,
    Column,
    Table,
    grouped_table,
    mean_cell,
    median_cell,
    split,
)
from lis_grasp_studies.test_objects.salted import salted_shape

_GRIPPER = "cup"  # whose suction cup is pressed on
_PLACES = 400  # of cups, on each surface
_YAWS = 8
_FLOOR = 2e-4  # clearances below this are equal [m]
_LEAST_P = 0.001  # p-values below this are shown as such


def measure_tasks(trial: SaltedTrial, estimator: str) -> list[Row]:
    """Return a row for each number of contacts."""
    shape, contacts = _explored(trial)
    return task_rows(shape, contacts, estimator, seed=trial.seed, number=trial.number)


def task_rows(
    shape: Shape, contacts: Contacts, estimator: str, *, seed: int, number: int
) -> list[Row]:
    """Return a row for each of `COUNTS` of the contacts of a shape, the first ones first.

    The seed and the number of the shape decide on places of cups and yaws of walls.
    """
    cup, edges = Hand.load(_GRIPPER).pads[0].cup, points_along(shape.edges)
    assert cup is not None
    truth = Surface(shape.mesh, _PLACES, cup, seed)
    rows = []
    for count in COUNTS:
        row: Row = {"object": shape.name, "count": count, "family": shape.name.split("-")[0]}
        try:
            mesh = estimated_mesh(estimator, shape, contacts[:count])
        except LisGraspError as error:
            rows.append(row | {"failure": str(error), "slot": FAILED, "wall": FAILED})
            continue
        said = Surface(mesh, _PLACES, cup, seed)
        slots = [slot_clearance(mesh, shape.mesh, axis) for axis in (2, 0, 1)]
        yaws = np.random.default_rng([seed, number]).uniform(0.0, 2.0 * np.pi, _YAWS)
        walls = np.abs(wall_errors(mesh, shape.mesh, np.array([0.0, *yaws]))).max(axis=1)
        row |= {"slot": slots[0], "slot_x": slots[1], "slot_y": slots[2]}
        row |= {"wall": float(walls[0]), "wall_turned": float(np.quantile(walls[1:], 0.8))}
        row |= surface_excess(said, truth, edges) | suction(said, truth, edges)
        rows.append(row | standing(mesh, shape.mesh) | extent_bands(mesh, shape.mesh))
    return rows


@lru_cache(maxsize=2)  # all estimators get the same contacts
def _explored(trial: SaltedTrial) -> tuple[Shape, Contacts]:
    """Return the object, and the contacts of its exploration."""
    shape = salted_shape(trial.salt, trial.number)
    return shape, touched(shape, trial.seed)


TASKS = Experiment("tasks", measure_tasks, asdict)
"""The experiment; its variants are estimators, `HULL` and `TRUTH`."""


class TasksPart(SaltedPart):
    """Tasks at the edges of objects with flat faces."""

    measure: Literal["tasks"]
    experiment: ClassVar[Experiment] = TASKS

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the ratios of slots, losses first, and all measures."""
        return [ratio_table(rows), tasks_table(rows)]

    def answers(self, rows: Sequence[Row]) -> dict[str, str]:
        """Return the primary endpoint."""
        ratio = slot_ratio(rows, "blend", "gpis", max(COUNTS))
        if ratio is None:
            return {}
        low, high = ratio.interval
        text = (
            f"{ratio.mean:.2f} times that of GPIS ({low:.2f} to {high:.2f}) in a slot's clearance"
        )
        return {"What is an edge worth where it acts?": text}

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return the ratios of clearances, and what 80 % of upright slots need [mm]."""
        numbers = {}
        for (name, count), of in split(rows, "estimator", "count").items():
            numbers[f"slot {name} {count}"] = 1e3 * _most(of, "slot")
            ratio = slot_ratio(rows, str(name), "gpis", int(count))
            if ratio is not None and name not in ("gpis", TRUTH):
                numbers[f"ratio {name} {count}"] = ratio.mean
        return numbers


@dataclass(frozen=True, slots=True)
class SlotRatio:
    """Geometric mean over objects of paired ratios of clearances."""

    mean: float
    interval: tuple[float, float]
    p_value: float
    objects: int


def slot_ratio(rows: Sequence[Row], name: str, other: str, count: int) -> SlotRatio | None:
    """Return how much clearance the slots of an estimator need, in that of another's.

    The clearance of an object is the mean over three axes and its seeds. None without pairs.
    """
    of = {n: _clearances(rows, n, count) for n in (name, other)}
    both = [key for key in of[name] if key in of[other]]
    if len(both) < 2:
        return None
    logs = np.log([of[name][key] / of[other][key] for key in both])
    named = [{"object": key} for key in both]
    low, high = interval_over_objects(named, logs)
    p_value = sign_flip_p_value(signed_ranks(logs))
    ends = (np.nan, np.nan) if low is None or high is None else (np.exp(low), np.exp(high))
    return SlotRatio(float(np.exp(logs.mean())), ends, p_value, len(both))


def _clearances(rows: Sequence[Row], name: str, count: int) -> dict[str, float]:
    """Return the mean clearance of each object, over axes and seeds [m]."""
    found: dict[str, list[float]] = {}
    for row in rows:
        if row["estimator"] == name and row["count"] == count:
            values = [row.get(key, FAILED) for key in ("slot", "slot_x", "slot_y")]
            found.setdefault(row["object"], []).append(max(float(np.mean(values)), _FLOOR))
    return {key: float(np.mean(values)) for key, values in found.items()}


def ratio_table(rows: Sequence[Row]) -> Table:
    """Return the ratios of clearances, with intervals over objects and adjusted p-values.

    Ratios above 1 are losses, and come first; the primary endpoint's p-value is not adjusted.
    """
    pairs = [("blend", other) for other in ("gpis", "smooth", "lis", HULL)]
    pairs += [(name, "gpis") for name in ("smooth", "lis")]
    found = []
    for count in COUNTS[::-1]:
        for name, other in pairs:
            ratio = slot_ratio(rows, name, other, count)
            if ratio is not None:
                found.append((name, other, count, ratio))
    primary = ("blend", "gpis", max(COUNTS))
    others = [each for each in found if each[:3] != primary]
    adjusted = dict(
        zip([each[:3] for each in others], holm([e[3].p_value for e in others]), strict=True)
    )
    body = []
    for name, other, count, ratio in sorted(found, key=lambda each: -each[3].mean):
        low, high = ratio.interval
        p_value = float(adjusted.get((name, other, count), ratio.p_value))
        mark = " (primary)" if (name, other, count) == primary else ""
        probability = f"{p_value:.3f}" if p_value >= _LEAST_P else f"< {_LEAST_P}"
        cells = (str(count), f"{ratio.mean:.2f}", f"{low:.2f} to {high:.2f}", probability)
        body.append((f"{name} / {other}{mark}", *cells, str(ratio.objects)))
    head = ("pair", "touches", "clearance, ratio", "95 % over objects", "p (Holm)", "objects")
    return Table("slots", "Clearance of a slot cut to the outline, paired", head, tuple(body))


def tasks_table(rows: Sequence[Row]) -> Table:
    """Return all measures of each estimator and number of touches."""
    columns: list[Column] = [
        ("slot, 80 % [mm]", lambda rows: f"{1e3 * _most(rows, 'slot'):.1f}"),
        ("lying", lambda rows: f"{1e3 * _most(rows, 'slot_x', 'slot_y'):.1f}"),
        ("walls, 80 % [mm]", lambda rows: f"{1e3 * _most(rows, 'wall'):.1f}"),
        ("turned", lambda rows: f"{1e3 * _most(rows, 'wall_turned'):.1f}"),
        ("beyond, 99 % [mm]", median_cell("beyond", 1e3, 1)),
        ("beyond 3 mm [%]", mean_cell("beyond_3mm", 100.0, 1)),
        ("truth to est. [mm]", median_cell("rmsd_truth_to_estimate", 1e3, 2)),
        ("est. to truth", median_cell("rmsd", 1e3, 2)),
        ("edges", median_cell("edge_rmsd", 1e3, 2)),
        ("cups accepted [%]", lambda rows: _share(rows, "accepted", "true")),
        ("near edges", lambda rows: _share(rows, "accepted_near", "true_near")),
        ("seal [%]", lambda rows: _share(rows, "kept", "said")),
        ("near edges ", lambda rows: _share(rows, "kept_near", "said_near")),
        ("poses found [%]", mean_cell("found", 100.0, 0)),
        ("stands [%]", mean_cell("stands", 100.0, 0)),
        ("extents inside [%]", mean_cell("inside", 100.0, 0)),
        ("band [mm]", mean_cell("band", 1e3, 1)),
    ]
    groups = dict(sorted(split(rows, "count", "estimator").items(), key=lambda item: -item[0][0]))
    title = "Tasks on the surfaces of the same touches"
    return grouped_table("tasks", title, "touches | estimator", groups, columns)


def _values(rows: Sequence[Row], *names: str) -> FloatArray:
    """Return the values of rows; of an estimate that failed, no clearance suffices."""
    return np.array([row.get(name, FAILED) for row in rows for name in names], dtype=np.float64)


def _most(rows: Sequence[Row], *names: str) -> float:
    """Return the value that suffices for 80 % of rows."""
    return float(np.quantile(_values(rows, *names), 0.8, method="higher"))


def _share(rows: Sequence[Row], part: str, whole: str) -> str:
    """Return a share in percent of counts summed over rows, a dash of nothing."""
    total: Any = sum(row.get(whole, 0) for row in rows)
    return f"{100 * sum(row.get(part, 0) for row in rows) / total:.0f}" if total else NONE
