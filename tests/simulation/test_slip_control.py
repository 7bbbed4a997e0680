"""Grip force under slip: an object heavier or smoother than assumed."""

from functools import cache

import numpy as np
import pytest
import scenes

from lis_grasp import Hand, pipeline, shapes
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.hand_capacity import balanced_grip
from lis_grasp.lifting.finger_control import balanced_forces
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.simulation.drake.lift import simulate_lift

BOX = shapes.build("box")
JAW = Hand.load("wsg50")
SUPPORT = float(BOX.mesh.bounds[0, 2])


@cache
def _grasp() -> Grasp:
    known = scenes.scenario(BOX, JAW, grasps=3).agent
    return pipeline.plan(known, BOX.mesh).grasps[0]


def _lift(*, mass: float, friction: float, careful: bool, assumed: bool = True) -> LiftOutcome:
    """Lift a box that the robot believes to weigh 0.1 kg, with friction 0.8."""
    options = LiftOptions(assumed_friction=0.8, assumed_mass=0.1) if assumed else LiftOptions()
    setup = LiftSetup(BOX.mesh, JAW, _grasp(), SUPPORT, mass, friction, options)
    return simulate_lift(setup, (lambda contacts: True) if careful else None)


@pytest.mark.slow
def test_a_heavy_smooth_box_is_held_because_slip_raises_the_grip() -> None:
    raised = _lift(mass=0.5, friction=0.3, careful=False)
    assert raised.held
    assert raised.slip < 0.005


@pytest.mark.slow
def test_an_object_that_keeps_slipping_is_set_down_where_it_was() -> None:
    outcome = _lift(mass=3.0, friction=0.2, careful=True)
    assert outcome.reason == "set_down"
    assert not outcome.lifted
    assert not outcome.held
    assert 0.003 < outcome.slip < 0.02
    # It stands on the table again, within the slip of its place.
    assert abs(outcome.X_WO[2, 3]) < 1e-3
    assert outcome.X_WO[2, 2] > 0.99
    assert np.linalg.norm(outcome.X_WO[:2, 3]) < 0.02


@pytest.mark.slow
def test_an_object_too_heavy_for_the_grip_is_set_down_unless_it_was_known() -> None:
    unknown, known = (
        _lift(mass=1.7, friction=0.8, careful=True, assumed=assumed) for assumed in (True, False)
    )
    assert unknown.reason == "set_down"
    assert np.linalg.norm(unknown.X_WO[:3, 3]) < 0.02
    assert known.lifted or known.reason != "set_down"
    # Both weigh it. The gripper exerts at most 80 N; 1.7 kg in a shake of 1 g need as much more as
    # the grasp carries less per newton.
    needed = 1.7 * (9.81 + 9.81) / _grasp().quality["load_per_grip"]
    for outcome in (unknown, known):
        assert outcome.weighed == pytest.approx(1.7, rel=0.02)
        assert outcome.grip_margin is not None
        assert 0.0 < outcome.grip_margin < 80.0 / needed


@pytest.mark.slow
def test_a_known_load_needs_no_reaction() -> None:
    outcome = _lift(mass=0.2, friction=0.8, careful=True, assumed=False)
    assert outcome.held
    assert outcome.slip < 0.002


@pytest.mark.slow
def test_fingers_carry_the_weight_and_do_not_sag() -> None:
    hand, mass = Hand.load("allegro"), 0.5
    search = pipeline.plan(scenes.scenario(BOX, hand, mass=mass, grasps=3).agent, BOX.mesh)
    outcome = simulate_lift(LiftSetup(BOX.mesh, hand, search.grasps[0], SUPPORT, mass))
    assert outcome.held
    # The springs of the fingers alone would yield by about 10 mm.
    assert outcome.slip < 0.004


def test_fingers_that_can_only_add_to_the_load_still_squeeze():
    # One finger above an object of 2 kg: each push of it adds to the weight.
    points, normals = np.array([[0.0, 0.0, 0.05]]), np.array([[0.0, 0.0, 1.0]])
    weight, center = np.array([0.0, 0.0, -20.0]), np.zeros(3)
    assert not balanced_grip(points, normals, friction=0.5, total=1.0, load=(weight, center)).any()
    forces = balanced_forces(points, normals, 0.5, 1.0, (weight, center))
    assert forces == pytest.approx(np.array([[0.0, 0.0, -1.0]]), abs=1e-6)
