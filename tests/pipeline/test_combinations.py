"""Every hand of the package with and without an arm, with both probers and two simulators.

`benchmarks/bench_combinations.py` runs all combinations. Here each two of their parts meet once.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import lis_grasp as lg
from lis_grasp.exceptions import LisGraspError
from lis_grasp.results.summary import LIFT_REASONS
from lis_grasp.robots.shipped_models import HAND_NAMES

ARMS, PROBERS = (None, "iiwa14"), ("dynamic", "kinematic")
SIMULATORS, OBJECTS = ("drake", "mujoco"), ("box", "cylinder")

PAIRWISE = [
    (hand, ARMS[j], PROBERS[j ^ (k & 1)], SIMULATORS[j ^ (k >> 1)], OBJECTS[j ^ (k & 1) ^ (k >> 1)])
    for k, hand in enumerate(HAND_NAMES)
    for j in range(2)
]


def test_each_two_parts_meet() -> None:
    for first in range(5):
        for second in range(first + 1, 5):
            met = {(row[first], row[second]) for row in PAIRWISE}
            assert len(met) == len({a for a, _ in met}) * len({b for _, b in met})


@pytest.mark.slow
@pytest.mark.parametrize(("hand", "arm", "prober", "simulator", "name"), PAIRWISE)
def test_a_combination_runs_or_says_before_the_first_touch_why_not(
    hand: str, arm: str | None, prober: str, simulator: str, name: str, tmp_path: Path
) -> None:
    if simulator == "mujoco":
        pytest.importorskip("mujoco")
    folder = tmp_path / "run"
    chosen = {"hand": hand, "arm": arm, "prober": prober, "simulator": simulator}
    run, refused = None, ""
    try:
        run = lg.run(name, folder=folder, touches=10, attempts=1, grasps=5, seed=1, **chosen)
    except LisGraspError as error:
        refused = str(error)
    if run is None:
        assert not (folder / "touches.jsonl").exists()
        assert "arm" in refused  # MuJoCo has none
        return
    assert len(run.contacts) >= 10
    assert run.report["lift"]["reason"] in LIFT_REASONS
    assert run.report["lift"]["reason"] not in {"diverged", "no_arm_motion"}
    assert (folder / "scene.html").stat().st_size > 100_000
