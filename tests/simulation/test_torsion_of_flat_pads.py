"""How hard two flat pads resist turning in each simulator, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import scenes
import trimesh
from made_grasps import jaw_grasp

from lis_grasp import pipeline
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape

BAR = Shape.from_mesh(trimesh.creation.box((0.05, 0.4, 0.03)), "bar")
AREA = np.array([0.0215, 0.03])  # of contact [m]: the finger's width, and the bar's height
MASS, FRICTION, SLOW_LIFT = 0.1, 0.8, 0.577  # [kg], -, largest acceleration [m/s^2]
OPTIONS = LiftOptions(hold_time=1.0, lift_time=1.0, shake_accelerations=(), largest_turn=np.pi)

GRID = np.stack(np.meshgrid(*(side * (np.arange(200) + 0.5) / 200 - side / 2 for side in AREA)))
EVEN_PRESSURE = float(np.linalg.norm(GRID, axis=0).mean())  # mean distance from the middle [m]
CORNERS = 0.5 * float(np.hypot(*AREA)) + 0.0017  # MuJoCo's points also resist by themselves


@pytest.mark.slow
@pytest.mark.parametrize(("simulator", "radius"), [("drake", EVEN_PRESSURE), ("mujoco", CORNERS)])
def test_a_bar_turns_between_flat_pads_at_the_limit_of_friction(
    simulator: str, radius: float
) -> None:
    # m (g + a) d = 2 mu N r: each pad presses with half of the grip force.
    if simulator == "mujoco":
        pytest.importorskip("mujoco", reason="MuJoCo is not installed: bootstrap.sh mujoco")
    hand = Hand.load("wsg50")

    def turn(offset: float) -> float:
        grasp = jaw_grasp(hand, np.array([0.0, offset, 0.0]), 0.05)
        conditions = {"mass": MASS, "friction": FRICTION, "simulator": simulator}
        scenario = scenes.scenario(BAR, hand, **conditions)
        return pipeline.lift(scenario, grasp, options=OPTIONS).turn

    setup = LiftSetup(
        BAR.mesh, hand, jaw_grasp(hand, np.zeros(3), 0.05), 0.0, MASS, FRICTION, OPTIONS, np.eye(4)
    )
    limit = FRICTION * setup.grip_force(MASS) * radius / (MASS * (9.81 + SLOW_LIFT))
    assert turn(0.85 * limit) < np.deg2rad(5.0)
    assert turn(1.15 * limit) > np.deg2rad(10.0)
