"""Write the files of the study of unknown objects, one for each hand; see plan.md.

python docs/study/write_studies.py results/unknown
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from lis_grasp.shapes import NAMES
from lis_grasp_studies.study.trial import Setup, Trial
from lis_grasp_studies.test_objects.shape_sets import EVALUATION, TOOLS

SCANS = (
    *("004_sugar_box.ply", "005_tomato_soup_can.ply", "006_mustard_bottle.ply"),
    *("010_potted_meat_can.ply", "061_foam_brick.ply", "077_rubiks_cube.ply"),
)
NOISE = "0.5mm/3deg"
SEEDS = {"allegro": [0, 1, 2, 3], "wsg50": [4, 5, 6], "leap": [7, 8, 9]}
# Evaluation shapes of each family, in alphabetical order.
FIRST = {"prismatic": 4, "curved": 4, "organic": 4, "mixed": 4, "thin": 2}


def objects() -> list[str]:
    """Return the names of the forty objects, tools after the shapes of the families."""
    some = [
        name
        for family, count in FIRST.items()
        for name in sorted(set(EVALUATION[family]) - set(TOOLS))[:count]
    ]
    return [*NAMES, *SCANS, *some, *TOOLS]


def facts_of(hand: str) -> dict[str, Any]:
    """Return the facts of the study with a hand."""
    return {
        "objects": objects(),
        "estimators": ["gpis", "lis", "blend", "truth"],
        "touches": [10, 20, 40],
        "noise": [NOISE],
        "hands": [hand],
        "seeds": SEEDS[hand],
        "conditions": "unknown",
        "prober": "dynamic",
        "grasps": 5,
    }


def trials_of(
    hand: str, seeds: Sequence[int], touches: int, meshes: Path, names: Sequence[str] | None = None
) -> list[Trial]:
    """Return the trials of a hand on the study's objects, or some; scans are files of `meshes`."""
    setup = Setup(prober="dynamic", conditions="unknown")
    places = [str(meshes / name) if name in SCANS else name for name in names or objects()]
    return [Trial(place, hand, touches, NOISE, seed, setup) for seed in seeds for place in places]


def main() -> None:
    """Write the files to a folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for hand in SEEDS:
        (folder / f"{hand}.yaml").write_text(yaml.safe_dump(facts_of(hand), sort_keys=False))


if __name__ == "__main__":
    main()
