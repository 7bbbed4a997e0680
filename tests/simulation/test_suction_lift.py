"""Lifts with a suction cup in both simulators: pull, seals by the true object, what breaks them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import trimesh

from lis_grasp import Grasp, Hand
from lis_grasp.grasping.suction import SuctionSampler
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.scene import HandContact, LiftingScene
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.trial import LiftTrial
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.simulation.drake.lift import LiftScene, simulate_lift

HAND = Hand.load("cup")


def placed_box(sides: list[float], center: list[float]) -> trimesh.Trimesh:
    box = trimesh.creation.box(sides)
    box.apply_translation(center)
    return box


BLOCK = trimesh.creation.box([0.06, 0.06, 0.04])  # its top is at 0.02 m
CUP = HAND.pads[0].cup
assert CUP is not None
SHORT = LiftOptions(shake_accelerations=(4.905,), hold_time=0.5)

Simulate = Callable[..., LiftOutcome]
# The block with a groove under the lip, and with one half lower, as convex pieces.
GROOVED = [
    placed_box([0.028, 0.06, 0.005], [-0.016, 0.0, 0.0175]),
    placed_box([0.028, 0.06, 0.005], [0.016, 0.0, 0.0175]),
    placed_box([0.06, 0.06, 0.035], [0.0, 0.0, -0.0025]),
]
STEPPED = [GROOVED[2], placed_box([0.03, 0.06, 0.005], [-0.015, 0.0, 0.0175])]


def in_drake(setup: LiftSetup, pieces: Sequence[trimesh.Trimesh]) -> LiftOutcome:
    return simulate_lift(setup)


def in_mujoco(setup: LiftSetup, pieces: Sequence[trimesh.Trimesh]) -> LiftOutcome:
    pytest.importorskip("mujoco")
    from lis_grasp.simulation.mujoco.lift import MujocoScene

    return LiftTrial(MujocoScene(setup, pieces), setup, None).run()


SIMULATORS = [in_drake, in_mujoco]


@lru_cache
def from_above() -> Grasp:
    """Return a grasp on the middle of the block's top."""
    found = SuctionSampler(HAND, candidates=50).sample(BLOCK, support_height=-0.02, count=50)
    grasp = next(grasp for grasp in found if grasp.contact_normals[0, 2] > 0.99)
    moved = np.array([0.0, 0.0, 0.02]) - grasp.contact_points[0]
    X_OH = grasp.X_OH.copy()
    X_OH[:3, 3] += moved
    return replace(grasp, X_OH=X_OH, contact_points=grasp.contact_points + moved)


def lifted(simulate: Simulate, pieces: Sequence[trimesh.Trimesh], mass: float) -> LiftOutcome:
    true = trimesh.boolean.union(pieces, engine="manifold")
    return simulate(LiftSetup(true, HAND, from_above(), -0.02, mass, 0.8, SHORT), pieces)


@pytest.mark.parametrize("kind", ["drake", "mujoco"])
def test_a_pull_lifts_a_free_object_with_the_force_less_its_weight(kind: str) -> None:
    setup = LiftSetup(BLOCK, HAND, from_above(), -0.02, 0.2, 0.8)
    scene: LiftingScene
    if kind == "drake":
        scene = LiftScene(setup)
    else:
        pytest.importorskip("mujoco")
        from lis_grasp.simulation.mujoco.lift import MujocoScene

        scene = MujocoScene(setup, [BLOCK])
    scene.place_hand(np.array([0.3, 0.0, 0.3, 0.0, 0.0, 0.0]), np.zeros(3))
    force, steps = 5.0, 20
    up = np.array([0.0, 0.0, 1.0])
    start = scene.X_WO[2, 3]
    scene.pull(HandContact("lip", scene.X_WO[:3, 3], up, force * up))
    for _ in range(steps):
        scene.step()
    acceleration = force / 0.2 - GRAVITY
    time = steps * setup.options.time_step
    # The table, pressed in by some 10 um, and the integrator's first step add a few per cent.
    assert scene.X_WO[2, 3] - start == pytest.approx(0.5 * acceleration * time**2, rel=0.12)
    assert sum(contact.force[2] for contact in scene.contacts()) == pytest.approx(force)
    scene.pull(None)
    assert not scene.contacts()


@pytest.mark.parametrize("simulate", SIMULATORS)
def test_a_groove_under_the_lip_that_nobody_knew_lets_no_vacuum_build_up(
    simulate: Simulate,
) -> None:
    outcome = lifted(simulate, GROOVED, 0.2)
    assert (outcome.reason, outcome.closed, outcome.lifted) == ("no_seal", True, False)


@pytest.mark.slow
@pytest.mark.parametrize("simulate", SIMULATORS)
@pytest.mark.parametrize(
    ("share", "lifts"),
    [pytest.param(0.8, True, id="0.8 of the pull"), pytest.param(1.1, False, id="1.1 of the pull")],
)
def test_a_cup_lifts_what_weighs_less_than_its_pull(
    simulate: Simulate, share: float, lifts: bool
) -> None:
    outcome = lifted(simulate, [BLOCK], share * CUP.pull / GRAVITY)
    assert outcome.lifted is lifts
    if not lifts:
        assert outcome.reason == "pulled_off"


@pytest.mark.slow
@pytest.mark.parametrize("simulate", SIMULATORS)
def test_a_light_block_is_weighed_held_and_hardly_slips(simulate: Simulate) -> None:
    outcome = lifted(simulate, [BLOCK], 0.15)
    assert outcome.held
    assert outcome.weighed == pytest.approx(0.15, rel=0.05)
    assert outcome.slip < 0.005


@pytest.mark.slow
def test_a_cup_without_a_seal_lets_go_gently_if_the_grasp_is_tested() -> None:
    true = trimesh.boolean.union(STEPPED, engine="manifold")
    setup = LiftSetup(true, HAND, from_above(), -0.02, 0.2, 0.8, SHORT)
    outcome = simulate_lift(setup, lambda measured: True)
    assert outcome.reason == "aborted"
    assert len(outcome.measured_contacts) == 1
    assert outcome.measured_contacts.points[0, 0] < 0.0  # of the half that is there
    np.testing.assert_allclose(outcome.X_WO, np.eye(4), atol=2e-3)
