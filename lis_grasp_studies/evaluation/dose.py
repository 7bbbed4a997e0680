"""Experiment: grasps planned on the truth with changed edges, and lifted on the truth.

The plan, written before a row. No estimator takes part. Objects of a salt that is taken after the
method is fixed: nobody saw them. Three each are of six families with flat faces and of one with
rims between curved faces. A grasp is planned on the truth (*exact*), on the truth with its convex
edges rounded by 2, 4 or 8 mm (an edge is missing), or with its faces continued beyond them by 2, 4
or 8 mm (surface is superfluous), all above the table. Then it is lifted on the truth, under the
conditions of the grasp study: the object is free in a stable pose, mass and friction are not known,
the first of five grasps is lifted as planned, in one attempt. A plan without a grasp is not held. A
dose that an object is too thin for is missing, and counted.

A pair is a changed dose and *exact* with the same object, hand and seed. Objects are the units: a
difference is the mean over objects of the mean of an object's pairs, in points, with the 95 %
interval over objects and Wilcoxon's test. The primary endpoint is the difference in held grasps of
faces continued by any of the three distances. The others, edges rounded by any radius and each
dose alone, are adjusted by Holm. "Equal" is said only where two one-sided t-tests over objects
show, at 5 % each, that the difference is less than `MARGIN`, 10 points. Where the means of 21
objects vary by 27 points (one standard deviation), a loss of 17 points is found with a power of
78 %. Where they vary by 20 or 17 points and do not differ on average, equality is found with a
power of 43 or 66 %: without that proof, nothing is said. (Where no object differs, a t-test has no
variance: `equivalence_p_value` has what replaces it, added when the first four objects did not.)
Beside it, without lifts: planned grasps that close on the truth, and distances of their contacts
from the nearest true edge.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np
import trimesh
from pydantic import Field
from scipy.spatial import cKDTree

from lis_grasp import Hand, pipeline
from lis_grasp.evaluation.grasp_on_truth import epsilon_on_truth
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.json_lines import Row
from lis_grasp.shapes import Shape
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.stages.scenario import place_object
from lis_grasp_studies.evaluation.part import Places, SaltedPart, SaltedTrial
from lis_grasp_studies.evaluation.task_geometry import points_along
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.statistics import (
    Interval,
    cluster_sums,
    equivalence_p_value,
    holm,
    interval_over_objects,
    objects_of,
    rate_with_interval,
    sign_flip_p_value,
    signed_ranks,
)
from lis_grasp_studies.harness.tables import (
    NONE,
    Column,
    Table,
    grouped_table,
    median_cell,
    split,
    values_of,
)
from lis_grasp_studies.study.cells import effect_text, gains, p_value
from lis_grasp_studies.study.columns import NO_GRASP, failure_in
from lis_grasp_studies.study.run import DRAKE, scenario_at
from lis_grasp_studies.study.trial import Setup
from lis_grasp_studies.test_objects.changed_edges import continue_faces, round_edges
from lis_grasp_studies.test_objects.salted import EDGED_FAMILIES, salted_shape

EXACT, ROUNDED, CONTINUED = "exact", "rounded", "continued"
"""The truth, and the two kinds of doses: variants are `EXACT`, or like "rounded by 2 mm"."""

TOO_THIN = "too_thin"
"""Reason of rows whose object is too thin for their dose."""

MARGIN = 0.1
"""Difference of success rates below which doses are equal."""

_SETUP = Setup(prober="dynamic", conditions="unknown")  # of the grasp study


@dataclass(frozen=True, slots=True)
class DoseTrial(SaltedTrial):
    """One object of a salt and one hand; the seed draws pose, place and grasps."""

    hand: str


def measure_dose(trial: DoseTrial, dose: str) -> Row:
    """Return the grasps that are planned on a dose, and the lift of the first one."""
    shape, seed = _placed(trial.salt, trial.number, trial.seed)
    row: Row = {"object": shape.name, "family": shape.name.split("-")[0]}
    mesh = changed_truth(trial.salt, trial.number, trial.seed, dose)
    if mesh is None:
        return row | {"reason": TOO_THIN}
    row |= {"held": 0, "lifted": 0, "reason": NO_GRASP, "volume": mesh.volume / shape.mesh.volume}
    with failure_in(row):
        task = _SETUP.run_config(object=shape.name, hand=trial.hand, seed=seed)
        scenario = scenario_at(task, shape, Hand.load(trial.hand))
        search = plan_grasps(scenario.agent, mesh)
        row |= {"planned": len(search.grasps), "candidates": search.candidates}
        if not search.grasps:
            return row
        friction, hand = scenario.truth.friction, scenario.agent.hand
        qualities = [
            epsilon_on_truth(grasp, shape.mesh, hand, friction=friction) for grasp in search.grasps
        ]
        points = np.concatenate([grasp.contact_points for grasp in search.grasps])
        distances, _ = cKDTree(points_along(shape.edges)).query(points)
        row |= {"close": sum(quality > 0.0 for quality in qualities)}
        row |= {"edge_distance": float(np.median(distances))}
        row |= {"success": float(search.best.quality["success_probability"])}
        outcome = pipeline.lift(scenario, search.best)
        row |= {"held": int(outcome.held), "lifted": int(outcome.lifted), "reason": outcome.reason}
        row |= {"slip": float(outcome.slip), "turn": float(outcome.turn)}
    return row


@lru_cache(maxsize=2)
def _placed(salt: str, number: int, seed: int) -> tuple[Shape, int]:
    """Return the object at its pose on the table, and the seed of all hands' runs."""
    shape = salted_shape(salt, number, EDGED_FAMILIES)
    own = int(np.random.SeedSequence([seed, *shape.name.encode()]).generate_state(1)[0])
    return place_object(shape, _SETUP.run_config(object=shape.name, seed=own))[0], own


