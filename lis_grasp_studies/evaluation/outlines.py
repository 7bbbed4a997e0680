"""Experiment: outlines of estimates, the clearance they say, and the clearance needed.

The plan, written before a run. The objects, poses and touches are those of the lifts with a suction
cup. The outline of the estimate from the first 20 and all 40 contacts, along each coordinate axis,
is compared with the true one: by how much it must grow to contain it, and shrink to be inside.
The quantiles of both, in mean deviations along the silhouette, are those that `outline` uses; they
come from development objects. On other objects, the table says in which fraction the bounds for a
probability are true, and how large the clearance is: goals are that probability, and 4 mm at 90 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import ClassVar, Literal

import numpy as np

from lis_grasp.exceptions import LisGraspError
from lis_grasp.exports.outline import (
    AXES,
    PROBABILITIES,
    needed,
    outline,
    scales,
    silhouette,
    silhouette_deviation,
)
from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray
from lis_grasp_studies.evaluation.part import SaltedPart, SaltedTrial
from lis_grasp_studies.evaluation.suction_lifts import explored
from lis_grasp_studies.evaluation.touched_shapes import COUNTS, estimated_mesh
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.tables import Table, split, values_of


def measure_outlines(trial: SaltedTrial, estimator: str) -> list[Row]:
    """Return a row for each number of contacts and axis."""
    shape, contacts = explored(trial)
    rows: list[Row] = []
    for count in COUNTS:
        row: Row = {"object": shape.name, "count": count}
        try:
            mesh = estimated_mesh(estimator, shape, contacts[:count])
        except LisGraspError as error:
            rows.append(row | {"axis": "", "failure": str(error)})
            continue
        for axis in AXES:
            found = outline(mesh, axis)
            grow, shrink = needed(found.polygon, silhouette(shape.mesh, found.rotation))
            deviation = silhouette_deviation(mesh, found.polygon, found.rotation)
            row |= {"axis": axis, "grow": grow, "shrink": shrink, "deviation": deviation}
            rows.append(dict(row))
    return rows


OUTLINES = Experiment("outlines", measure_outlines, asdict)
"""The experiment; its variants are estimators."""


class OutlinesPart(SaltedPart):
    """Outlines of objects with flat faces, and how true their bounds are."""

    measure: Literal["outlines"]
    experiment: ClassVar[Experiment] = OUTLINES

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the reliability of both bounds."""
        return [reliability_table(rows)]

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return how often bounds are true, clearances [mm], and the quantiles of what was needed.

        These are in mean deviations along silhouettes.
        """
        found = {}
        for line in reliability_table(rows).body:
            estimator, count, said, true, clearance, *_ = line
            found[f"true {said} {estimator} {count}"] = float(true)
            found[f"clearance {said} {estimator} {count}"] = float(clearance)
        return found | {
            f"{name} {100 * p:g} {estimator}": conformal_quantile(_ratios(of, name), p)
            for estimator, of in split(rows, "estimator").items()
            for name in ("grow", "shrink")
            for p in PROBABILITIES
        }


def conformal_quantile(values: FloatArray, probability: float) -> float:
    """Return the number that the next of some exchangeable values is below with a probability.

    The ceil((n + 1) p)-th of n (Vovk et al. 2005); the largest if there are too few.
    """
    place = int(np.ceil((len(values) + 1) * probability)) - 1
    return float(np.sort(values)[min(place, len(values) - 1)])


def reliability_table(rows: Sequence[Row]) -> Table:
    """Return how often bounds for a probability are true, and their distances from the outline."""
    body = []
    for (estimator, count), of in split(rows, "estimator", "count").items():
        for p in PROBABILITIES:
            cells = [f"{estimator}", str(count), f"{100 * p:g}"]
            for name, scale in zip(("grow", "shrink"), scales(p), strict=True):
                offset, wanted = scale * values_of(of, "deviation"), values_of(of, name)
                cells += [f"{100 * np.mean(wanted <= offset):.0f}", f"{1e3 * offset.mean():.1f}"]
            body.append(tuple(cells))
    bounds = ("goes in [%]", "clearance [mm]", "inner bound true [%]", "shrunk by [mm]")
    head = ("estimator", "touches", "said [%]", *bounds)
    return Table("outlines", "Outlines and their bounds", head, tuple(body))


def _ratios(rows: Sequence[Row], name: str) -> FloatArray:
    return np.asarray(values_of(rows, name) / np.maximum(values_of(rows, "deviation"), 1e-6))
