"""Grasps of low, thin and long objects on a support, and their ranking by inertia and levers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp import ForceClosureSampler, GraspSearch, Hand
from lis_grasp.grasping._antipodal_sampling import family_of
from lis_grasp.grasping._candidate_filter import fingertip_offsets
from lis_grasp.grasping._contact_samples import SurfaceSamples
from lis_grasp.grasping.contact_wrenches import inertial_metric, wrench_model
from lis_grasp.grasping.epsilon import ROBUST_FRACTION
from lis_grasp.grasping.force_closure import is_force_closure
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasp_quality import GraspScorer
from lis_grasp.grasping.grasps import Grasp, LoadPrior
from lis_grasp.grasping.hand_capacity import least_pinched_height
from lis_grasp.grasping.inverse_kinematics import solve_ik
from lis_grasp.results.summary import no_grasp_sentence
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.shipped_models import model_path

ALLEGRO, JAW = Hand.load("allegro"), Hand.load("wsg50")


def _on_table(mesh: trimesh.Trimesh, turn: list[float] | None = None) -> trimesh.Trimesh:
    if turn is not None:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, turn))
    mesh.apply_translation([0.0, 0.0, -mesh.bounds[0, 2]])
    return mesh


def _plan(hand: Hand, mesh: trimesh.Trimesh, candidates: int = 2000) -> GraspSearch:
    sampler = ForceClosureSampler(hand, candidates=candidates)
    return sampler.sample(mesh, rng=np.random.default_rng(0), support_height=0.0, count=2)


def _assert_clear(hand: Hand, mesh: trimesh.Trimesh, search: GraspSearch) -> None:
    checker = HandCollisionChecker(hand, mesh, support_height=0.0, clearance=0.0)
    for grasp in search.grasps:
        X_OH, q = grasp.X_OH[None, None], grasp.joint_positions[None]
        assert checker.first_collisions(X_OH, q, pads_may_touch=True) == [None]
        np.testing.assert_array_less(0.0, grasp.contact_points[:, 2])


def _assert_held_by_sides(grasp: Grasp, half_widths: list[float]) -> None:
    """Assert that contacts oppose each other on the sides of a box about the z axis."""
    on_side = np.isclose(np.abs(grasp.contact_points[:, :2]), half_widths, atol=1e-9).any(axis=1)
    normals = grasp.contact_normals[on_side]
    # Pads on upper edges push sideways rather than down.
    np.testing.assert_array_less(normals[:, 2], 0.5)
    assert (normals @ normals.T).min() < -0.7


@pytest.mark.slow
@pytest.mark.parametrize("hand", [ALLEGRO, JAW], ids=lambda hand: hand.name)
@pytest.mark.parametrize(
    ("extents", "candidates"), [((0.2, 0.1, 0.012), 2000), ((0.2, 0.03, 0.004), 1000)]
)
def test_plates_and_rulers_are_grasped_by_their_sides(
    hand: Hand, extents: tuple[float, ...], candidates: int
) -> None:
    plate = _on_table(trimesh.creation.box(extents))
    search = _plan(hand, plate, candidates=candidates)
    assert search.grasps
    _assert_clear(hand, plate, search)
    for grasp in search.grasps:
        _assert_held_by_sides(grasp, [0.5 * extents[0], 0.5 * extents[1]])


@pytest.mark.slow
@pytest.mark.parametrize("hand", [ALLEGRO, JAW], ids=lambda hand: hand.name)
def test_a_lying_rod_of_16_mm_is_grasped(hand: Hand) -> None:
    rod = _on_table(trimesh.creation.cylinder(radius=0.008, height=0.15), turn=[0.0, 1.0, 0.0])
    search = _plan(hand, rod)
    assert search.grasps
    _assert_clear(hand, rod, search)


@pytest.mark.slow
def test_a_parallel_jaw_gripper_grasps_a_ball_of_30_mm_with_its_fingertips() -> None:
    ball = _on_table(trimesh.creation.icosphere(4, radius=0.015))
    search = _plan(JAW, ball, candidates=200)
    assert search.grasps
    _assert_clear(JAW, ball, search)
    for grasp in search.grasps:
        centers = JAW.pad_centers(grasp.X_OH, grasp.joint_positions)
        # The pads' centres are 16 mm above the fingertips, and the contacts at 15 mm.
        assert centers[:, 2].min() > grasp.contact_points[:, 2].max()


def test_a_flat_pad_ends_at_the_fingertip_and_a_rounded_one_has_no_other_points() -> None:
    # The finger with its nail is 74.5 mm long, the centre at 59 mm; half a millimetre is left out.
    np.testing.assert_allclose(fingertip_offsets(JAW), [[0.0, 0.0, 0.015]] * 2, atol=1e-12)
    np.testing.assert_array_equal(fingertip_offsets(ALLEGRO), np.zeros((4, 3)))


def test_inverse_kinematics_brings_other_points_of_the_pads_to_the_contacts() -> None:
    posture = JAW.pregrasps["medium"]
    normals = -JAW.pad_axes(np.eye(4), posture)[None]
    used = np.ones((1, 2), dtype=bool)
    middle = GraspBatch(0.02 * normals, normals, used, np.eye(4)[None], posture[None])
    offsets = np.array([[[0.0, 0.0, 0.009]] * 2])
    at_tips = replace(middle, offsets=offsets)
    first, second = solve_ik(JAW, middle), solve_ik(JAW, at_tips)
    assert max(first.position_error[0], second.position_error[0]) < 1e-4
    back = first.X_OH[0, :3, 3] - second.X_OH[0, :3, 3]
    np.testing.assert_allclose(back, [0.0, 0.0, 0.009], atol=1e-4)


def test_rounded_pads_on_edges_stay_above_the_support() -> None:
    plate = _on_table(trimesh.creation.box((0.2, 0.1, 0.012)))
    radius, lowest = 0.012, 0.001
    samples = SurfaceSamples(
        plate, lowest=lowest, rng=np.random.default_rng(0), bends=True, pad_radius=radius
    )
    level = np.abs(samples.normals[:, 2]) < 0.5
    assert level.sum() > 100
    lowest_of_pads = samples.points[:, 2] + radius * (samples.normals[:, 2] - 1.0)
    assert lowest_of_pads.min() > lowest
    # The side is lower than a pad's centre, so that only its upper edge is left.
    np.testing.assert_allclose(samples.points[level, 2], 0.012)
    assert samples.normals[level, 2].min() > 0.0


def test_the_inertial_metric_gives_the_accelerations_of_a_unit_mass() -> None:
    a, b, c = 0.3, 0.05, 0.1
    metric = inertial_metric(trimesh.creation.box((a, b, c)))
    # I / m of a box, and rotations as the acceleration at 0.65 m.
    by_mass = np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) / 12.0
    np.testing.assert_allclose(metric, np.diag(0.65 / by_mass), rtol=1e-9, atol=1e-9)


def _load_at(x: float, bar: trimesh.Trimesh) -> float:
    """Return the load per grip of a pinch of a bar across y, at a place x along it."""
    scorer = GraspScorer(JAW, bar, prior=LoadPrior(0.8), rng=np.random.default_rng(0))
    points = np.array([[[x, -0.0125, 0.0125], [x, 0.0125, 0.0125]]])
    normals = np.array([[[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]])
    used, q = np.ones((1, 2), dtype=bool), JAW.pregrasps["medium"][None]
    sets = GraspBatch(points, normals, used, np.eye(4)[None], q)
    return float(scorer.loads_per_grip(sets)[0])


def test_a_lever_to_the_centre_of_mass_lowers_the_load() -> None:
    bar = _on_table(trimesh.creation.box((0.3, 0.025, 0.025)))
    found = [_load_at(x, bar) for x in (0.0, 0.03, 0.06, 0.12)]
    assert found == sorted(found, reverse=True)
    assert found[-1] < 0.7 * found[0]


@pytest.mark.slow
def test_a_hammer_is_grasped_near_its_centre_of_mass() -> None:
    handle = trimesh.creation.box((0.28, 0.025, 0.025))
    head = trimesh.creation.box((0.03, 0.1, 0.04)).apply_translation([0.14, 0.0, 0.0])
    hammer = _on_table(trimesh.boolean.union([handle, head], engine="manifold"))
    best = _plan(JAW, hammer).grasps[0]
    lever = best.contact_points[:, 0].mean() - hammer.center_mass[0]
    # The handle is 280 mm long.
    assert abs(lever) < 0.06


def test_a_long_object_carries_less_load_than_a_short_one() -> None:
    bars = [_on_table(trimesh.creation.box((length, 0.025, 0.025))) for length in (0.1, 0.3)]
    short, long = (_load_at(0.0, bar) for bar in bars)
    assert long < 0.7 * short


def test_the_wrench_model_multiplies_torques_by_the_metric() -> None:
    box = trimesh.creation.box((0.1, 0.06, 0.04))
    points = np.array([[0.05, 0.01, 0.0], [-0.05, 0.0, 0.01]])
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    for hand in (ALLEGRO, JAW):
        model = replace(wrench_model(box, hand, 0.8), length_scale=1.0)
        metric = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 4.0]])
        plain = model.wrenches(points, normals)
        scaled = replace(model, torque_metric=metric).wrenches(points, normals)
        np.testing.assert_allclose(scaled[..., :3], plain[..., :3])
        np.testing.assert_allclose(scaled[..., 3:], plain[..., 3:] @ metric.T, atol=1e-12)


@pytest.mark.parametrize(("factor", "closes"), [(0.97, False), (1.03, True)])
def test_round_fingertips_close_on_upper_edges_only_above_the_least_height(
    factor: float, closes: bool
) -> None:
    hand, friction = Hand.load("barrett"), 0.8
    radius = hand.pads[0].radius
    up = 1.0 - factor * least_pinched_height(hand, friction) / radius  # sine of the elevation
    # Many contacts round a disc, balls on the support against its upper edge.
    angles = 2.0 * np.pi * np.arange(24) / 24
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(24)])
    normals = np.sqrt(1.0 - up**2) * around + [0.0, 0.0, up]
    friction *= ROBUST_FRACTION
    # Of 64 edges, the pyramid is within 0.2 % of the cone.
    assert is_force_closure(0.05 * around, normals, friction=friction, edges=64) == closes


def test_a_hand_with_thick_fingertips_is_told_that_an_object_is_too_flat() -> None:
    hand, sheet = Hand.load("barrett"), _on_table(trimesh.creation.box((0.1, 0.03, 0.004)))
    search = ForceClosureSampler(hand).sample(sheet, support_height=0.0)
    assert list(search.rejections) == ["lower_than_fingertips"]
    assert "take thinner fingertips or a suction cup" in no_grasp_sentence(search.rejections)
    assert least_pinched_height(JAW, 0.8) == 0.0


@pytest.mark.slow
def test_a_hand_with_thick_fingertips_takes_its_narrow_pads_for_a_low_object(
    tmp_path: Path,
) -> None:
    text = model_path("hands/allegro/allegro.yaml").read_text()
    text = text.replace("urdf: allegro.urdf", f"urdf: {model_path('hands/allegro/allegro.urdf')}")
    (tmp_path / "narrow.yaml").write_text(text)
    thick = tmp_path / "thick.yaml"
    thick.write_text(text.replace("radius: 0.003, axis", "radius: 0.015, axis"))
    strip = _on_table(trimesh.creation.box((0.15, 0.03, 0.004)))
    assert _plan(Hand.load(thick), strip).rejections.keys() == {"lower_than_fingertips"}
    thick.write_text(thick.read_text() + "low_objects: narrow.yaml\n")
    hand = Hand.load(thick)
    assert hand.for_height(0.031) is hand  # a ball of 15 mm touches it at its equator
    best = _plan(hand, strip).best
    assert best.contact_points[:, 2].max() <= 0.004
    assert best.family == "flat_faces"


@pytest.mark.parametrize(
    ("up", "down", "floor", "family"),
    [(0.7, -0.7, -1.0, "rim"), (0.7, 0.7, -1.0, "pinch"), (0.0, 0.0, 0.0, "table")],
)
def test_a_grasp_is_named_by_where_it_pushes_and_by_what_it_slides_on(
    up: float, down: float, floor: float, family: str
) -> None:
    q = ALLEGRO.pregrasps["medium"]
    links = ALLEGRO.forward_kinematics(np.eye(4), q)
    tips = [g for g in ALLEGRO.link_geometries if g.link in ALLEGRO.fingertip_links]
    lowest = min((links[g.link] @ g.X_LG @ _corners(g.mesh))[2].min() for g in tips)
    normals = np.array([[np.sqrt(1.0 - z * z), 0.0, z] for z in (up, down)])
    assert family_of(ALLEGRO, np.eye(4), q, normals, lowest + floor) == family


def _corners(mesh: trimesh.Trimesh) -> np.ndarray:
    return np.column_stack([mesh.vertices, np.ones(len(mesh.vertices))]).T
