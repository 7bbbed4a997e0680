"""The grasp sampler: its grasps are in force closure, reachable, and free of collision."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from made_grasps import jaw_grasp
from scipy.spatial import cKDTree

from lis_grasp import ForceClosureSampler, GraspSearch, Hand, is_force_closure, shapes
from lis_grasp.evaluation.surface_error import sample_segments
from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.grasping import sampler as sampler_module
from lis_grasp.grasping._antipodal_sampling import sample_contact_sets
from lis_grasp.grasping._candidate_filter import CandidateFilter
from lis_grasp.grasping._candidate_ranking import ranks_of
from lis_grasp.grasping._contact_samples import SurfaceSamples
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasp_quality import GraspScorer
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.grasping.sampler import perturb_grasps
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.shapes.mesh_distance import distances_to_mesh

ALLEGRO, JAW = Hand.load("allegro"), Hand.load("wsg50")


def _search(
    hand: Hand, name: str, seed: int = 0, candidates: int = 200, count: int = 5
) -> GraspSearch:
    shape = shapes.build(name)
    sampler = ForceClosureSampler(hand, friction=0.8, candidates=candidates)
    return sampler.sample(
        shape.mesh,
        rng=np.random.default_rng(seed),
        support_height=float(shape.mesh.bounds[0, 2]),
        count=count,
    )


@pytest.fixture(scope="module")
def box_search() -> GraspSearch:
    return _search(ALLEGRO, "box", count=3)


def test_a_hand_finds_grasps_in_force_closure_on_a_box(box_search: GraspSearch) -> None:
    assert box_search.grasps
    for grasp in box_search.grasps:
        assert is_force_closure(grasp.contact_points, grasp.contact_normals, friction=0.8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mallet", "cylinder"])
def test_a_hand_finds_grasps_in_force_closure_on(name: str) -> None:
    test_a_hand_finds_grasps_in_force_closure_on_a_box(_search(ALLEGRO, name))


@pytest.mark.parametrize("name", ["box", pytest.param("cylinder", marks=pytest.mark.slow)])
def test_a_parallel_jaw_gripper_finds_antipodal_grasps_on(name: str) -> None:
    search = _search(JAW, name, count=2)
    assert search.grasps
    for grasp in search.grasps:
        first, second = grasp.contact_normals
        line = grasp.contact_points[1] - grasp.contact_points[0]
        line /= np.linalg.norm(line)
        # Nguyen 1988: the line between the contacts is inside both friction cones.
        assert -line @ first > np.cos(np.arctan(0.8))
        assert line @ second > np.cos(np.arctan(0.8))


def test_contacts_are_on_the_surface_with_its_normal(box_search: GraspSearch) -> None:
    mesh = shapes.build("box").mesh
    for grasp in box_search.grasps:
        _, distance, faces = mesh.nearest.on_surface(grasp.contact_points)
        np.testing.assert_allclose(distance, 0.0, atol=1e-9)
        np.testing.assert_allclose(mesh.face_normals[faces], grasp.contact_normals, atol=1e-9)


def test_pads_touch_their_contacts(box_search: GraspSearch) -> None:
    for grasp in box_search.grasps:
        centers = ALLEGRO.pad_centers(grasp.X_OH, grasp.joint_positions)
        used = [ALLEGRO.fingers.index(finger) for finger in grasp.contact_fingers]
        radii = np.array([ALLEGRO.pads[f].radius for f in used])
        expected = grasp.contact_points + radii[:, None] * grasp.contact_normals
        # The sampler's own bound on a pad's error.
        assert np.linalg.norm(centers[used] - expected, axis=1).max() <= 0.0015


def test_no_link_collides_at_the_grasp_or_on_the_approach(box_search: GraspSearch) -> None:
    mesh = shapes.build("box").mesh
    height = float(mesh.bounds[0, 2])
    checker = HandCollisionChecker(ALLEGRO, mesh, support_height=height, clearance=0.0)
    for grasp in box_search.grasps:
        path, q = np.tile(grasp.X_OH, (1, 5, 1, 1)), grasp.joint_positions[None]
        assert checker.first_collisions(path[:, :1], q, pads_may_touch=True) == [None]
        path[0, :, :3, 3] -= np.linspace(0.0, 0.1, 5)[:, None] * grasp.approach_O
        assert checker.first_collisions(path, grasp.pregrasp_positions[None]) == [None]


def test_no_pad_is_pressed_into_the_surface_by_a_millimetre(box_search: GraspSearch) -> None:
    mesh = shapes.build("box").mesh
    for grasp in box_search.grasps:
        centers = ALLEGRO.pad_centers(grasp.X_OH, grasp.joint_positions)
        outside = -trimesh.proximity.signed_distance(mesh, centers)
        radii = np.array([pad.radius for pad in ALLEGRO.pads])
        assert np.all(radii - outside < 0.001)


def test_planned_forces_squeeze_in_balance(box_search: GraspSearch) -> None:
    for grasp in box_search.grasps:
        total = np.linalg.norm(grasp.contact_forces, axis=1).sum()
        assert total > ALLEGRO.max_contact_force
        assert np.linalg.norm(grasp.contact_forces.sum(axis=0)) < 0.01 * total


def test_grasps_are_ranked_by_predicted_success(box_search: GraspSearch) -> None:
    qualities = [grasp.quality for grasp in box_search.grasps]
    values = ranks_of(GraspBatch.of_grasps(box_search.grasps, ALLEGRO))
    assert (np.diff(values) <= 0.0).all()
    for quality in qualities:
        assert 0.0 < quality["success_probability"] < 1.0
        assert quality["epsilon"] >= quality["epsilon_robust"]
        assert quality["weight_robust"] > 0.0
        # It is at half the friction, not three quarters; contacts on faces move by a millimetre.
        assert 0.2 < quality["load_expected"] / quality["load_per_grip"] < 1.0
        assert quality["closure_probability"] == 1.0


def test_grasps_that_cannot_succeed_as_required_are_rejected_early() -> None:
    mesh, rng = shapes.build("box").mesh, np.random.default_rng(3)
    samples = SurfaceSamples(mesh, lowest=-np.inf, rng=rng)
    sets, _ = sample_contact_sets(ALLEGRO, samples, count=80, rng=rng)
    candidate_filter = CandidateFilter(ALLEGRO, mesh, support_height=None)
    _, candidates = candidate_filter.solve_and_filter(sets)
    scorer = GraspScorer(ALLEGRO, mesh, prior=LoadPrior(), rng=rng)
    indices, every = scorer.score(candidates)
    least = np.median(every.quality["success_probability"])
    assert scorer.rejected["outranked"] == 0
    kept, some = scorer.score(candidates, np.full(len(candidates), least))
    assert 0 < scorer.rejected["outranked"] == len(every) - len(some)
    likely = np.flatnonzero(every.quality["success_probability"] >= least)
    again = np.searchsorted(kept, indices[likely])
    np.testing.assert_array_equal(kept[again], indices[likely])
    for name, values in every.quality.items():
        np.testing.assert_array_equal(some.quality[name][again], values[likely])


def test_a_grasp_that_does_not_close_on_a_true_mesh_has_no_probability_of_closure() -> None:
    hand, mesh = Hand.load("wsg50"), trimesh.creation.box((0.04, 0.04, 0.04))
    closed = jaw_grasp(hand, np.zeros(3), 0.04)
    skewed = replace(closed, contact_normals=np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))
    scorer = GraspScorer(hand, mesh, prior=LoadPrior(), rng=np.random.default_rng(0))
    quality = scorer.predict_success(GraspBatch.of_grasps([closed, skewed], hand)).quality
    np.testing.assert_array_equal(quality["epsilon"] > 0.0, [True, False])
    np.testing.assert_array_equal(quality["closure_probability"], [1.0, 0.0])


@pytest.mark.slow
def test_a_more_uncertain_surface_lowers_the_predicted_success(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sampler_module, "_STEPS", ())  # so that some grasps are the same
    found = []
    for deviation in (0.0, 0.001, 0.01):
        mesh = trimesh.creation.box((0.05, 0.06, 0.10))
        mesh.vertex_attributes["uncertainty"] = np.full(len(mesh.vertices), deviation)
        search = ForceClosureSampler(ALLEGRO, candidates=120).sample(
            mesh, rng=np.random.default_rng(0), support_height=-0.05, count=20
        )
        found.append({grasp.X_OH.tobytes(): grasp.quality for grasp in search.grasps})
    shared = set.intersection(*(set(grasps) for grasps in found))
    assert shared
    for name in ("success_probability", "load_expected", "closure_probability"):
        means = [np.mean([grasps[X][name] for X in shared]) for grasps in found]
        assert means[0] >= means[1] > means[2]


def test_every_candidate_is_accounted_for(box_search: GraspSearch) -> None:
    assert len(box_search.grasps) + sum(box_search.rejections.values()) == box_search.candidates


@pytest.mark.slow
@pytest.mark.parametrize(("hand", "name"), [(ALLEGRO, "mallet"), (JAW, "box")])
def test_grasps_turn_and_move_with_the_object(hand: Hand, name: str) -> None:
    mesh = shapes.build(name).mesh
    X = trimesh.transformations.rotation_matrix(0.7, [0.0, 0.0, 1.0])
    X[:3, 3] = [0.3, -0.2, 0.05]
    moved = mesh.copy()
    moved.apply_transform(X)
    here, there = (
        ForceClosureSampler(hand, candidates=50).sample(
            body,
            rng=np.random.default_rng(0),
            support_height=float(body.bounds[0, 2]),
            count=2,
        )
        for body in (mesh, moved)
    )
    assert len(here.grasps) == len(there.grasps) > 1
    for first, second in zip(here.grasps, there.grasps, strict=True):
        np.testing.assert_allclose(X @ first.X_OH, second.X_OH, atol=1e-9)
        # Epsilon in a batch is exact to some millionths.
        chances = [g.quality["success_probability"] for g in (first, second)]
        assert chances[0] == pytest.approx(chances[1], abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mallet", "torus"])
def test_refinement_raises_the_rank_of_grasps(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    refined = _search(ALLEGRO, name, seed=5)
    monkeypatch.setattr(sampler_module, "_STEPS", ())
    drawn = _search(ALLEGRO, name, seed=5)
    chances = [
        ranks_of(GraspBatch.of_grasps(search.grasps, ALLEGRO)) for search in (drawn, refined)
    ]
    assert all(after >= before for before, after in zip(*chances, strict=True))
    assert chances[1][0] >= chances[0][0]
    assert chances[1].sum() > chances[0].sum()
    # Ten variations of each are tried at the most.
    assert drawn.candidates < refined.candidates <= drawn.candidates + 10 * len(drawn.grasps)


@pytest.mark.slow
def test_perturbed_contacts_are_on_the_surface_near_the_original_ones(
    box_search: GraspSearch,
) -> None:
    mesh, rng = shapes.build("box").mesh, np.random.default_rng(0)
    samples = SurfaceSamples(mesh, lowest=-np.inf, rng=rng)
    grasps = box_search.grasps
    batch = GraspBatch.of_grasps(grasps, ALLEGRO)
    parents, sets = perturb_grasps(ALLEGRO, batch, samples, each=30, distance=0.004, rng=rng)
    assert len(parents) == len(sets) > 15 * len(grasps)
    for parent, points, normals, used in zip(
        parents, sets.points, sets.normals, sets.used, strict=True
    ):
        fingers = [f for f, on in zip(ALLEGRO.fingers, used, strict=True) if on]
        assert fingers == list(grasps[parent].contact_fingers)
        off, faces = distances_to_mesh(points[used], mesh)
        assert off.max() < 1e-9
        np.testing.assert_allclose(mesh.face_normals[faces], normals[used], atol=1e-9)
        assert np.linalg.norm(points[used] - grasps[parent].contact_points, axis=1).max() < 0.03


def test_perturbed_contacts_stay_on_usable_surface(box_search: GraspSearch) -> None:
    mesh, rng = shapes.build("box").mesh, np.random.default_rng(0)
    lowest = float(mesh.bounds[0, 2]) + 0.03
    samples = SurfaceSamples(mesh, lowest=lowest, rng=rng)
    batch = GraspBatch.of_grasps(box_search.grasps, ALLEGRO)
    _, sets = perturb_grasps(ALLEGRO, batch, samples, each=50, distance=0.02, rng=rng)
    assert len(sets)
    # A contact may be 5 mm beside its sample.
    assert sets.points[sets.used][:, 2].min() > lowest - 0.005


@pytest.mark.slow
def test_the_same_seed_finds_the_same_grasps_and_another_seed_others() -> None:
    first, again, other = (_search(JAW, "box", seed, 20, count=1) for seed in (1, 1, 2))
    assert np.array_equal(first.grasps[0].X_OH, again.grasps[0].X_OH)
    assert not np.array_equal(first.grasps[0].X_OH, other.grasps[0].X_OH)


def test_an_object_too_wide_for_the_hand_gives_reasons_instead_of_grasps() -> None:
    mesh = trimesh.creation.box((0.4, 0.4, 0.4))
    search = ForceClosureSampler(JAW, candidates=20).sample(
        mesh, rng=np.random.default_rng(0), support_height=-0.2
    )
    assert search.grasps == ()
    # Twenty where it is flat, twenty across bends, too, and five of each last resort.
    assert sum(search.rejections.values()) == search.candidates == 50


def test_a_shallow_dish_too_wide_for_the_gripper_is_pinched_at_its_rim() -> None:
    radius, wall, half_angle = 0.12, 0.005, np.deg2rad(55.0)
    angles = np.linspace(0.0, half_angle, 12)
    arc = np.column_stack([np.sin(angles), -np.cos(angles)])
    profile = np.vstack([radius * arc, (radius - wall) * arc[::-1]])
    dish = trimesh.creation.revolve(profile, sections=48)
    search = ForceClosureSampler(JAW, candidates=1200).sample(
        dish, rng=0, support_height=-radius, count=1
    )
    # Inside and outside of the wall, within the wall's slope of the vertical.
    outside = np.linalg.norm(search.best.contact_points, axis=1) > radius - 0.5 * wall
    assert sorted(outside) == [False, True]
    assert (np.abs(search.best.contact_normals[:, 2]) > np.sin(np.deg2rad(35.0))).all()


@pytest.mark.slow
def test_fingers_come_closer_together_where_an_object_is_narrower_than_they_are_apart() -> None:
    index, _, ring, thumb = ALLEGRO.pads
    posture = next(iter(ALLEGRO.pregrasps.values())).copy()
    for pad, limits in ((index, ALLEGRO.upper), (ring, ALLEGRO.lower)):
        joint = min(ALLEGRO.finger_joints(pad.finger))
        posture[joint] = limits[joint]
    hand = replace(
        ALLEGRO, pads=(index, ring, thumb), pregrasps={"spread": posture, **ALLEGRO.pregrasps}
    )
    apart = np.ptp(hand.pad_centers(np.eye(4), posture)[:2], axis=0)
    side = 0.04
    assert 0.55 * np.linalg.norm(apart) > 2.0 * side  # the least of the usual spreads
    search = ForceClosureSampler(hand, candidates=50).sample(
        trimesh.creation.box((side, side, side)), rng=np.random.default_rng(0), count=1
    )
    assert search.candidates > 2 * 50
    assert search.grasps
    for grasp in search.grasps:
        first, second = (
            grasp.contact_points[grasp.contact_fingers.index(pad.finger)] for pad in (index, ring)
        )
        assert np.linalg.norm(first - second) < 0.55 * np.linalg.norm(apart)


@pytest.mark.slow
@pytest.mark.parametrize("width", [0.006, 0.011])
def test_a_bar_narrower_than_a_pad_is_grasped_at_the_middle_of_its_faces(width: float) -> None:
    bar = trimesh.creation.box((width, width, 0.12))
    search = ForceClosureSampler(JAW, candidates=1000).sample(
        bar, rng=np.random.default_rng(0), support_height=-0.06, count=2
    )
    assert search.grasps
    assert search.rejections["no_flat_supported_surface"] == 1000
    assert search.candidates > 1000
    for grasp in search.grasps:
        normals, points = grasp.contact_normals, grasp.contact_points
        np.testing.assert_array_equal(np.sort(np.abs(normals), axis=1), [[0, 0, 1], [0, 0, 1]])
        # Both edges are under the pad, or it is as far from one as from the other.
        beside = (points * (1.0 - np.abs(normals)))[:, :2]
        assert np.abs(beside).max() < max(0.006 - width / 2.0, 0.001)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.004, 0.008])
def test_a_parallel_jaw_gripper_grasps_a_thin_rod(radius: float) -> None:
    rod = trimesh.creation.cylinder(radius=radius, height=0.12, sections=64)
    search = ForceClosureSampler(JAW, candidates=1000).sample(
        rod, rng=np.random.default_rng(0), support_height=-0.06, count=2
    )
    assert search.grasps
    for grasp in search.grasps:
        from_axis = np.linalg.norm(grasp.contact_points[:, :2], axis=1)
        # On the surface, which goes by chords.
        assert from_axis.max() <= radius + 1e-9
        assert from_axis.min() >= radius * np.cos(np.pi / 64) - 1e-9
        assert np.abs(grasp.contact_points[:, 2]).max() < 0.06 - 0.005


@pytest.mark.slow
def test_pads_may_press_on_balls_and_rods_but_not_beside_edges_or_in_grooves() -> None:
    def samples(mesh: trimesh.Trimesh) -> SurfaceSamples:
        return SurfaceSamples(mesh, lowest=-1.0, rng=np.random.default_rng(0), bends=True)

    assert len(samples(trimesh.creation.icosphere(4, radius=0.010))) == 4000
    rod = samples(trimesh.creation.cylinder(radius=0.005, height=0.06, sections=64))
    heights = np.abs(rod.points[:, 2])
    side = np.abs(rod.normals[:, 2]) < 0.5
    assert heights[side].max() < 0.03 - 0.0055
    assert side.sum() > 0.9 * 4000 * 0.048 / 0.065  # 6 mm less at either end; ends count as 5 mm
    # A wedge of 20 degrees is a blade at its thin end: no sample is on it or beside it.
    blade = trimesh.convex.convex_hull(
        [[0, y, z] for y in (-0.03, 0.03) for z in (0,)]
        + [[0.05, y, z] for y in (-0.03, 0.03) for z in (-0.0088, 0.0088)]
    )
    assert samples(blade).points[:, 0].min() > 0.0055
    # A rod of the same radius as that above, but drilled out of a block.
    drilled = trimesh.creation.annulus(r_min=0.005, r_max=0.04, height=0.06, sections=64)
    found = samples(drilled)
    radii = np.linalg.norm(found.points[:, :2], axis=1)
    in_bore = (np.abs(found.normals[:, 2]) < 0.5) & (radii < 0.02)
    assert not in_bore.any()
    assert radii.min() > 0.0059  # on the ends, at least 1 mm beside the bore's edge


@pytest.mark.slow
def test_triangles_without_area_give_no_contact_samples() -> None:
    box = trimesh.creation.box((0.06, 0.06, 0.10))
    a, b, c = (int(v) for v in box.faces[0])
    first = len(box.vertices)
    between = [0.5 * (box.vertices[a] + box.vertices[b]), 0.75 * box.vertices[a]]
    between[1] = between[1] + 0.25 * box.vertices[b]
    m, k = first, first + 1  # a, k, m, b along one edge
    faces = [(a, b, m), (a, m, k), (a, k, c), (k, m, c), (m, b, c)]
    slivers = trimesh.Trimesh(
        np.vstack([box.vertices, between]), np.vstack([box.faces[1:], faces]), process=False
    )
    assert slivers.is_watertight
    assert np.sum(slivers.area_faces == 0.0) == 2
    samples = SurfaceSamples(slivers, lowest=-1.0, rng=np.random.default_rng(0), bends=True)
    np.testing.assert_allclose(np.linalg.norm(samples.normals, axis=1), 1.0)


def test_surface_that_no_touch_supports_is_not_grasped() -> None:
    mesh = trimesh.creation.box((0.05, 0.06, 0.10)).subdivide_to_size(0.008)
    # Only the part with z > 0 was touched.
    uncertain = np.where(mesh.vertices[:, 2] > 0.0, 0.001, 0.05)
    mesh.vertex_attributes["uncertainty"] = uncertain
    search = ForceClosureSampler(JAW, candidates=30).sample(
        mesh, rng=np.random.default_rng(0), support_height=-0.05, count=1
    )
    assert search.grasps
    for grasp in search.grasps:
        # A face counts by the mean of its corners, 8 mm apart; a contact may be 5 mm beside it.
        assert grasp.contact_points[:, 2].min() > -0.013


def test_an_open_mesh_is_refused() -> None:
    mesh = trimesh.creation.box((0.05, 0.05, 0.05))
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    with pytest.raises(InvalidMeshError):
        ForceClosureSampler(JAW).sample(mesh, rng=np.random.default_rng(0))


@pytest.mark.parametrize("options", [{"friction": 0.0}, {"candidates": 0}])
def test_options_out_of_range_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(InvalidOptionError) as error:
        ForceClosureSampler(JAW, **options)  # type: ignore[arg-type]
    assert error.value.option == next(iter(options))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pentagon", "box", "mallet"])
def test_contacts_stay_off_edges_and_on_the_object(name: str) -> None:
    shape = shapes.build(name)
    search = ForceClosureSampler(ALLEGRO).sample(
        shape.mesh,
        rng=np.random.default_rng(3),
        support_height=shape.mesh.bounds[0, 2],
        count=5,
    )
    points = np.concatenate([grasp.contact_points for grasp in search.grasps])
    off, _ = distances_to_mesh(points, shape.mesh)
    # On flat faces exactly; where a face is curved, its tangent leaves it within the 5 mm between a
    # contact and its sample: 5^2 / (2 r), r of at least 12 mm here.
    assert off.max() < 1.1e-3
    edge = sample_segments(shape.edges, 4000)
    assert cKDTree(edge).query(points)[0].min() > 0.5e-3


@pytest.mark.slow
def test_pads_may_press_on_straight_convex_edges() -> None:
    box = trimesh.creation.box((0.06, 0.06, 0.10))
    plain, more = (
        SurfaceSamples(box, lowest=-0.04, rng=np.random.default_rng(0), bends=bends)
        for bends in (False, True)
    )

    def at_faces(points: np.ndarray) -> np.ndarray:
        return np.isclose(np.abs(points), [0.03, 0.03, 0.05])

    assert not (at_faces(plain.points).sum(axis=1) > 1).any()
    # On two faces at once, their normals' sum over sqrt(2); at corners there is no straight edge.
    on_edge = at_faces(more.points).sum(axis=1) > 1
    points, normals = more.points[on_edge], more.normals[on_edge]
    at_face = at_faces(points)
    np.testing.assert_array_equal(at_face.sum(axis=1), 2)
    np.testing.assert_allclose(normals, np.sign(points) * at_face / np.sqrt(2.0), atol=1e-12)
    corners = np.array([0.03, 0.03, 0.05])
    assert np.linalg.norm(np.abs(points) - corners, axis=1).min() > 0.005
    assert points[:, 2].min() > -0.04
    # All round the top, 6 cm less 6 mm at either end, and four edges of 9 cm less 6 mm.
    assert len(points) == pytest.approx(1000 * (4 * 0.048 + 4 * 0.084), rel=0.05)
    # Concave edges are no place for a pad.
    mallet = shapes.build("mallet").mesh
    concave = ~mallet.face_adjacency_convex & (mallet.face_adjacency_angles > 0.5)
    inner = sample_segments(mallet.vertices[mallet.face_adjacency_edges[concave]], 4000)
    both = SurfaceSamples(mallet, lowest=-1.0, rng=np.random.default_rng(0), bends=True)
    assert cKDTree(inner).query(both.points)[0].min() > 1e-3


@pytest.mark.slow
def test_bends_are_tried_too_where_grasps_of_flat_surface_are_not_likely_to_hold(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sampler_module, "_ENOUGH", 1000)  # never enough
    drawn = []
    for likely in (0.0, 1.0):
        monkeypatch.setattr(sampler_module, "_LIKELY", likely)
        search = _search(JAW, "box", candidates=60, count=2)
        assert len(search) == 2
        drawn.append(search.candidates)
    assert drawn[0] < 2 * 60 <= drawn[1]


@pytest.mark.slow
def test_a_parallel_jaw_gripper_grasps_a_pentagon_at_an_edge() -> None:
    pentagon = shapes.build("pentagon")
    search = _search(JAW, "pentagon", candidates=400)
    assert search.grasps
    assert search.candidates > 400
    for grasp in search.grasps:
        from_edge, _ = cKDTree(sample_segments(pentagon.edges, 4000)).query(grasp.contact_points)
        # One pad on a face, the other across the edge on its far side, normals opposed.
        assert np.sort(from_edge)[0] < 2e-3 < np.sort(from_edge)[1]
        np.testing.assert_allclose(grasp.contact_normals.sum(axis=0), 0.0, atol=0.05)


def _walls(name: str) -> trimesh.Trimesh:
    """Return obstacles round the box of 84 x 60 x 120 mm, which is at the origin [m]."""
    bin_ = trimesh.creation.box(extents=[0.7, 0.7, 0.7])
    board = trimesh.creation.box(extents=[1.0, 1.0, 0.02])
    match name:
        case "wall":
            board.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
            board.apply_translation([-0.082, 0.0, 0.0])
        case "sheet":  # without an inside
            board = trimesh.Trimesh(
                [[-0.072, -1, -1], [-0.072, 1, -1], [-0.072, 0, 1.5]], [[0, 1, 2]], process=False
            )
        case "board":
            board.apply_translation([0.0, 0.0, 0.25])
        case "bin":
            upper = bin_.face_normals[:, 2] > 0.5
            return trimesh.Trimesh(bin_.vertices, bin_.faces[~upper])
        case "block":
            return bin_
    return board


def _points_of(hand: Hand, X_OH: np.ndarray, q: np.ndarray) -> np.ndarray:
    links = hand.forward_kinematics(X_OH, q)
    return np.vstack(
        [
            trimesh.transform_points(np.asarray(g.mesh.vertices), links[g.link] @ g.X_LG)
            for g in hand.link_geometries
        ]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "board",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("wall", "sheet", "bin", "block")),
    ],
)
def test_the_hand_stays_clear_of_obstacles_at_grasp_approach_and_lift(name: str) -> None:
    mesh, walls = shapes.build("box").mesh, _walls(name)
    sampler = ForceClosureSampler(JAW, candidates=200, obstacles=walls)
    search = sampler.sample(mesh, support_height=float(mesh.bounds[0, 2]), count=5)
    hits = {reason: n for reason, n in search.rejections.items() if reason.endswith("obstacle")}
    if name == "block":  # the hand is wholly inside of it
        assert not search.grasps
        assert set(hits) == {"grasp_hits_obstacle"}
        return
    assert search.grasps
    assert sum(hits.values()) > 0 or name == "bin"
    assert name != "board" or hits["lift_hits_obstacle"] > 0
    for grasp in search:
        for back, up, q in (
            *((back, 0.0, grasp.pregrasp_positions) for back in (0.0, 0.05, 0.12)),
            *((0.0, up, grasp.joint_positions) for up in (0.0, 0.05, 0.1)),
        ):
            X_OH = np.array(grasp.X_OH)
            X_OH[:3, 3] += [0.0, 0.0, up] - back * grasp.approach_O
            points = _points_of(JAW, X_OH, q)
            match name:
                case "wall" | "sheet":
                    assert points[:, 0].min() > -0.072 or points[:, 0].max() < -0.072
                case "board":
                    assert points[:, 2].max() < 0.24 or points[:, 2].min() > 0.26
                case "bin":
                    assert (np.abs(points[:, :2]) < 0.35).all()
