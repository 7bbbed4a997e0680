"""Lifts in MuJoCo: good grasps hold, bad ones fail with the right reason, repeatably."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import trimesh
from made_grasps import jaw_grasp

from lis_grasp import pipeline
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.motion import OBJECT
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.stages.lift import require_simulator

NEEDS_MUJOCO = "MuJoCo is not installed: bootstrap.sh mujoco"
SHORT = LiftOptions(hold_time=0.5, lift_time=0.6, shake_accelerations=(9.81,))
QUICK = LiftOptions(hold_time=0.01, lift_time=0.3, shake_accelerations=())
BOX = Shape.from_mesh(trimesh.creation.box((0.05, 0.07, 0.10)), "box")
RING = Shape.from_mesh(
    trimesh.creation.annulus(r_min=0.015, r_max=0.025, height=0.08, sections=12), "ring"
)


def lift_by_jaws(
    shape: Shape,
    X_EO: np.ndarray | None = None,
    accept_grasp: AcceptGrasp | None = None,
    **options: Any,
) -> LiftOutcome:
    """Lift with parallel jaws from above, across the object's width of 5 cm."""
    pytest.importorskip("mujoco", reason=NEEDS_MUJOCO)
    pytest.importorskip("coacd", reason=NEEDS_MUJOCO)
    hand = Hand.load("wsg50")
    grasp = jaw_grasp(hand, np.array([0.0, 0.0, 0.01]), 0.05)
    scenario = scenes.scenario(shape, hand, X_EO, simulator="mujoco", **options)
    return pipeline.lift(scenario, grasp, accept_grasp=accept_grasp, options=QUICK)


@pytest.mark.parametrize("shape", [BOX, pytest.param(RING, marks=pytest.mark.slow)])
def test_jaws_lift_a_box_and_an_object_with_a_hole(shape: Shape) -> None:
    outcome = lift_by_jaws(shape)
    assert outcome.reason == "held"
    assert outcome.lifted
    assert outcome.slip < 2e-3
    assert set(outcome.measured_contacts.fingers or ()) == {"left", "right"}
    assert np.abs(outcome.measured_contacts.points[:, 0]) == pytest.approx(0.025, abs=1e-3)


def test_an_object_is_not_lifted_with_less_friction_than_its_weight_needs() -> None:
    # 0.02 of at most 80 N carry 0.16 kg, not 0.5.
    outcome = lift_by_jaws(BOX, mass=0.5, friction=0.02)
    assert outcome.reason == "not_lifted"
    assert not outcome.lifted


def test_a_rejected_grasp_opens_and_leaves_the_object() -> None:
    outcome = lift_by_jaws(BOX, accept_grasp=lambda contacts: len(contacts) == 0)
    assert outcome.reason == "aborted"
    assert pytest.approx(np.eye(4), abs=2e-3) == outcome.X_WO


def test_a_displaced_object_is_found_where_it_is() -> None:
    X_WO = np.eye(4)
    X_WO[1, 3] = 0.005
    outcome = lift_by_jaws(BOX, X_WO)
    assert outcome.motion.poses[OBJECT][0] == pytest.approx(X_WO, abs=1e-9)
    assert outcome.held


@pytest.mark.slow
def test_a_lift_repeats_exactly() -> None:
    first, second = lift_by_jaws(RING), lift_by_jaws(RING)
    for name, poses in first.motion.poses.items():
        assert (poses == second.motion.poses[name]).all()
    assert (first.measured_contacts.points == second.measured_contacts.points).all()


@pytest.mark.slow
def test_an_object_far_from_its_frame_is_lifted_alike() -> None:
    far = np.array([0.4, -0.3, 0.2])
    shape = Shape.from_mesh(BOX.mesh.copy().apply_translation(far), "far")
    hand = Hand.load("wsg50")
    pytest.importorskip("mujoco", reason=NEEDS_MUJOCO)
    grasp = jaw_grasp(hand, np.array([0.0, 0.0, 0.01]) + far, 0.05)
    scenario = scenes.scenario(shape, hand, simulator="mujoco")
    outcome = pipeline.lift(scenario, grasp, options=QUICK)
    assert outcome.held
    assert outcome.slip == pytest.approx(lift_by_jaws(BOX).slip, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["allegro", "barrett"])
def test_a_planned_grasp_survives_the_shakes_in_both_simulators(name: str) -> None:
    pytest.importorskip("mujoco", reason=NEEDS_MUJOCO)
    hand = Hand.load(name)
    search = ForceClosureSampler(hand).sample(
        BOX.mesh, rng=np.random.default_rng(0), support_height=-0.05, count=1
    )
    for simulator in ("drake", "mujoco"):
        scenario = scenes.scenario(BOX, hand, mass=0.1, simulator=simulator)
        outcome = pipeline.lift(scenario, search.grasps[0], options=SHORT)
        assert outcome.reason == "held"
        assert outcome.acceleration_survived == 9.81


def test_without_the_package_one_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [n for n in sys.modules if n.startswith("lis_grasp.simulation.mujoco")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    hand = Hand.load("wsg50")
    grasp = jaw_grasp(hand, np.zeros(3), 0.05)
    with pytest.raises(InvalidOptionError, match=r"pip install 'lis-grasp\[mujoco\]'"):
        pipeline.lift(scenes.scenario(BOX, hand, simulator="mujoco"), grasp)


@pytest.mark.parametrize(("name", "package"), [("box", "mujoco"), ("torus", "coacd")])
def test_a_run_without_a_package_of_its_simulator_ends_before_the_first_touch(
    name: str,
    package: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if package != "mujoco":
        pytest.importorskip("mujoco", reason=NEEDS_MUJOCO)
    monkeypatch.setitem(sys.modules, package, None)
    assert main(["run", name, "--simulator", "mujoco", "--output", str(tmp_path)]) == 2
    assert package in capsys.readouterr().err
    assert not (tmp_path / "touches.jsonl").exists()


def test_a_convex_object_needs_no_decomposition(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco", reason=NEEDS_MUJOCO)
    monkeypatch.setitem(sys.modules, "coacd", None)
    require_simulator("mujoco", BOX)
    with pytest.raises(InvalidOptionError, match="coacd"):
        require_simulator("mujoco", RING)


def test_no_contacts_without_an_object_between_the_jaws() -> None:
    X_WO = np.eye(4)
    X_WO[1, 3] = 0.2
    outcome = lift_by_jaws(BOX, X_WO)
    assert outcome.reason == "no_contact"
    assert len(outcome.measured_contacts) == 0