@lru_cache(maxsize=8)
def changed_truth(salt: str, number: int, seed: int, dose: str) -> trimesh.Trimesh | None:
    """Return the truth of a trial with a dose, above the table; None if it is too thin for it.

    Raises `InvalidOptionError` if there is no dose of this name.
    """
    shape, _ = _placed(salt, number, seed)
    if dose == EXACT:
        return shape.mesh
    kind, _, amount = dose.removesuffix(" mm").partition(" by ")
    if kind not in (ROUNDED, CONTINUED) or not amount.isdecimal():
        raise InvalidOptionError.not_one_of(
            "variants", dose, (EXACT, f"{ROUNDED} by 2 mm", f"{CONTINUED} by 2 mm")
        )
    if kind == ROUNDED:
        return round_edges(shape.mesh, 1e-3 * int(amount))
    return continue_faces(shape.mesh, 1e-3 * int(amount), lowest=0.0)


DOSE = Experiment("dose", measure_dose, asdict, variant="dose", modules=(DRAKE,))
"""The experiment; its variants are doses."""


class DosePart(SaltedPart):
    """Lifts of grasps that were planned on the truth with changed edges."""

    measure: Literal["dose"]
    hands: list[str] = Field(min_length=1)
    experiment: ClassVar[Experiment] = DOSE

    def trials(self, seed: int, places: Places) -> Iterator[DoseTrial]:
        """Yield the trials of a seed."""
        for each in super().trials(seed, places):
            yield from (DoseTrial(**asdict(each), hand=hand) for hand in self.hands)

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the differences from the exact truth, losses first, and the planned contacts."""
        return [difference_table(rows), contacts_table(rows)]

    def answers(self, rows: Sequence[Row]) -> dict[str, str]:
        """Return both differences of all doses of a kind."""
        found = differences(rows)
        texts = [
            f"{found[kind].text} points {kind}" for kind in (CONTINUED, ROUNDED) if kind in found
        ]
        return {"What do changed edges cost fingertips?": ", ".join(texts)} if texts else {}

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return each difference [points], its pairs and tests; an interval where there is one."""
        numbers: dict[str, float] = {}
        for name, found in differences(rows).items():
            low, high = found.interval
            numbers |= {f"points {name}": 100.0 * found.mean, f"pairs {name}": found.pairs}
            numbers |= {f"lost {name}": found.lost, f"won {name}": found.won}
            numbers |= {f"equal {name}": found.p_equal, f"p {name}": found.p_value}
            if low is not None and high is not None:
                numbers |= {f"low {name}": 100.0 * low, f"high {name}": 100.0 * high}
        return numbers


