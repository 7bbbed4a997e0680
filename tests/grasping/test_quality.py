"""Grasp quality against closed forms, laws, and a second method."""

from typing import Any

import numpy as np
import pytest
from random_directions import random_directions
from scipy.optimize import OptimizeResult, linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from lis_grasp import epsilon_quality, is_force_closure
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError
from lis_grasp.grasping.contact_wrenches import WrenchModel, cone_edges
from lis_grasp.grasping.force_closure import min_weight, resisted_force, resisted_forces
from lis_grasp.grasping.hand_capacity import balanced_grip

AXES = np.vstack([np.eye(3), -np.eye(3)])


def _ring(count: int, radius: float = 1.0) -> np.ndarray:
    angles = 2.0 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])


def _random_grasp(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    normals = random_directions(count, rng)
    return normals * rng.uniform(0.5, 1.5, size=(count, 1)), normals


def _extent_by_linear_programmes(wrenches: np.ndarray, directions: np.ndarray) -> float:
    """Return the least, over directions, of the largest multiple of it inside the hull."""
    extents = []
    for direction in directions:
        # max s : s d = W^T a, a >= 0, sum a = 1
        solution = linprog(
            np.append(np.zeros(len(wrenches)), -1.0),
            A_eq=np.vstack(
                [
                    np.column_stack([wrenches.T, -direction]),
                    np.append(np.ones(len(wrenches)), 0.0),
                ]
            ),
            b_eq=np.append(np.zeros(6), 1.0),
            bounds=[(0, None)] * len(wrenches) + [(None, None)],
        )
        extents.append(-solution.fun if solution.status == 0 else 0.0)
    return float(min(extents))


def test_cone_edges_are_on_the_cone_and_push_inward() -> None:
    rng = np.random.default_rng(0)
    _, normals = _random_grasp(rng, 20)
    forces = cone_edges(normals, 0.7)  # (20, 8, 3)
    normal_part = -(forces * normals[:, None]).sum(axis=-1)
    np.testing.assert_allclose(normal_part, 1.0, atol=1e-12)
    tangential = forces + normal_part[..., None] * normals[:, None]
    np.testing.assert_allclose(np.linalg.norm(tangential, axis=-1), 0.7, atol=1e-12)


@pytest.mark.parametrize(
    ("model", "columns"), [("frictionless", 1), ("coulomb", 8), ("soft_finger", 10)]
)
def test_wrenches_are_forces_and_their_torques_over_the_length(model: str, columns: int) -> None:
    points, normals = np.array([[0.2, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    wrenches = WrenchModel(0.5, model, 0.01, np.zeros(3), 0.1).wrenches(points, normals)
    assert wrenches.shape == (1, columns, 6)
    ordinary = wrenches[0, :8] if model != "frictionless" else wrenches[0]
    expected = np.cross(points, ordinary[:, :3]) / 0.1
    np.testing.assert_allclose(ordinary[:, 3:], expected, atol=1e-12)


def test_a_soft_finger_twists_by_its_torsion_about_the_normal() -> None:
    top = [[0.0, 0.0, 1.0]]
    wrenches = WrenchModel(0.5, "soft_finger", 0.3, np.zeros(3), 2.0).wrenches(top, top)
    np.testing.assert_allclose(wrenches[0, -2:, 5], [-0.15, 0.15])


def test_two_hard_fingers_never_close_and_two_soft_ones_do() -> None:
    points = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert not is_force_closure(points, points, friction=0.5)
    assert epsilon_quality(points, points, friction=0.5) == 0.0
    soft = {"friction": 0.5, "model": "soft_finger", "torsion": 0.1}
    assert is_force_closure(points, points, **soft)
    assert epsilon_quality(points, points, **soft) > 0.0


def test_frictionless_contacts_on_a_sphere_never_resist_torque() -> None:
    rng = np.random.default_rng(1)
    normals = _random_grasp(rng, 12)[1]
    assert not is_force_closure(normals, normals, friction=0.0)
    assert epsilon_quality(normals, normals, friction=0.0) == 0.0


@pytest.mark.parametrize("friction", [0.3, 0.5, 1.0])
def test_three_fingers_round_a_sphere_close_with_friction_above_their_angle(
    friction: float,
) -> None:
    # Three contacts 120 degrees apart balance along their normals for any friction above zero.
    points = _ring(3)
    assert is_force_closure(points, points, friction=friction)
    assert epsilon_quality(points, points, friction=friction) > 0.01
    assert not is_force_closure(points, points, friction=0.0)


def test_planar_antipodal_threshold_is_the_friction_cone() -> None:
    # Nguyen 1988: two contacts balance exactly when the line between them is inside both cones.
    tilt = 0.3
    points = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    normals = np.array([[np.cos(tilt), np.sin(tilt), 0.0], [-np.cos(tilt), np.sin(tilt), 0.0]])
    soft = {"model": "soft_finger", "torsion": 0.1, "edges": 64}
    assert is_force_closure(points, normals, friction=np.tan(tilt) + 0.01, **soft)
    assert not is_force_closure(points, normals, friction=np.tan(tilt) - 0.01, **soft)


def test_octahedral_grasp_has_its_closed_form_epsilon() -> None:
    # Six unit contacts on the axes, four edges along the other axes: forces -+e_i +- mu e_j with
    # the torque mu along +-e_k. Pure torques are resisted least. The support along a unit
    # torque t is mu max |t_k|, whose minimum is mu / sqrt(3) at t = (1, 1, 1) / sqrt(3).
    for friction in (0.01, 0.1, 0.5):
        epsilon = epsilon_quality(AXES, AXES, friction=friction, edges=4)
        assert epsilon == pytest.approx(friction / np.sqrt(3.0), rel=1e-9)


@pytest.mark.by_default("1")
@pytest.mark.parametrize("seed", range(4))
def test_epsilon_is_the_least_extent_by_linear_programmes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals = _random_grasp(rng, 6)
    epsilon = epsilon_quality(points, normals, friction=0.8)
    center = points.mean(axis=0)
    scale = np.linalg.norm(points - center, axis=1).max()
    model = WrenchModel(0.8, origin=center, length_scale=scale)
    wrenches = model.wrenches(points, normals).reshape(-1, 6)
    directions = rng.normal(size=(60, 6))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert 0.0 < epsilon <= _extent_by_linear_programmes(wrenches, directions) + 1e-9
    # Along the normal of the hull's nearest facet, the support of the wrenches is epsilon itself.
    facets = ConvexHull(wrenches).equations  # unit normal and minus the distance
    worst = facets[facets[:, -1].argmax(), :-1]
    assert (wrenches @ worst).max() == pytest.approx(epsilon, rel=1e-9)
    assert _extent_by_linear_programmes(wrenches, worst[None]) >= epsilon - 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_force_closure_is_epsilon_above_zero(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    for count in (3, 4, 5):
        points, normals = _random_grasp(rng, count)
        closed = is_force_closure(points, normals, friction=0.6)
        assert closed == (epsilon_quality(points, normals, friction=0.6) > 1e-9)
        assert closed == (min_weight(points, normals, WrenchModel(0.6)) > 1e-9)


def test_min_weight_is_one_for_a_symmetric_grasp_and_never_more() -> None:
    assert min_weight(AXES, AXES, WrenchModel(0.5)) == pytest.approx(1.0, abs=1e-9)
    rng = np.random.default_rng(5)
    for _ in range(10):
        points, normals = _random_grasp(rng, 5)
        assert 0.0 <= min_weight(points, normals, WrenchModel(0.7)) <= 1.0 + 1e-9


def test_adding_a_contact_never_lowers_epsilon() -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        points, normals = _random_grasp(rng, 6)
        fixed = {"friction": 0.6, "origin": np.zeros(3), "length_scale": 1.0}
        fewer = epsilon_quality(points[:5], normals[:5], **fixed)
        assert epsilon_quality(points, normals, **fixed) >= fewer - 1e-12


def test_more_friction_never_lowers_epsilon() -> None:
    rng = np.random.default_rng(3)
    points, normals = _random_grasp(rng, 5)
    values = [epsilon_quality(points, normals, friction=mu) for mu in (0.2, 0.4, 0.8, 1.2)]
    assert np.all(np.diff(values) >= -1e-12)


def test_epsilon_is_the_same_in_any_unit_of_length() -> None:
    rng = np.random.default_rng(4)
    points, normals = _random_grasp(rng, 5)
    assert epsilon_quality(1000.0 * points, normals, friction=0.6) == pytest.approx(
        epsilon_quality(points, normals, friction=0.6), rel=1e-9
    )


@pytest.mark.slow
def test_epsilon_hardly_changes_when_the_grasp_is_turned() -> None:
    # Exactly invariant only for round cones: a pyramid of 32 edges is within 1/cos(pi/32), half a
    # per cent, of its cone.
    rng = np.random.default_rng(6)
    points, normals = _random_grasp(rng, 4)
    R = Rotation.from_rotvec([0.3, 1.1, -0.4]).as_matrix()
    before = epsilon_quality(points, normals, friction=0.8, edges=32)
    after = epsilon_quality(points @ R.T, normals @ R.T, friction=0.8, edges=32)
    assert after == pytest.approx(before, rel=0.02, abs=1e-4)


def test_a_grip_is_balanced_though_equal_forces_would_not_be() -> None:
    # One thumb against two fingers that are unevenly beside it: even forces would turn and push.
    points = np.array([[0.03, 0.0, 0.0], [-0.03, 0.01, 0.0], [-0.03, -0.02, 0.005]])
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    forces = balanced_grip(points, normals, friction=0.6, total=10.0)
    # The squares of the weights make unevenness (0.03 / 100)^2 times as important as balance.
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-6 * 10.0)
    torque = np.cross(points - points.mean(axis=0), forces).sum(axis=0)
    np.testing.assert_allclose(torque, 0.0, atol=1e-6 * 10.0 * 0.03)
    normal_part = -(forces * normals).sum(axis=1)
    np.testing.assert_allclose(normal_part.sum(), 10.0, rtol=0.02)


@pytest.mark.parametrize("weight", [0.0, 3.0])
def test_a_grip_balances_a_load_inside_the_cones(weight: float) -> None:
    points, friction = _ring(3, 0.03), 0.6
    load = np.array([0.0, 0.0, -weight]), np.array([0.004, -0.002, 0.02])
    given = {"load": load} if weight else {}
    normals = points / 0.03
    forces = balanced_grip(points, normals, friction=friction, total=12.0, **given)
    np.testing.assert_allclose(forces.sum(axis=0), -load[0], atol=1e-3)
    torque = np.cross(points, forces).sum(axis=0) + np.cross(load[1], load[0])
    np.testing.assert_allclose(torque, 0.0, atol=1e-4)
    normal_part = -(forces * normals).sum(axis=1)
    assert normal_part.sum() == pytest.approx(12.0, rel=1e-2)
    tangential = np.linalg.norm(forces + normal_part[:, None] * normals, axis=1)
    assert np.all(tangential <= friction * normal_part + 1e-9)


def test_a_grasp_of_high_symmetry_has_its_epsilon() -> None:
    # The facets of its hull have many coplanar points, which Qhull cannot always merge; a grasp
    # that differs by a hair does not have them, and epsilon is continuous.
    points = np.array(
        [[0.02, -0.03, 0.05], [0.0, -0.03, 0.02], [-0.02, -0.03, -0.01], [0.0, 0.03, 0.02]]
    )
    normals = np.array([[0.0, -1.0, 0.0]] * 3 + [[0.0, 1.0, 0.0]])
    options = {"friction": 0.8, "origin": np.zeros(3), "length_scale": 0.08}
    rng = np.random.default_rng(0)
    for shift in np.linspace(0.0, 0.01, 11):
        moved = points + [0.0, 0.0, shift]
        hair = moved + 1e-7 * rng.normal(size=(4, 3))
        assert epsilon_quality(moved, normals, **options) > 0.05
        assert epsilon_quality(moved, normals, **options) == pytest.approx(
            epsilon_quality(hair, normals, **options), abs=1e-4
        )


@pytest.mark.parametrize("bad", [np.zeros((0, 3)), np.zeros((2, 2)), [[np.nan, 0, 0]]])
def test_arrays_that_are_no_contacts_are_refused(bad: object) -> None:
    with pytest.raises(InvalidContactsError):
        epsilon_quality(bad, bad, friction=0.5)


def test_points_without_normals_are_refused() -> None:
    with pytest.raises(InvalidContactsError) as error:
        epsilon_quality(AXES, AXES[:3], friction=0.5)
    assert error.value.field == "normals"


@pytest.mark.parametrize(
    ("option", "value"),
    [("friction", -0.1), ("length_scale", 0.0), ("model", "sticky"), ("edges", 2)],
)
def test_options_out_of_range_are_refused(option: str, value: object) -> None:
    with pytest.raises(InvalidOptionError) as error:
        epsilon_quality(AXES, AXES, **{"friction": 0.5, option: value})  # type: ignore[arg-type]
    assert (error.value.option, error.value.value) == (option, value)


def test_two_fingers_carry_their_friction_and_only_straight_above_the_weight() -> None:
    # Half of the squeeze at either side, each pulls up by mu times it. A cone's edge points up.
    points, normals = np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    up = (0.0, 0.0, 1.0)
    centered = resisted_force(points, normals, up, WrenchModel(0.5, origin=np.zeros(3), edges=4))
    assert centered == pytest.approx(0.5)
    # Off the line through both, nothing stops the turn about it but torsion: mu lever / offset.
    beside = np.array([0.0, 0.2, 0.0])
    hard = WrenchModel(0.5, origin=beside)
    assert resisted_force(points, normals, up, hard) == pytest.approx(0.0)
    soft = resisted_force(points, normals, up, WrenchModel(0.5, "soft_finger", 0.02, beside))
    assert 0.0 < soft <= 0.02 / 0.2 + 1e-9


def test_three_fingers_below_carry_all_that_they_press() -> None:
    points = _ring(3) - [0.0, 0.0, 0.3]
    below = np.tile([0.0, 0.0, -1.0], (3, 1))
    up = (0.0, 0.0, 1.0)
    for origin, expected in (((0.0, 0.0, 0.0), 1.0), ((2.0, 0.0, 0.0), 0.0)):
        found = resisted_force(points, below, up, WrenchModel(0.0, origin=origin))
        assert found == pytest.approx(expected)


def test_resisted_forces_of_many_grasps_end_at_the_hulls_of_their_wrenches() -> None:
    rng = np.random.default_rng(0)
    grasps = [_random_grasp(rng, 4) for _ in range(12)]
    points, normals = (np.array(arrays) for arrays in zip(*grasps, strict=True))
    model, up = WrenchModel(0.6, origin=np.zeros(3)), (0.0, 0.0, 1.0)
    found = resisted_forces(points, normals, up, model)
    closing = 0
    for p, n, force in zip(points, normals, found, strict=True):
        planes = ConvexHull(model.wrenches_of_grasp(p, n)).equations
        if (planes[:, -1] < 0.0).all():  # the hull contains the origin: the ray leaves it once
            closing += 1
            ahead = planes[:, 2] > 1e-12
            assert force == pytest.approx((-planes[ahead, -1] / planes[ahead, 2]).min(), rel=1e-6)
        assert force == pytest.approx(resisted_force(p, n, up, model), abs=1e-9)
    assert closing >= 3


@pytest.mark.parametrize("seed", range(5))
def test_the_resisted_force_in_any_direction_is_at_least_epsilon(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals = _random_grasp(rng, 5)
    center = points.mean(axis=0)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    epsilon = epsilon_quality(points, normals, friction=0.6)
    force = resisted_force(points, normals, direction, WrenchModel(0.6, origin=center))
    assert force >= epsilon - 1e-9


def test_forces_of_the_other_grasps_survive_a_failure_of_the_solver(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(8)
    grasps = [_random_grasp(rng, 4) for _ in range(3)]
    points, normals = (np.array(arrays) for arrays in zip(*grasps, strict=True))
    up, model = (0.0, 0.0, 1.0), WrenchModel(0.8)
    expected = resisted_forces(points, normals, up, model)
    calls = 0

    def failing(*arguments: Any, **options: Any) -> OptimizeResult:
        nonlocal calls
        calls += 1
        # The programme of all grasps, and that of the second one.
        return OptimizeResult(status=4) if calls in (1, 3) else linprog(*arguments, **options)

    monkeypatch.setattr("lis_grasp.grasping.force_closure.linprog", failing)
    found = resisted_forces(points, normals, up, model)
    np.testing.assert_allclose(found[[0, 2]], expected[[0, 2]], rtol=1e-6)
    assert found[1] == 0.0
