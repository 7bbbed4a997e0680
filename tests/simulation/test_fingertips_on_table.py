"""Lifts of low objects with fingertips that slide on the table, in both simulators."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from lis_grasp import ForceClosureSampler, Grasp, Hand
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.trial import LiftTrial
from lis_grasp.simulation.drake.lift import LiftScene

pytest.importorskip("mujoco", reason="MuJoCo is not installed: bootstrap.sh mujoco")
pytest.importorskip("coacd", reason="CoACD is not installed: bootstrap.sh mujoco")

from mujoco import mj_mulM

from lis_grasp.simulation.mujoco.convex_pieces import convex_pieces
from lis_grasp.simulation.mujoco.lift import MujocoScene

HAND = Hand.load("allegro")
STRIP = trimesh.creation.box((0.15, 0.03, 0.004))
STRIP.apply_translation([0.0, 0.0, 0.002])
SCENES = {
    "drake": LiftScene,
    "mujoco": lambda setup: MujocoScene(setup, convex_pieces(setup.mesh)),
}


@pytest.fixture(scope="module")
def grasp() -> Grasp:
    sampler = ForceClosureSampler(HAND, mass=0.1, friction=0.8)
    return sampler.sample(STRIP, rng=1, support_height=0.0, count=3).best


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.0, 0.0007])
@pytest.mark.parametrize("simulator", SCENES)
def test_fingertips_feel_the_table_and_lift_a_strip_of_4_mm(
    grasp: Grasp, simulator: str, off: float
) -> None:
    """The table is where it was planned, or lower by less than the guarded descent goes on."""
    X_OH, points = grasp.X_OH.copy(), grasp.contact_points + [0.0, 0.0, off]
    X_OH[2, 3] += off
    setup = LiftSetup(STRIP, HAND, replace(grasp, X_OH=X_OH, contact_points=points), 0.0, 0.1, 0.8)
    assert setup.slides_on_table
    assert grasp.family == "table"
    scene = SCENES[simulator](setup)
    forces = _record_forces(scene)
    assert LiftTrial(scene, setup, None).run().held
    # The palm yields from 2 N on, a command of 10 ms later: the hand of 1.1 kg has an impulse of
    # 0.01 N s at 8 mm/s, which MuJoCo's stiff contact of 2 ms takes with 5 N more.
    assert max(forces) <= 8.0
    assert max(forces) >= 0.3 or off > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("simulator", SCENES)
def test_thick_fingertips_hold_a_slab_at_its_edges_in_small_steps(simulator: str) -> None:
    """In Drake's steps of 5 ms they creep off after 11 s: friction slips by the step."""
    hand = Hand.load("barrett")
    slab = trimesh.creation.box((0.16, 0.07, 0.01))
    sampler = ForceClosureSampler(hand, mass=0.1, friction=0.8)
    grasp = sampler.sample(slab, rng=1, support_height=-0.005, count=3).best
    setup = LiftSetup(slab, hand, grasp, -0.005, 0.1, 0.8, LiftOptions(time_step=0.0025))
    outcome = LiftTrial(SCENES[simulator](setup), setup, None).run()
    assert outcome.held
    assert outcome.turn < np.deg2rad(5.0)


@pytest.mark.slow
def test_fingers_have_the_inertia_of_links_and_motors_in_both_simulators(grasp: Grasp) -> None:
    setup = LiftSetup(STRIP, HAND, grasp, 0.0, 0.1, 0.8)
    drake, mujoco = LiftScene(setup), MujocoScene(setup, convex_pieces(STRIP))
    plant = drake._scene.plant
    joints = [joint.velocity_start() for joint in drake._hand.joints]
    for scene in (drake, mujoco):
        scene.place_hand(np.zeros(6), grasp.joint_positions)
    of_drake = plant.CalcMassMatrix(drake._scene.context)
    moved = [mujoco._model.joint(f"hand/{name}").dofadr[0] for name in HAND.joint_names]
    unit, column = np.eye(mujoco._model.nv), np.zeros(mujoco._model.nv)
    found = np.zeros((len(moved), len(moved)))
    for k, joint in enumerate(moved):
        mj_mulM(mujoco._model, mujoco._data, column, unit[joint])
        found[:, k] = column[moved]
    np.testing.assert_allclose(found, of_drake[np.ix_(joints, joints)], rtol=1e-6, atol=1e-9)
    assert found.diagonal().min() > 1e-3  # that of the motors


def _record_forces(scene: LiftScene | MujocoScene) -> list[float]:
    forces, step = [0.0], scene.step

    def recorded() -> None:
        step()
        forces.append(-sum(contact.force[2] for contact in scene.contacts("table")))

    scene.step = recorded  # type: ignore[method-assign]
    return forces


@pytest.mark.slow
def test_a_grasp_high_above_the_table_needs_no_guarded_descent(grasp: Grasp) -> None:
    assert not LiftSetup(STRIP, HAND, grasp, -0.01).slides_on_table
