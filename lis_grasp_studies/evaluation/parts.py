"""Parts without lifts, all parts by the name of what they measure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Literal

from pydantic import Field

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.benchmark.tracks import (
    HandsTrack,
    LiftsTrack,
    PoliciesTrack,
    SurfacesTrack,
)
from lis_grasp_studies.contact_study.contact_sets import CASES
from lis_grasp_studies.contact_study.lies import DRAWS, EXPERIMENT, HARD, LieTrial, lie_tables
from lis_grasp_studies.contact_study.report import family_chart
from lis_grasp_studies.contact_study.score import SURFACES, TRUTH, Box, surface_trials
from lis_grasp_studies.contact_study.tables import (
    LOSS,
    MEASURES,
    WORST,
    ErrorRatio,
    by_family_table,
    calibration_table,
    error_ratios,
    error_table,
    losses_table,
    summarise,
)
from lis_grasp_studies.evaluation.command_parts import CommandsPart, FitsPart, ServicePart
from lis_grasp_studies.evaluation.dose import DosePart
from lis_grasp_studies.evaluation.exploration import EXPLORATION, ExplorationTrial
from lis_grasp_studies.evaluation.grasp_parts import GraspsPart, SimulatorsPart
from lis_grasp_studies.evaluation.grasp_tables import ALL, REFERENCE, SUBJECT
from lis_grasp_studies.evaluation.outlines import OutlinesPart
from lis_grasp_studies.evaluation.part import Part, Places, SeedsPart, group_of, interleaved
from lis_grasp_studies.evaluation.placings import PlacingsPart
from lis_grasp_studies.evaluation.suction_lifts import SuctionPart
from lis_grasp_studies.evaluation.tasks import TasksPart
from lis_grasp_studies.evaluation.views import ViewsPart
from lis_grasp_studies.evaluation.worlds import WorldsPart
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.page import Picture
from lis_grasp_studies.harness.tables import (
    Column,
    Table,
    grouped_table,
    mean_cell,
    median_cell,
    split,
    values_of,
)
from lis_grasp_studies.paper.report import TITLES, object_bars
from lis_grasp_studies.paper.tables import changes_table, claims_table, experiment_table
from lis_grasp_studies.paper.trials import PAPER, PaperExperiment, paper_trials

_ERRORS = ("rmsd", "rmsd_truth_to_estimate", "edge_rmsd")


class PaperPart(SeedsPart):
    """The paper's experiments on built-in objects."""

    measure: Literal["paper"]
    experiments: list[PaperExperiment]
    experiment: ClassVar[Experiment] = PAPER

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        """Yield the trials of a seed."""
        yield from paper_trials(self.experiments, [seed])

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the losses to GPIS, mean errors and the claims of the paper."""
        rows, there = self._whole(rows)
        titles: dict[str, str] = {name: TITLES[name] for name in there}
        claims = [claims_table(rows)] if {"whole", "wedge"} <= set(there) else []
        return [changes_table(rows, SUBJECT, titles), errors_table(rows), *claims]

    def pictures(self, rows: Sequence[Row]) -> list[Picture]:
        """Return the chart of errors at edges."""
        if "whole" not in self._whole(rows)[1]:
            return []
        caption = "From true edges to the estimate, fully explored objects of 20 cm."
        table = experiment_table(rows, "whole", "edge_rmsd")
        return [Picture.of("Edges", caption, object_bars(table, "True edges to estimate"))]

    def answers(self, rows: Sequence[Row]) -> dict[str, str]:
        """Return the errors at edges."""
        edges = self.numbers(rows).items()
        text = ", ".join(f"{value:.1f} mm ({estimator_label(name)})" for name, value in edges)
        return {"How far are sharp edges from the estimate?": text} if text else {}

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return the error at edges of each estimator [mm]."""
        if "whole" not in self._whole(rows)[1]:
            return {}
        table = experiment_table(rows, "whole", "edge_rmsd")
        return {name: 1e3 * table.overall(name) for name in table.estimators}

    def _whole(self, rows: Sequence[Row]) -> tuple[list[Row], list[PaperExperiment]]:
        """Return the experiments with a whole seed, whose tables name each object, and their rows.

        A stop in the first round leaves one that has not.
        """
        first = Counter(row["experiment"] for row in rows if row["seed"] == self.seeds[0])
        wanted = Counter(trial.experiment for trial in paper_trials(self.experiments, [0]))
        there = [n for n in self.experiments if first[n] == len(self.variants) * wanted[n]]
        return [row for row in rows if row["experiment"] in there], there


def errors_table(rows: Sequence[Row]) -> Table:
    """Return mean errors [mm] of estimators (lines) in experiments (columns)."""
    names = list(dict.fromkeys(row["experiment"] for row in rows))

    def cell(estimator: str, experiment: str) -> str:
        tables = (experiment_table(rows, experiment, measure) for measure in _ERRORS)
        return " / ".join(f"{1e3 * table.overall(estimator):.1f}" for table in tables)

    body = tuple(
        (estimator_label(name), *(cell(name, experiment) for experiment in names))
        for name in dict.fromkeys(row["estimator"] for row in rows)
    )
    title = "Errors in mm: estimate to truth / truth to estimate / true edges to estimate"
    return Table("errors", title, ("estimator", *names), body)


