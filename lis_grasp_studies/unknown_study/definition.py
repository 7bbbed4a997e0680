"""Definition of the study of unknown objects, one file for each hand.

``python -m lis_grasp_studies.unknown_study.definition results/unknown`` writes the files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from lis_grasp.io.json_lines import Row
from lis_grasp.shapes import NAMES
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.study.trial import Setup, Trial
from lis_grasp_studies.test_objects.shape_sets import EVALUATION, TOOLS, Family

SCANS = (
    *("004_sugar_box.ply", "005_tomato_soup_can.ply", "006_mustard_bottle.ply"),
    *("010_potted_meat_can.ply", "061_foam_brick.ply", "077_rubiks_cube.ply"),
)
NOISE = "0.5mm/3deg"
SEEDS = {"allegro": [0, 1, 2, 3], "wsg50": [4, 5, 6], "leap": [7, 8, 9]}
ESTIMATORS = ("gpis", "lis", "blend", "truth")
TOUCHES = (10, 20, 40)
# Evaluation shapes of each family, in alphabetical order.
_FIRST: Mapping[Family, int] = {"prismatic": 4, "curved": 4, "organic": 4, "mixed": 4, "thin": 2}


def study_objects() -> list[str]:
    """Return the names of the forty objects, tools after the shapes of the families."""
    some = [
        name
        for family, count in _FIRST.items()
        for name in sorted(set(EVALUATION[family]) - set(TOOLS))[:count]
    ]
    return [*NAMES, *SCANS, *some, *TOOLS]


def study_facts(hand: str) -> dict[str, Any]:
    """Return the facts of the study with a hand."""
    return {
        "objects": study_objects(),
        "estimators": list(ESTIMATORS),
        "touches": list(TOUCHES),
        "noise": [NOISE],
        "hands": [hand],
        "seeds": SEEDS[hand],
        "conditions": "unknown",
        "prober": "dynamic",
        "grasps": 5,
    }


def study_trials(
    hand: str, seeds: Sequence[int], touches: int, meshes: Path, names: Sequence[str] | None = None
) -> list[Trial]:
    """Return the trials of a hand on the study's objects, or some; scans are files of `meshes`."""
    setup = Setup(prober="dynamic", conditions="unknown")
    places = [str(meshes / name) if name in SCANS else name for name in names or study_objects()]
    return [Trial(place, hand, touches, NOISE, seed, setup) for seed in seeds for place in places]


def study_rows(rows: Sequence[Row]) -> list[Row]:
    """Return those rows that are of the study, in its order; no model of a hand is needed."""
    orders = {"estimator": ESTIMATORS, "object": study_objects(), "touches": TOUCHES}

    def place(row: Row) -> tuple[int, ...]:
        estimator, number, touches = (values.index(row[n]) for n, values in orders.items())
        return estimator, row["seed"], number, touches

    members = [
        row
        for row in rows
        if row["object"] in orders["object"]
        and row["seed"] in SEEDS.get(row["hand"], ())
        and row.get("conditions") == "unknown"
    ]
    return sorted(members, key=place)


def main() -> None:
    """Write the files of the study to a folder."""
    folder = read_options(__doc__, folder=Path).folder
    folder.mkdir(parents=True, exist_ok=True)
    for hand in SEEDS:
        (folder / f"{hand}.yaml").write_text(yaml.safe_dump(study_facts(hand), sort_keys=False))


if __name__ == "__main__":
    main()
