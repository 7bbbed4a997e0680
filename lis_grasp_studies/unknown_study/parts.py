"""Ablation: what each part of the package is worth if nothing is known of the object.

All variants get the same contacts. One grasp is executed, without a tactile check, unless the
variant has three attempts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import trimesh

from lis_grasp import Contacts, Hand
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import Scenario
from lis_grasp.pipeline.regrasp import grasp_with_tactile_check
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.statistics import clustered_p_value, objects_of
from lis_grasp_studies.harness.tables import NONE, Column, Table, grouped_table
from lis_grasp_studies.study.cells import Pairs, difference, gains, p_value, rows_of
from lis_grasp_studies.study.run import DRAKE, TrialStages, scenario_at, touch
from lis_grasp_studies.study.trial import Trial, columns_of

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
class _StagesOfVariant(TrialStages):
    """The stages without one part."""

    variant: Variant

    def estimate(self, scenario: Scenario, contacts: Contacts) -> trimesh.Trimesh:
        if not self.variant.free_space:
            contacts = replace(contacts, free_points=np.empty((0, 3)), free_radii=np.empty(0))
        mesh = super().estimate(scenario, contacts)
        if not self.variant.uncertainty:
            mesh.vertex_attributes.pop("uncertainty")
        return mesh


def measure(trial: Trial, name: str) -> Row:
    """Return the outcome of a variant on the contacts of a trial, which `touch` makes once."""
    variant, touched = VARIANTS[name], touch(trial, trial.explorer("blend"))
    shape, hand = trial.find_object(), Hand.load(trial.hand)
    config = trial.run_config(hand=trial.hand, attempts=variant.attempts)

    scenario = scenario_at(config, shape, hand, touched.X_EO)
    stages = _StagesOfVariant(trial, variant.estimator, variant)
    attempts = list(grasp_with_tactile_check(scenario, touched.contacts, stages))
    outcome = attempts[-1].outcome
    return {
        **asdict(variant),
        "executed": len(attempts),
        "held": outcome is not None and bool(outcome.held),
        "reason": "no_grasp" if outcome is None else outcome.reason,
    }


PARTS = Experiment("parts", measure, columns_of, variant="variant", modules=(DRAKE,))
"""The experiment of this file."""


def parts_table(rows: Sequence[Row], group: str, objects: Sequence[str]) -> Table:
    """Return the rate of each variant on a group of objects, and its difference from the whole."""
    rows = [row for row in rows if row["object"] in objects]
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