class SurfacesPart(SeedsPart):
    """Surfaces of objects that nothing was chosen on, from all kinds of contacts."""

    measure: Literal["surfaces"]
    objects: dict[str, list[str]]
    """By families."""
    scans: list[str]
    part: int = Field(ge=1, le=len(CASES))
    box: Box
    experiment: ClassVar[Experiment] = SURFACES

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        """Yield the trials of a seed; each object meets one case of `part`."""
        names = places.find([*(n for _, n in interleaved(self.objects)), *self.scans])
        yield from surface_trials(names, part=self.part, seeds=[seed], box=self.box)

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the losses, the ratios by family, errors and calibration."""
        ratios = [r for r in error_ratios(rows, REFERENCE) if r.estimator != TRUTH]
        families = by_family_table(ratios, SUBJECT)
        whole = tuple(line for line in families.body if line[1] == ALL)
        return [
            losses_table(ratios, SUBJECT, above=WORST),
            replace(families, body=whole),
            error_table(rows, self.variants),
            calibration_table(rows, [SUBJECT, REFERENCE]),
        ]

    def pictures(self, rows: Sequence[Row]) -> list[Picture]:
        """Return the chart of ratios by family."""
        ratios = error_ratios(rows, REFERENCE)
        others = [name for name in self.variants if name not in (TRUTH, REFERENCE)]
        return [family_chart(ratios, REFERENCE, others)]

    def answers(self, rows: Sequence[Row]) -> dict[str, str]:
        """Return the geometric means of both ratios."""
        ratios = self._ratios(rows)
        texts = [f"{summarise(ratios, name).text()} {name.replace('_', ' ')}" for name in MEASURES]
        lost = sum(ratio.worst > LOSS for ratio in ratios)
        text = f"times that of GPIS: {', '.join(texts)}; larger in {lost} of {len(ratios)} sets"
        return {"How large is the error of blend on other objects, with any contacts?": text}

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return the geometric means of both ratios, of all objects and of each family."""
        ratios = self._ratios(rows)
        groups = {"": ratios}
        for ratio in ratios:
            groups.setdefault(f"{ratio.family} ", []).append(ratio)
        return {
            f"{prefix}{name}": summarise(of, name).mean
            for prefix, of in groups.items()
            for name in MEASURES
        }

    def _ratios(self, rows: Sequence[Row]) -> list[ErrorRatio]:
        return [r for r in error_ratios(rows, REFERENCE) if r.estimator == SUBJECT]


class LiesPart(SeedsPart):
    """Contacts that lie, on objects that nothing was chosen on."""

    measure: Literal["lies"]
    objects: dict[str, list[str]]
    """By the groups of tables, such as families."""
    part: int = Field(ge=1)
    fits: bool
    experiment: ClassVar[Experiment] = EXPERIMENT

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        """Yield the trials of a seed; each object meets one draw of `part`."""
        place = {name: i for i, name in enumerate(group_of(self.objects))}
        for _, name in interleaved(self.objects):
            for j, draw in enumerate(DRAWS):
                if (place[name] + j) % self.part == 0 and not (self.fits and draw in HARD):
                    yield LieTrial(name, *draw, seed, int(self.fits))

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return what is found, by family and by kind of lie."""
        group = group_of(self.objects)
        rows = [row | {"family": group[row["shape"]]} for row in rows]
        return lie_tables(rows, list(self.objects))


class ExplorationPart(SeedsPart):
    """Coverage, ends and errors after some touches, by policy."""

    measure: Literal["exploration"]
    objects: dict[str, list[str]]
    touches: str
    experiment: ClassVar[Experiment] = EXPLORATION

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        """Yield the trials of a seed."""
        for _, name in interleaved(self.objects):
            yield ExplorationTrial(name, seed, self.touches)

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        """Return the measures of each policy, by group of objects and number of touches."""
        columns: list[Column] = [
            ("runs", lambda rows: str(len(rows))),
            ("surface covered", mean_cell("coverage", digits=2)),
            ("end [mm], median", median_cell("end", 1e3)),
            ("ends > 20 mm off [%]", mean_cell("far_off", 100.0, 0)),
            ("truth to estimate [mm]", mean_cell("rmsd_truth_to_estimate", 1e3)),
            ("estimate to truth [mm]", mean_cell("rmsd", 1e3)),
            ("probes", mean_cell("probes")),
            ("robot [s]", mean_cell("seconds")),
        ]
        title = "What is known after some touches"
        first = "objects | touches | policy"
        return [grouped_table("policies", title, first, self._groups(rows), columns)]

    def numbers(self, rows: Sequence[Row]) -> dict[str, float]:
        """Return the mean coverage and the robot's mean time [s] of each group."""
        return {
            " ".join(map(str, (*group, name))): float(values_of(of, name).mean())
            for group, of in self._groups(rows).items()
            for name in ("coverage", "seconds")
        }

    def _groups(self, rows: Sequence[Row]) -> dict[tuple[str, int, str], list[Row]]:
        """Return rows by group of objects, number of touches and policy."""
        group = group_of(self.objects)
        named = [row | {"group": group[row["object"]]} for row in rows]
        return split(named, "group", "count", "policy")


AnyPart = (
    GraspsPart
    | PaperPart
    | SurfacesPart
    | LiesPart
    | ExplorationPart
    | SimulatorsPart
    | CommandsPart
    | ServicePart
    | FitsPart
    | WorldsPart
    | TasksPart
    | SuctionPart
    | PlacingsPart
    | OutlinesPart
    | DosePart
    | ViewsPart
    | SurfacesTrack
    | LiftsTrack
    | PoliciesTrack
    | HandsTrack
)

KINDS: Mapping[str, type[Part]] = {
    str(kind.model_fields["measure"].annotation.__args__[0]): kind  # type: ignore[union-attr]
    for kind in AnyPart.__args__
}
"""The class of each part by what it measures."""
