"""Epsilon by expanding polytopes, and force closure, against hulls and closed forms."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from lis_grasp import epsilon_quality, is_force_closure
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.grasping._expanding_polytope import (
    LEAST_RADIUS,
    _Facets,
    _simplex,
    inscribed_ball_radii,
)
from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.epsilon import epsilon_by_convex_hull, epsilon_by_expanding_polytope
from lis_grasp.grasping.force_closure import min_weight
from lis_grasp.grasping.grasp_batch import fill_unused

AXES = np.vstack([np.eye(3), -np.eye(3)])


def _grasps(seed: int, count: int, contacts: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, contacts, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return normals * rng.uniform(0.5, 1.5, size=(count, contacts, 1)), normals


@pytest.mark.parametrize(
    "model",
    [
        WrenchModel(0.7, "frictionless"),
        WrenchModel(0.7),
        WrenchModel(0.7, "soft_finger", torsion=0.2),
    ],
    ids=lambda model: model.contact_model,
)
@pytest.mark.parametrize("contacts", [3, 4, pytest.param(7, marks=pytest.mark.slow)])
def test_expanding_polytopes_agree_with_convex_hulls(contacts: int, model: WrenchModel) -> None:
    points, normals = _grasps(contacts, 15, contacts)
    together = epsilon_by_expanding_polytope(points, normals, model)
    alone = [epsilon_by_convex_hull(p, n, model) for p, n in zip(points, normals, strict=True)]
    # Within the joggle; below the least radius they may count as zero.
    off = np.abs(together - alone)
    assert np.all((off < 1e-5) | ((together == 0.0) & (np.array(alone) < LEAST_RADIUS)))


def test_a_ball_inside_an_ellipsoid_has_its_shortest_half_axis() -> None:
    axes = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.9, 0.3, 0.5, 0.7, 0.4, 2.0]])

    def farthest(directions: np.ndarray, which: np.ndarray) -> np.ndarray:
        scaled = directions * axes[which]
        return axes[which] * scaled / np.linalg.norm(scaled, axis=1, keepdims=True)

    # A ball that is well approached in six dimensions takes more facets than a grasp's wrenches.
    radii = inscribed_ball_radii(farthest, 2, tolerance=0.05)
    assert np.all(radii <= [1.0, 0.3])
    assert np.all(radii >= np.array([1.0, 0.3]) / 1.05)


def test_polytopes_of_points_have_the_facets_of_their_hulls() -> None:
    rng = np.random.default_rng(71)
    points = rng.normal(size=(3, 25, 6))
    facets = _Facets.simplices(3)
    for i in range(25):
        facets.grow(points[:, i], 7 + i)
    for body in range(3):
        hull = ConvexHull(np.vstack([_simplex(), points[body]]))
        filled = facets.sizes[body] > 0.0
        found = {tuple(sorted(vertices)) for vertices in facets.vertices[body, filled].tolist()}
        assert found == {tuple(sorted(vertices)) for vertices in hull.simplices.tolist()}
        assert filled.sum() == len(hull.simplices)
        # The plane v x = 1 is at the distance 1 / |v|.
        distances = np.sort(1.0 / np.sqrt(facets.sizes[body, filled]))
        np.testing.assert_allclose(distances, np.sort(-hull.equations[:, -1]), rtol=1e-9)


def test_neighbours_of_facets_share_all_vertices_but_one() -> None:
    rng = np.random.default_rng(72)
    facets = _Facets.simplices(1)
    for i in range(15):
        facets.grow(rng.normal(size=(1, 6)), 7 + i)
    for slot in np.flatnonzero(facets.sizes[0] > 0.0):
        vertices = facets.vertices[0, slot]
        for place, other in enumerate(facets.neighbours[0, slot]):
            shared = set(vertices.tolist()) & set(facets.vertices[0, other].tolist())
            assert shared == set(np.delete(vertices, place).tolist())


def test_contacts_that_occur_twice_do_not_change_epsilon() -> None:
    points, normals = _grasps(73, 20, 3)
    used = np.zeros((20, 5), dtype=bool)
    used[:, [0, 2, 3]] = True
    contacts = np.zeros((2, 20, 5, 3))
    contacts[:, used] = points.reshape(-1, 3), normals.reshape(-1, 3)
    model = WrenchModel(0.7, origin=np.zeros(3), length_scale=1.0)
    alone = epsilon_by_expanding_polytope(points, normals, model)
    twice = (fill_unused(values, used) for values in contacts)
    np.testing.assert_allclose(epsilon_by_expanding_polytope(*twice, model), alone, atol=1e-5)


def test_a_tolerance_makes_epsilon_smaller_by_that_fraction_at_most() -> None:
    rng = np.random.default_rng(12)
    normals = rng.normal(size=(200, 4, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    model = WrenchModel(0.6)
    exact = epsilon_by_expanding_polytope(normals, normals, model)
    coarse = epsilon_by_expanding_polytope(normals, normals, model, tolerance=0.1)
    assert (coarse <= exact + 1e-9).all()
    assert (coarse >= exact / 1.1 - 1e-4).all()
    assert (coarse < 0.999 * exact).any()


def test_min_weight_times_the_width_of_the_hull_bounds_epsilon() -> None:
    # 0 = sum a_k w_k, a_k >= t: along any u, max w u >= t (max w u - min w u).
    points, normals = _grasps(31, 20, 4)
    bounds = 0
    for p, n in zip(points, normals, strict=True):
        model = WrenchModel(0.8)
        W = model.wrenches_of_grasp(p, n)
        hull = ConvexHull(W)
        worst = hull.equations[np.argmax(hull.equations[:, -1]), :6]
        least = min_weight(p, n, model) / len(W)
        extents = W @ worst
        bounds += least > 1e-6
        assert epsilon_quality(p, n, friction=0.8) >= least * np.ptp(extents) - 1e-12
    assert bounds > 10


def test_a_soft_fingers_torque_adds_to_that_of_its_squeeze() -> None:
    # Off the origin, with a normal that misses it: the squeeze itself has a torque.
    p, n = np.array([[0.1, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    W = WrenchModel(0.5, "soft_finger", 0.02, np.zeros(3), 1.0).wrenches(p, n)[0]
    squeeze = np.concatenate([-n[0], np.cross(p[0], -n[0])])
    np.testing.assert_allclose(W[-2:].mean(axis=0), squeeze, atol=1e-12)
    np.testing.assert_allclose(np.abs(W[-2] - squeeze), [0, 0, 0, 0, 0.02, 0], atol=1e-12)


def test_force_closure_agrees_with_a_feasibility_programme() -> None:
    points, normals = _grasps(51, 40, 3)
    for p, n in zip(points, normals, strict=True):
        W = WrenchModel(0.4, length_scale=1.0).wrenches_of_grasp(p, n)
        # Is zero a combination with all weights at least 1? (scaled: strictly positive ones)
        oracle = linprog(np.zeros(len(W)), A_eq=W.T, b_eq=np.zeros(6), bounds=(1.0, 1e7))
        assert is_force_closure(p, n, friction=0.4) == (oracle.status == 0)


def test_contacts_of_a_wrong_shape_are_refused() -> None:
    with pytest.raises(InvalidContactsError) as error:
        epsilon_by_expanding_polytope(AXES, AXES, WrenchModel(0.5))
    assert error.value.field == "points"
    with pytest.raises(InvalidContactsError) as error:
        epsilon_quality(AXES[None], AXES[None], friction=0.5)
    assert error.value.field == "points"


def test_degenerate_polytopes_still_give_the_epsilon_of_hulls() -> None:
    # Soft fingers opposite each other: ten wrenches each in a space of three dimensions, so that
    # many facets are flat but for the joggle.
    rng = np.random.default_rng(61)
    count = 60
    model = WrenchModel(0.8, "soft_finger", 0.005, np.zeros(3), 0.05)
    points = np.tile([[0.0, 0.03, 0.0], [0.0, -0.03, 0.0]], (count, 1, 1))
    points[:, :, ::2] += rng.uniform(-0.02, 0.02, size=(count, 1, 2))
    normals = points * [0.0, 1.0, 0.0] / 0.03
    normals += rng.choice([0.0, 1e-9, 1e-6, 1e-3], size=(count, 1, 1)) * rng.normal(
        size=normals.shape
    )
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    together = epsilon_by_expanding_polytope(points, normals, model)
    alone = [epsilon_by_convex_hull(p, n, model) for p, n in zip(points, normals, strict=True)]
    np.testing.assert_allclose(together, alone, atol=2e-5)