@dataclass(frozen=True, slots=True)
class Difference:
    """Held grasps of doses less those of the exact truth, paired; means over objects."""

    mean: float
    interval: Interval
    p_value: float
    """Of Wilcoxon's signed ranks of objects; adjusted, unless it is the primary endpoint's."""
    p_equal: float
    """The larger of two one-sided t-tests over objects: that it is not within `MARGIN`."""
    lost: int
    won: int
    pairs: int
    objects: int

    @property
    def text(self) -> str:
        """The mean in points, with its interval."""
        return effect_text("held", self.mean, *self.interval)


def differences(rows: Sequence[Row]) -> Mapping[str, Difference]:
    """Return the differences of each dose, and of all doses of a kind by the kind's name."""
    lifts = (row for row in rows if row["reason"] != TOO_THIN)
    of_pairs = split(lifts, "number", "hand", "seed")
    pairs: dict[str, list[tuple[Row, Row]]] = {CONTINUED: [], ROUNDED: []}
    for met in of_pairs.values():
        exact = [row for row in met if row["dose"] == EXACT]
        for row in met:
            if exact and row["dose"] != EXACT:
                pairs[row["dose"].split()[0]].append((row, exact[0]))
                pairs.setdefault(row["dose"], []).append((row, exact[0]))
    found = {name: _difference(of) for name, of in pairs.items() if of}
    others = [name for name in found if name != CONTINUED]
    adjusted = dict(zip(others, holm([found[name].p_value for name in others]), strict=True))
    return {
        name: replace(each, p_value=float(adjusted.get(name, each.p_value)))
        for name, each in found.items()
    }


def _difference(pairs: Sequence[tuple[Row, Row]]) -> Difference:
    """Return the difference of pairs, with its tests over objects."""
    won, rows = gains(pairs), [row for row, _ in pairs]
    places = objects_of(rows)
    means = cluster_sums(won, places) / np.bincount(places)
    named = [{"object": place} for place in range(len(means))]
    return Difference(
        mean=float(means.mean()),
        interval=interval_over_objects(named, means),
        p_value=sign_flip_p_value(signed_ranks(means)),
        p_equal=equivalence_p_value(means, MARGIN),
        lost=int((won < 0.0).sum()),
        won=int((won > 0.0).sum()),
        pairs=len(pairs),
        objects=len(means),
    )


def difference_table(rows: Sequence[Row]) -> Table:
    """Return the differences of doses from the exact truth, the largest losses first."""
    head = ("planned on", "objects", "pairs", "points (95 % over objects)", "lost / won")
    body = tuple(
        (
            f"{name} (primary)" if name == CONTINUED else name,
            str(found.objects),
            str(found.pairs),
            found.text,
            f"{found.lost} / {found.won}",
            p_value(found.p_value),
            p_value(found.p_equal),
        )
        for name, found in sorted(differences(rows).items(), key=lambda each: each[1].mean)
    )
    title = "Held grasps, less those planned on the exact truth"
    return Table("differences", title, (*head, "p (Holm)", "p (equal)"), body)


def contacts_table(rows: Sequence[Row]) -> Table:
    """Return held grasps of each dose, and the planned grasps on the truth."""
    columns: list[Column] = [
        ("held", _held),
        ("no grasp", lambda rows: str(sum(row["reason"] == NO_GRASP for row in rows))),
        ("too thin", lambda rows: str(sum(row["reason"] == TOO_THIN for row in rows))),
        ("planned grasps that close [%]", _closing),
        ("contacts to an edge [mm]", median_cell("edge_distance", 1e3)),
    ]
    title = "Grasps planned on each dose, on the truth"
    return grouped_table("contacts", title, "planned on", split(rows, "dose"), columns)


def _held(rows: Sequence[Row]) -> str:
    held = values_of(rows, "held")
    return rate_with_interval(int(held.sum()), len(held)) if len(held) else NONE


def _closing(rows: Sequence[Row]) -> str:
    planned = values_of(rows, "planned").sum()
    return f"{100.0 * values_of(rows, 'close').sum() / planned:.0f}" if planned else NONE
