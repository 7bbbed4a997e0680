"""Lifts beside other bodies: no force on them, or a stop that counts as failed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from worlds import blocks

from lis_grasp import shapes
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.lifting import LiftOptions, LiftSetup
from lis_grasp.lifting.outcome import LARGEST_FORCE_BESIDE
from lis_grasp.lifting.planned_lifts import choose_lift, permitted_lifts
from lis_grasp.lifting.scene import BodyHitError
from lis_grasp.lifting.trial import LiftTrial
from lis_grasp.motion import OBJECT, beside_body
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.lift import simulate_lift
from lis_grasp.world import ALONE, Body, Surroundings

BOX = shapes.build("box").mesh  # 84 x 60 x 120 mm about the origin
TABLE = float(BOX.bounds[0, 2])
HAND = Hand.load("wsg50")
SIMULATORS = ("drake", "mujoco")
NEAR = blocks(0.01, table=TABLE)  # free, 10 mm beside the box


def simulator(name: str) -> Callable[..., Any]:
    if name == "drake":
        return simulate_lift
    pytest.importorskip("mujoco")
    from lis_grasp.simulation.mujoco.lift import simulate_in_mujoco

    return simulate_in_mujoco


@cache
def best(surroundings: Surroundings) -> Grasp:
    sampler = ForceClosureSampler(
        HAND, candidates=400, surroundings=surroundings, lifts=permitted_lifts(LiftOptions())
    )
    return sampler.sample(BOX, support_height=TABLE, count=2).best


def setup(surroundings: Surroundings, *, known: Surroundings) -> LiftSetup:
    grasp = best(known)
    options = choose_lift(LiftOptions(), HAND, grasp, BOX, known, support_height=TABLE)
    return LiftSetup(BOX, HAND, grasp, TABLE, options=options, surroundings=surroundings)


def wall(gap: float) -> Surroundings:
    x = float(BOX.bounds[1, 0]) + gap + 0.01
    return Surroundings((Body.box("wall", (0.02, 0.6, 0.15), (x, 0.0, TABLE + 0.075)),))


@pytest.mark.by_default("wall-mujoco")
@pytest.mark.parametrize("name", SIMULATORS)
@pytest.mark.parametrize("bodies", [wall(0.005), NEAR], ids=["wall", "free boxes"])
def test_a_planned_lift_is_held_without_a_force_on_bodies(bodies: Surroundings, name: str) -> None:
    outcome = simulator(name)(setup(bodies, known=bodies))
    assert outcome.held
    assert max(outcome.forces.values(), default=0.0) <= LARGEST_FORCE_BESIDE
    for body in bodies.free:
        # They sink into their soft ground, by less than the 0.1 mm that a second of rest may move.
        assert np.abs(outcome.X_EB[body.name] - body.X_EB).max() < 1e-4
        assert len(outcome.motion.poses[beside_body(body.name)]) == len(outcome.motion)


@pytest.mark.by_default("free boxes-drake", "free boxes-mujoco")
@pytest.mark.parametrize("name", SIMULATORS)
@pytest.mark.parametrize("bodies", [wall(0.005), NEAR], ids=["wall", "free boxes"])
def test_a_lift_that_ignores_bodies_stops_at_them_and_is_not_held(
    bodies: Surroundings, name: str
) -> None:
    outcome = simulator(name)(setup(bodies, known=ALONE))
    assert outcome.reason == "hit_body"
    assert not outcome.held
    assert max(outcome.forces.values()) > LARGEST_FORCE_BESIDE
    assert outcome.forces.keys() <= {body.name for body in bodies}
    assert outcome.X_EB.keys() == {body.name for body in bodies.free}
    recorded = {name for name in outcome.motion.poses if name.startswith(beside_body(""))}
    assert recorded == set(map(beside_body, outcome.X_EB))
    for name, X_EB in outcome.X_EB.items():
        # The motion ends with a frame, a few steps before the end of the trial.
        assert np.abs(outcome.motion.poses[beside_body(name)][-1] - X_EB).max() < 0.01


def test_a_carried_object_that_strikes_a_board_is_not_held() -> None:
    top = float(BOX.bounds[1, 2])
    grasp = best(ALONE)
    # Small enough to be beside the hand: only the box in it meets the board.
    board = Surroundings((Body.box("board", (0.01, 0.01, 0.02), (0.036, 0.024, top + 0.06)),))
    outcome = simulate_lift(LiftSetup(BOX, HAND, grasp, TABLE, surroundings=board))
    assert outcome.reason == "hit_body"
    assert outcome.closed
    assert not outcome.held
    assert outcome.forces["board"] > LARGEST_FORCE_BESIDE


def test_a_hand_with_a_tactile_check_retreats_from_a_body_that_it_hit() -> None:
    planned = setup(NEAR, known=ALONE)
    outcome = simulate_lift(planned, lambda contacts: True)
    assert outcome.reason == "hit_body"
    start = np.array(planned.grasp.X_OH)[:3, 3]
    back = start - planned.options.standoff * np.asarray(planned.grasp.approach_O)
    palm = outcome.motion.poses[HAND.base_link][-1] @ HAND.X_LH
    # The wrist's controller is 10 mm off at the most, as in an approach without collision.
    assert np.linalg.norm(palm[:3, 3] - back) < planned.options.largest_push


def test_a_body_that_is_hit_while_the_hand_lets_go_ends_that(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a slippery box the lift fails first; then the retreat meets a body."""

    def hit(trial: LiftTrial) -> None:
        raise BodyHitError

    planned = replace(setup(ALONE, known=ALONE), friction=0.02)
    assert simulate_lift(planned, lambda contacts: True).reason not in ("held", "hit_body")
    monkeypatch.setattr(LiftTrial, "_retreat_without_object", hit)
    outcome = simulate_lift(planned, lambda contacts: True)
    assert outcome.reason == "hit_body"
    poses = outcome.motion.poses[OBJECT]
    assert np.abs(poses[-1] - poses[-2]).max() < 1e-4  # the object has come to rest


@pytest.mark.slow
def test_a_far_body_changes_no_outcome() -> None:
    far = Surroundings((Body.box("far", (0.1, 0.1, 0.1), (0.6, 0.6, TABLE + 0.05)),))
    alone, beside = (simulate_lift(setup(bodies, known=ALONE)) for bodies in (ALONE, far))
    assert beside.held == alone.held
    assert not beside.forces
    # Another body reorders the solver's sums: rounding, far below a micrometre.
    assert beside.slip == pytest.approx(alone.slip, abs=1e-6)
