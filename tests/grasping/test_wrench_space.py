"""Round cones, force limits and batches of grasps, against hulls, closed forms and proofs."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from lis_grasp import epsilon_quality, is_force_closure
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError
from lis_grasp.grasping.contact_cones import contact_cones
from lis_grasp.grasping.contact_model import contact_wrenches
from lis_grasp.grasping.force_closure import certify_force_closure, min_weight
from lis_grasp.grasping.inscribed_ball import LEAST_RADIUS, inner_radii
from lis_grasp.grasping.quality import epsilon_qualities, isotropy, wrench_volume

AXES = np.vstack([np.eye(3), -np.eye(3)])
FIXED = {"origin": np.zeros(3), "length_scale": 1.0}


def _grasps(seed: int, count: int, contacts: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, contacts, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return normals * rng.uniform(0.5, 1.5, size=(count, contacts, 1)), normals


@pytest.mark.parametrize(
    "body",
    [
        {"model": "frictionless"},
        {"model": "coulomb"},
        {"model": "soft_finger", "torsion": 0.2},
    ],
)
@pytest.mark.parametrize("contacts", [3, 4, 7])
def test_epsilons_of_a_batch_are_those_of_whole_hulls(contacts: int, body: dict) -> None:
    points, normals = _grasps(contacts, 40, contacts)
    together = epsilon_qualities(points, normals, friction=0.7, **body)
    alone = [
        epsilon_quality(p, n, friction=0.7, **body) for p, n in zip(points, normals, strict=True)
    ]
    # Within the joggle; below the least radius they may count as zero.
    off = np.abs(together - alone)
    assert np.all((off < 1e-5) | ((together == 0.0) & (np.array(alone) < LEAST_RADIUS)))


def test_a_ball_inside_an_ellipsoid_has_its_shortest_half_axis() -> None:
    axes = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.9, 0.3, 0.5, 0.7, 0.4, 2.0]])

    def farthest(directions: np.ndarray, which: np.ndarray) -> np.ndarray:
        scaled = directions * axes[which]
        return axes[which] * scaled / np.linalg.norm(scaled, axis=1, keepdims=True)

    # A ball that is well approached in six dimensions takes more facets than a grasp's wrenches.
    radii = inner_radii(farthest, 2, tolerance=0.05)
    assert np.all(radii <= [1.0, 0.3])
    assert np.all(radii >= np.array([1.0, 0.3]) / 1.05)


def test_a_tolerance_makes_epsilon_smaller_by_that_share_at_the_most() -> None:
    rng = np.random.default_rng(12)
    normals = rng.normal(size=(200, 4, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    exact = epsilon_qualities(normals, normals, friction=0.6)
    coarse = epsilon_qualities(normals, normals, friction=0.6, tolerance=0.1)
    assert (coarse <= exact + 1e-9).all()
    assert (coarse >= exact / 1.1 - 1e-4).all()
    assert (coarse < 0.999 * exact).any()


@pytest.mark.parametrize("seed", range(3))
def test_round_cones_lie_between_their_inner_and_outer_pyramids(seed: int) -> None:
    points, normals = _grasps(seed, 10, 4)
    mu, edges = 0.6, 16
    round_ = epsilon_qualities(points, normals, friction=mu, edges=None)
    inner = epsilon_qualities(points, normals, friction=mu, edges=edges)
    outer = epsilon_qualities(points, normals, friction=mu / np.cos(np.pi / edges), edges=edges)
    assert np.all(round_ >= inner * (1.0 - 1.1e-3) - 2e-4)
    assert np.all(round_ <= outer + 2e-4)


def test_epsilon_of_round_cones_does_not_change_when_the_grasp_is_turned() -> None:
    points, normals = _grasps(9, 10, 4)
    R = Rotation.from_rotvec([0.3, 1.1, -0.4]).as_matrix()
    before = epsilon_qualities(points, normals, friction=0.8, edges=None)
    after = epsilon_qualities(points @ R.T, normals @ R.T, friction=0.8, edges=None)
    np.testing.assert_allclose(after, before, rtol=2.1e-3, atol=2e-4)


@pytest.mark.parametrize("soft", [False, True])
def test_the_farthest_round_wrench_is_the_best_of_many_inside_the_cone(soft: bool) -> None:
    rng = np.random.default_rng(3)
    points, normals = _grasps(5, 1, 1)
    torsion = 0.3 if soft else 0.0
    cones = contact_cones(
        points,
        normals,
        friction=0.7,
        model="soft_finger" if soft else "coulomb",
        torsion=torsion,
        edges=None,
        **FIXED,
    )
    direction = rng.normal(size=6)
    best = cones.farthest(direction[None], np.zeros(1, dtype=np.intp))[0, 0]
    share = rng.normal(size=(20000, 3))
    share /= np.linalg.norm(share, axis=1, keepdims=True)
    n = normals[0, 0]
    basis = np.linalg.svd(n[None])[2][1:]
    forces = -n + 0.7 * share[:, :2] @ basis
    torques = np.cross(points[0, 0], forces) + torsion * share[:, 2:] * n
    reach = np.hstack([forces, torques]) @ direction
    assert reach.max() <= best @ direction + 1e-12
    assert reach.max() >= best @ direction - 1e-2


def test_a_wrench_along_a_normal_stays_inside_the_cone() -> None:
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(200, 1, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    cones = contact_cones(
        np.zeros_like(normals), normals, friction=0.5, model="coulomb", torsion=0.0, edges=None,
        **FIXED,
    )  # fmt: skip
    push = np.concatenate([-normals[:, 0], np.zeros((200, 3))], axis=1)
    forces = cones.farthest(push, np.arange(200))[:, 0, :3]
    np.testing.assert_allclose(forces, -normals[:, 0], atol=1e-12)


def test_limiting_each_finger_gives_the_minkowski_sum_of_their_hulls() -> None:
    # Three contacts: 5^3 sums of "nothing or one of four edges" have the sum's hull.
    points, normals = _grasps(1, 6, 3)
    for p, n in zip(points, normals, strict=True):
        W = contact_wrenches(p, n, friction=0.8, edges=4, **FIXED)
        W = np.concatenate([np.zeros((3, 1, 6)), W], axis=1)
        sums = (W[0][:, None, None] + W[1][None, :, None] + W[2][None, None, :]).reshape(-1, 6)
        expected = max(-ConvexHull(sums).equations[:, -1].max(), 0.0)
        found = epsilon_quality(p, n, friction=0.8, edges=4, limit="each", **FIXED)
        assert found == pytest.approx(expected if expected > 2e-4 else 0.0, abs=1e-5)


@pytest.mark.parametrize("contacts", [3, 4, 5])
def test_limiting_each_finger_resists_more_than_limiting_their_sum(contacts: int) -> None:
    points, normals = _grasps(11, 10, contacts)
    total = epsilon_qualities(points, normals, friction=0.8)
    each = epsilon_qualities(points, normals, friction=0.8, limit="each")
    assert np.all(each >= total - 1e-5)
    assert np.all(each <= contacts * total + 1e-4)


def test_two_soft_fingers_have_the_closed_form_epsilon() -> None:
    # Contacts at +-a on the x axis, forces summing to 1, length scale a. Along x: 1. Across: mu.
    # Torque about y or z comes from opposed sideways forces: arm 1, again mu. Torque about x: the
    # torsion over a. Both fingers' ellipses are alike, so the least of these is epsilon, unless a
    # mixed direction is worse; the wrenches are unit squeezes plus an ellipsoid with these axes,
    # whose hull of two opposite copies contains exactly the ball of the shortest axis.
    a, mu, torsion = 0.05, 0.6, 0.01
    points = np.array([[a, 0.0, 0.0], [-a, 0.0, 0.0]])
    normals = points / a
    epsilon = epsilon_quality(
        points, normals, friction=mu, model="soft_finger", torsion=torsion, edges=None
    )
    assert epsilon == pytest.approx(torsion / a, rel=2e-3)


@pytest.mark.parametrize("edges", [8, None])
def test_a_proof_of_closure_can_be_checked(edges: int | None) -> None:
    closed = 0
    points, normals = _grasps(21, 30, 4)
    for p, n in zip(points, normals, strict=True):
        proof = certify_force_closure(p, n, friction=0.5, edges=edges)
        closed += proof.holds
        if proof.holds:
            assert proof.separating_wrench is None
            assert (proof.weights > 0.0).all()
            np.testing.assert_allclose(proof.weights @ proof.wrenches, 0.0, atol=1e-9)
            assert np.linalg.matrix_rank(proof.wrenches) == 6
            center = p.mean(axis=0)
            length = np.linalg.norm(p - center, axis=1).max()
            forces = proof.wrenches[:, :3]  # each inside a cone of unit normal force
            sizes = np.sqrt((forces**2).sum(axis=1))
            np.testing.assert_array_less(sizes, np.hypot(1.0, 0.5) + 1e-9)
            assert length > 0.0
        else:
            # Nothing that any contact can do has a positive product with it: by sampled cones.
            center = p.mean(axis=0)
            length = np.linalg.norm(p - center, axis=1).max()
            W = contact_wrenches(
                p, n, friction=0.5, origin=center, length_scale=length, edges=edges or 90
            ).reshape(-1, 6)
            assert (W @ proof.separating_wrench).max() <= 2e-7
    assert 0 < closed < 30


def test_round_cones_close_wherever_their_pyramids_do_and_sometimes_where_they_do_not() -> None:
    # Nguyen: antipodal soft contacts close if the line between them is inside both cones. A pyramid
    # of four edges, turned away from the line, is too narrow; the round cone is not.
    tilt = 0.45
    points = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    normals = np.array([[np.cos(tilt), np.sin(tilt), 0.0], [-np.cos(tilt), np.sin(tilt), 0.0]])
    R = Rotation.from_rotvec([0.7, 0.2, 0.5]).as_matrix()
    points, normals = points @ R.T, normals @ R.T
    soft = {"model": "soft_finger", "torsion": 0.1, "friction": np.tan(tilt) * 1.02}
    assert is_force_closure(points, normals, edges=None, **soft)
    assert not is_force_closure(points, normals, edges=4, **soft)
    soft["friction"] = np.tan(tilt) * 0.98
    assert not is_force_closure(points, normals, edges=None, **soft)


def test_min_weight_times_the_width_of_the_hull_bounds_epsilon() -> None:
    # 0 = sum a_k w_k, a_k >= t: along any u, max w u >= t (max w u - min w u).
    points, normals = _grasps(31, 20, 4)
    bounds = 0
    for p, n in zip(points, normals, strict=True):
        W = contact_wrenches(
            p,
            n,
            friction=0.8,
            origin=p.mean(axis=0),
            length_scale=np.linalg.norm(p - p.mean(axis=0), axis=1).max(),
        ).reshape(-1, 6)
        hull = ConvexHull(W)
        worst = hull.equations[np.argmax(hull.equations[:, -1]), :6]
        least = min_weight(p, n, friction=0.8) / len(W)
        reach = W @ worst
        bounds += least > 1e-6
        assert epsilon_quality(p, n, friction=0.8) >= least * np.ptp(reach) - 1e-12
    assert bounds > 10


def test_the_volume_is_the_same_about_any_origin_and_grows_with_friction() -> None:
    (p,), (n,) = _grasps(41, 1, 4)
    about = [
        wrench_volume(p, n, friction=0.5, origin=origin, length_scale=1.0)
        for origin in ([0.0, 0.0, 0.0], [0.3, -0.2, 0.7])
    ]
    assert about[0] == pytest.approx(about[1], rel=1e-9)
    assert wrench_volume(p, n, friction=0.6, **FIXED) > about[0] > 0.0
    assert wrench_volume(AXES, AXES, friction=0.0) == 0.0


def test_isotropy_is_one_where_forces_in_all_directions_turn_as_well_as_push() -> None:
    # Six contacts on the axes: sum of (r x)(r x)^T is 4 I over 6 I of forces, so sqrt(2 / 3).
    assert isotropy(AXES, **FIXED) == pytest.approx(np.sqrt(2.0 / 3.0))
    # At the length sqrt(2/3), torques count as much as forces.
    assert isotropy(AXES, origin=np.zeros(3), length_scale=np.sqrt(2 / 3)) == pytest.approx(1.0)
    # Two hard fingers cannot turn an object about the line through both.
    assert isotropy(AXES[[0, 3]]) == pytest.approx(0.0, abs=1e-12)
    assert isotropy(AXES[:1]) == 0.0


def test_a_soft_fingers_torque_adds_to_that_of_its_squeeze() -> None:
    # Off the origin, with a normal that misses it: the squeeze itself has a torque.
    p, n = np.array([[0.1, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    W = contact_wrenches(p, n, friction=0.5, model="soft_finger", torsion=0.02, **FIXED)[0]
    squeeze = np.concatenate([-n[0], np.cross(p[0], -n[0])])
    np.testing.assert_allclose(W[-2:].mean(axis=0), squeeze, atol=1e-12)
    np.testing.assert_allclose(np.abs(W[-2] - squeeze), [0, 0, 0, 0, 0.02, 0], atol=1e-12)


def test_the_linear_programme_of_a_separating_wrench_agrees_with_feasibility() -> None:
    points, normals = _grasps(51, 40, 3)
    for p, n in zip(points, normals, strict=True):
        W = contact_wrenches(p, n, friction=0.4, origin=p.mean(axis=0), length_scale=1.0)
        W = W.reshape(-1, 6)
        # Is zero a combination with all weights at least 1? (scaled: strictly positive ones)
        oracle = linprog(np.zeros(len(W)), A_eq=W.T, b_eq=np.zeros(6), bounds=(1.0, 1e7))
        assert is_force_closure(p, n, friction=0.4) == (oracle.status == 0)


def test_grasps_that_are_no_batch_or_limits_that_are_none_are_refused() -> None:
    with pytest.raises(InvalidContactsError, match="B, C, 3"):
        epsilon_qualities(AXES, AXES, friction=0.5)
    with pytest.raises(InvalidContactsError, match="C, 3"):
        epsilon_quality(AXES[None], AXES[None], friction=0.5)
    with pytest.raises(InvalidOptionError, match="limit"):
        epsilon_quality(AXES, AXES, friction=0.5, limit="all")  # type: ignore[arg-type]
    with pytest.raises(InvalidOptionError, match="model"):
        epsilon_quality(AXES, AXES, friction=0.5, model="wet", edges=None)  # type: ignore[arg-type]


def test_grasps_whose_wrenches_lie_flat_have_the_epsilon_of_their_hulls() -> None:
    # Soft fingers opposite each other: ten wrenches each in a space of three dimensions, so that
    # many facets are flat but for the joggle.
    rng = np.random.default_rng(61)
    count = 60
    soft = {"friction": 0.8, "model": "soft_finger", "torsion": 0.005, "length_scale": 0.05}
    points = np.tile([[0.0, 0.03, 0.0], [0.0, -0.03, 0.0]], (count, 1, 1))
    points[:, :, ::2] += rng.uniform(-0.02, 0.02, size=(count, 1, 2))
    normals = points * [0.0, 1.0, 0.0] / 0.03
    normals += rng.choice([0.0, 1e-9, 1e-6, 1e-3], size=(count, 1, 1)) * rng.normal(
        size=normals.shape
    )
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    together = epsilon_qualities(points, normals, origin=np.zeros(3), **soft)
    alone = [
        epsilon_quality(p, n, origin=np.zeros(3), **soft)
        for p, n in zip(points, normals, strict=True)
    ]
    np.testing.assert_allclose(together, alone, atol=2e-5)
