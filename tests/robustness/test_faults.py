"""Failing libraries: finished files are kept, and no grasp is accepted without a solution."""

from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pytest
import trimesh
from kills import COMMANDS, Uninterrupted, files_in, half_written
from made_grasps import jaw_grasp
from scipy.optimize import OptimizeResult

from lis_grasp import Grasp, Hand
from lis_grasp.cli.main import main
from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.force_closure import is_force_closure, min_weight, resisted_force
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.simulation.drake.lift import LiftScene, simulate_lift

BOX = trimesh.creation.box((0.05, 0.05, 0.08))
RUN = COMMANDS["run"].split()

CHECKER = "lis_grasp.robots.collision.HandCollisionChecker"
# Files of finished stages, one after the other.
TOUCHED = {"touches.jsonl"}
EXPLORED = {*TOUCHED, "contacts.ply"}
ESTIMATED = {*EXPLORED, "surface.ply"}
# The function that fails, after how many good calls, and the files finished by then.
FAULTS = {
    "FCL while touching": (
        f"{CHECKER}.distance",
        12,
        TOUCHED,
    ),
    "meshing": ("lis_grasp.stages.estimate.extract_mesh", 0, EXPLORED),
    "FCL at a grasp": (
        f"{CHECKER}.first_collisions",
        3,
        ESTIMATED,
    ),
    "a linear programme": ("lis_grasp.grasping.force_closure.linprog", 0, ESTIMATED),
    "inverse kinematics": ("lis_grasp.grasping._candidate_filter.solve_ik", 1, ESTIMATED),
    "Drake's plant": ("lis_grasp.simulation.drake.lift.add_object_body", 0, ESTIMATED),
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Uninterrupted:
    folder = tmp_path_factory.mktemp("plain")
    assert main([*RUN, "--output", str(folder)]) == 0
    return Uninterrupted(files_in(folder), 0.0)


def _failing_after(calls: int, function: Callable[..., Any]) -> Callable[..., Any]:
    left = calls

    def fail(*arguments: Any, **options: Any) -> Any:
        nonlocal left
        left -= 1
        if left < 0:
            raise RuntimeError("a library has failed")
        return function(*arguments, **options)

    return fail


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_failed_run_leaves_complete_files_and_can_be_resumed(
    fault: str, plain: Uninterrupted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, calls, finished = FAULTS[fault]
    with monkeypatch.context() as patch:
        patch.setattr(target, _failing_after(calls, resolve_name(target)))
        with pytest.raises(RuntimeError, match="a library has failed"):
            main([*RUN, "--output", str(tmp_path)])
    assert not half_written(tmp_path, plain)
    assert finished <= set(files_in(tmp_path))
    assert main([*RUN, "--output", str(tmp_path)]) == 0
    assert files_in(tmp_path) == plain.files


@pytest.mark.parametrize("status", [1, 4])  # the limit of iterations; numerical difficulties
def test_without_a_solution_of_the_solver_no_grasp_is_accepted(
    status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.0]])
    model, up = WrenchModel(0.8, origin=np.zeros(3)), (0.0, 0.0, 1.0)
    assert is_force_closure(points, points, friction=0.8)
    assert min_weight(points, points, model) > 0.0
    assert resisted_force(points, points, up, model) > 0.0
    monkeypatch.setattr(
        "lis_grasp.grasping.force_closure.linprog",
        lambda **_: OptimizeResult(x=None, status=status, success=False),
    )
    assert not is_force_closure(points, points, friction=0.8)
    assert min_weight(points, points, model) == 0.0
    assert resisted_force(points, points, up, model) == 0.0


def _lose_all_numbers(scene: LiftScene) -> None:
    state = scene._scene.context.get_mutable_discrete_state_vector()
    state.SetFromVector(np.full(state.size(), np.nan))


def _fail_an_assertion(scene: LiftScene) -> None:
    """Violate an assertion of Drake; pydrake raises SystemExit."""
    plant = scene._scene.plant
    plant.SetPositions(scene._scene.context, np.full(plant.num_positions(), np.nan))


class _FailingSimulator:
    def __init__(self, scene: LiftScene, fail: Callable[[LiftScene], None], at: float) -> None:
        self._scene, self._fail, self._at = scene, fail, at
        self._simulator = scene._scene.simulator

    def AdvanceTo(self, time: float) -> None:
        if time > self._at:
            self._fail(self._scene)
        self._simulator.AdvanceTo(time)


@pytest.fixture(scope="module")
def grasp() -> Grasp:
    return jaw_grasp(Hand.load("wsg50"), np.zeros(3), 0.05)


@pytest.mark.parametrize("at", [0.0, 1.0])
@pytest.mark.parametrize("fail", [_lose_all_numbers, _fail_an_assertion])
def test_a_diverged_lift_is_reported_with_the_last_pose_of_the_object(
    fail: Callable[[LiftScene], None], at: float, grasp: Grasp, monkeypatch: pytest.MonkeyPatch
) -> None:
    build = LiftScene.__init__

    def build_to_fail(scene: LiftScene, *arguments: Any, **options: Any) -> None:
        build(scene, *arguments, **options)
        scene._scene.simulator = _FailingSimulator(scene, fail, at)

    monkeypatch.setattr(LiftScene, "__init__", build_to_fail)
    outcome = simulate_lift(LiftSetup(BOX, Hand.load("wsg50"), grasp, support_height=-0.04))
    assert outcome.reason == "diverged"
    assert not outcome.lifted
    assert not outcome.held
    assert np.isfinite(outcome.X_WO).all()
    assert all(np.isfinite(X).all() for X in outcome.motion.poses.values())
