"""Ablation: what each part of the package is worth if nothing is known of the object.

``python -m lis_grasp_studies.unknown_study.parts --meshes ycb`` continues where it stopped.

Conditions are the study's; the built-in shapes, the scans and the tools, `allegro`, 20 touches. All
variants get the same contacts. One grasp is executed, without a tactile check, unless the variant
has three attempts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp import Contacts, GraspSearch, Hand
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import Scenario
from lis_grasp.pipeline.regrasp import Stages, grasp_with_tactile_check
from lis_grasp.shapes import NAMES
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.statistics import clustered_p_value, objects_of
from lis_grasp_studies.harness.tables import NONE, Column, Table, grouped_table
from lis_grasp_studies.study.cells import Pairs, difference, gains, p_value, rows_of
from lis_grasp_studies.study.run import DRAKE, estimate, plan, scenario_at, touch
from lis_grasp_studies.study.trial import Trial, columns_of
from lis_grasp_studies.test_objects.shape_sets import TOOLS
from lis_grasp_studies.unknown_study.definition import SCANS, study_trials

HAND, TOUCHES = "allegro", 20
GROUPS = {"built-in shapes and scans": (*NAMES, *SCANS), "tools and flat things": TOOLS}
WHOLE = "whole pipeline"


@dataclass(frozen=True)
class Variant:
    """The pipeline, or the pipeline without one of its parts."""

    estimator: str = "blend"
    free_space: bool = True  # is removed from the estimate
    uncertainty: bool = True  # of the estimate counts in the ranking of grasps
    attempts: int = 1


VARIANTS: Mapping[str, Variant] = {
    WHOLE: Variant(),
    "without sharp patches (gpis)": Variant("gpis"),
    "without the smooth estimate (patch)": Variant("patch"),
    "without free space": Variant(free_space=False),
    "without uncertainty": Variant(uncertainty=False),
    "with three attempts": Variant(attempts=3),
}


@dataclass(frozen=True)
class _StagesOfVariant(Stages):
    """The stages without one part."""

    trial: Trial
    variant: Variant

    def estimate(self, scenario: Scenario, contacts: Contacts) -> trimesh.Trimesh:
        if not self.variant.free_space:
            contacts = replace(contacts, free_points=np.empty((0, 3)), free_radii=np.empty(0))
        mesh = estimate(self.trial, self.variant.estimator, contacts)
        if not self.variant.uncertainty:
            mesh.vertex_attributes.pop("uncertainty")
        return mesh

    def plan(self, scenario: Scenario, mesh: trimesh.Trimesh) -> GraspSearch:
        return plan(self.trial, mesh, scenario.truth.shape, scenario.known.hand)


def measure(trial: Trial, name: str) -> Row:
    """Return the outcome of a variant on the contacts of a trial, which `touch` makes once."""
    variant, touched = VARIANTS[name], touch(trial, trial.explorer("blend"))
    shape, hand = trial.find_object(), Hand.load(trial.hand)
    config = trial.run_config(hand=trial.hand, attempts=variant.attempts)

    scenario = scenario_at(config, shape, hand, touched.X_EO)
    attempts = list(
        grasp_with_tactile_check(scenario, touched.contacts, _StagesOfVariant(trial, variant))
    )
    outcome = attempts[-1].outcome
    return {
        **asdict(variant),
        "executed": len(attempts),
        "held": outcome is not None and bool(outcome.held),
        "reason": "no_grasp" if outcome is None else outcome.reason,
    }


PARTS = Experiment("parts", measure, columns_of, variant="variant", modules=(DRAKE,))
"""The experiment of this file."""


def parts_table(rows: Sequence[Row], group: str) -> Table:
    """Return the rate of each variant on a group of objects, and its difference from the whole."""
    rows = [row for row in rows if row["object"] in GROUPS[group]]
    whole = {(row["object"], row["seed"]): row for row in rows if row["variant"] == WHOLE}
    pairs = [
        (row, whole[place]) for row in rows if (place := (row["object"], row["seed"])) in whole
    ]

    def against_whole(pairs: Pairs) -> tuple[str, str]:
        if pairs[0][0]["variant"] == WHOLE:
            return NONE, NONE
        p = clustered_p_value(gains(pairs), objects_of(rows_of(pairs)))
        return difference(pairs, over_objects=True), p_value(p)

    columns: list[Column] = [
        ("trials", lambda pairs: str(len(pairs))),
        ("held [%]", lambda pairs: f"{100.0 * np.mean([row['held'] for row, _ in pairs]):.0f}"),
        ("minus the whole pipeline [points]", lambda pairs: against_whole(pairs)[0]),
        ("p", lambda pairs: against_whole(pairs)[1]),
    ]
    groups = {name: [pair for pair in pairs if pair[0]["variant"] == name] for name in VARIANTS}
    return grouped_table("parts", "What each part is worth", group, groups, columns)


def main() -> None:
    """Run the trials that are missing, and print the tables."""
    options = read_options(
        __doc__, meshes=Path("ycb"), seeds=10, jobs=2, output=Path("results/unknown/parts.jsonl")
    )
    names = [name for group in GROUPS.values() for name in group]
    trials = study_trials(HAND, range(options.seeds), TOUCHES, options.meshes, names)
    rows = PARTS.complete(trials, list(VARIANTS), options.output, jobs=options.jobs)
    print("\n".join(parts_table(rows, group).markdown() for group in GROUPS))


if __name__ == "__main__":
    main()
