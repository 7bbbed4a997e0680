"""DexGraspBench's protocol: a firm grasp passes both tests, a weak or wrong one does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from made_grasps import jaw_grasp

from lis_grasp.robots.hand import Hand

pytest.importorskip("mujoco", reason="MuJoCo is not installed: bootstrap.sh mujoco")

from lis_grasp.simulation.mujoco.dexgraspbench_protocol import (
    FRICTION,
    MASS,
    ProtocolOutcome,
    dexgraspbench_protocol,
)

BOX = trimesh.creation.box((0.05, 0.05, 0.08))


def test_a_firm_grasp_passes_both_tests() -> None:
    hand = Hand.load("wsg50")
    grasp = jaw_grasp(hand, np.zeros(3), 0.05)
    outcome = dexgraspbench_protocol(hand, grasp, [BOX], -0.04)
    assert outcome == ProtocolOutcome(table_lift=True, force_test=True)


@pytest.mark.by_default("0.7-False")
@pytest.mark.parametrize(("part", "passes"), [(1.3, True), (0.7, False)])
def test_the_least_squeeze_is_that_of_coulomb_s_law(part: float, passes: bool) -> None:
    hand = Hand.load("wsg50")
    grasp = jaw_grasp(hand, np.zeros(3), 0.05)
    least = MASS * 10.0 / (2.0 * FRICTION)  # normal force of each of two jaws [N]
    grasp = replace(grasp, contact_forces=-part * least * grasp.contact_normals)
    outcome = dexgraspbench_protocol(hand, grasp, [BOX], -0.04)
    assert outcome.table_lift == passes
    assert outcome.force_test == passes


def test_jaws_that_start_inside_the_object_fail() -> None:
    hand = Hand.load("wsg50")
    grasp = jaw_grasp(hand, np.zeros(3), 0.05)
    grasp = replace(grasp, pregrasp_positions=np.full(2, 0.01))
    outcome = dexgraspbench_protocol(hand, grasp, [BOX], -0.04)
    assert outcome == ProtocolOutcome(table_lift=False, force_test=False)
