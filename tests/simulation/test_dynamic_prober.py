"""Dynamic prober: contacts are on the true surface with its normal, in holes too."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from random_directions import random_directions

from lis_grasp import shapes
from lis_grasp.exceptions import InvalidHandError, InvalidMeshError
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake import dynamic_prober
from lis_grasp.simulation.drake.contact_patches import split_patch
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber

RADIUS = 0.05


@pytest.fixture(scope="module", params=["allegro", "wsg50"])
def hand(request: pytest.FixtureRequest) -> Hand:
    return Hand.load(request.param)


@pytest.fixture(scope="module")
def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)


@pytest.fixture(scope="module")
def coarse_ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)


@pytest.fixture(scope="module")
def ball_prober(hand: Hand, ball: trimesh.Trimesh) -> DynamicProber:
    return DynamicProber(hand, ball)


def bytes_of(outcome: ProbeOutcome) -> list[bytes]:
    made = outcome.contacts
    arrays = (made.points, made.normals, made.forces, made.times, outcome.free_points)
    return [array.tobytes() for array in arrays]


@pytest.mark.parametrize(
    "hand", [pytest.param("allegro", marks=pytest.mark.slow), "wsg50"], indirect=True
)
def test_a_ball_is_touched_on_its_surface_with_a_radial_normal(ball_prober: DynamicProber) -> None:
    rng = np.random.default_rng(0)
    distances, angles = [], []
    for direction in random_directions(15, rng):
        offset = np.cross(direction, rng.normal(size=3))
        aim = 0.4 * RADIUS * offset / np.linalg.norm(offset)  # oblique: 24 deg to the normal
        target = aim - np.sqrt(RADIUS**2 - aim @ aim) * direction
        outcome = ball_prober.probe(Probe(target, direction, 0.03, 0.02))
        assert outcome.status == "touched"
        radii = np.linalg.norm(outcome.contacts.points, axis=1)
        distances += list(np.abs(radii - RADIUS))
        cosines = np.sum(outcome.contacts.normals * outcome.contacts.points, axis=1) / radii
        angles += list(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))))
    # The promised accuracy. The ball's facets alone are within 0.02 mm and 1.3 deg of it; a patch
    # of 2.5 mm radius on it has its centroid 0.03 mm below its top.
    assert np.mean(distances) < 0.5e-3
    assert np.quantile(distances, 0.95) < 1.5e-3
    assert np.mean(angles) < 1.5
    assert np.quantile(angles, 0.95) < 5.0


def test_a_box_is_touched_exactly(hand: Hand) -> None:
    sides = np.array([0.10, 0.08, 0.06])
    prober = DynamicProber(hand, trimesh.creation.box(extents=sides))
    rng = np.random.default_rng(1)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = sign * np.eye(3)[axis]
            target = 0.5 * sides * np.where(normal == 0.0, rng.uniform(-0.5, 0.5, 3), normal)
            direction = -normal + 0.3 * rng.uniform(-1.0, 1.0, 3)
            outcome = prober.probe(Probe(target, direction, 0.03, 0.02))
            assert outcome.status == "touched"
            contacts = outcome.contacts
            # A flat face of the mesh is flat in the contact: rounding alone.
            np.testing.assert_allclose(contacts.points[:, axis], target[axis], atol=1e-9)
            np.testing.assert_allclose(contacts.normals, [normal] * len(contacts), atol=1e-9)
            # The tip is deeper than at 0.2 N by less than a step, which adds a newton.
            assert np.all(contacts.forces > 0.0)
            assert 0.2 < contacts.forces.sum() < 2.0


def test_a_perpendicular_touch_is_at_the_target() -> None:
    prober = DynamicProber(Hand.load("allegro"), trimesh.creation.box(extents=[0.1, 0.1, 0.1]))
    outcome = prober.probe(Probe([0.01, -0.02, 0.05], [0.0, 0.0, -1.0], 0.03, 0.01))
    # The finger gives way by 0.2 N x 0.14 m / 5 N m/rad x 0.14 m: less than a millimetre.
    np.testing.assert_allclose(outcome.contacts.points, [[0.01, -0.02, 0.05]], atol=1e-3)
    assert outcome.contacts.fingers == ("index_tip",)
    # 30 mm at 0.1 m/s, and back at 0.25 m/s.
    assert outcome.duration == pytest.approx(0.03 / 0.1 + 0.03 / 0.25, abs=0.01)


@pytest.mark.by_default("wsg50")
def test_a_ring_is_entered_and_its_inner_side_touched(hand: Hand) -> None:
    ring = trimesh.creation.torus(
        major_radius=0.055, minor_radius=0.015, major_sections=96, minor_sections=48
    )
    prober = DynamicProber(hand, ring)
    through = prober.probe(Probe([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 0.04, 0.02))
    assert through.status == "missed"
    # Aimed at the tube from the inner side, 45 deg from above: well inside the convex hull.
    aim = np.array([-1.0, 0.0, 1.0]) / np.sqrt(2.0)
    target = np.array([0.055, 0.0, 0.0]) + 0.015 * aim
    inner = prober.probe(Probe(target, -aim, 0.03, 0.01))
    assert inner.status == "touched"
    point, normal = inner.contacts.points[0], inner.contacts.normals[0]
    ring_center = 0.055 * np.array([point[0], point[1], 0.0]) / np.hypot(point[0], point[1])
    # Chords of the facets are within 0.04 mm of the tube; with the patch's sag below 0.1 mm.
    assert np.linalg.norm(point - ring_center) == pytest.approx(0.015, abs=1e-4)
    assert np.degrees(np.arccos(normal @ (point - ring_center) / 0.015)) < 5.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mallet", "hollow_cylinder", "torus"])
def test_touches_of_objects_that_are_not_convex_keep_their_accuracy(name: str) -> None:
    shape = shapes.build(name)
    prober = DynamicProber(Hand.load("allegro"), shape.mesh)
    points, faces = trimesh.sample.sample_surface(shape.mesh, 20, seed=0)
    distances, angles = [], []
    for point, face in zip(points, faces, strict=True):
        outcome = prober.probe(Probe(point, -shape.mesh.face_normals[face], 0.025, 0.01))
        if outcome.status != "touched":
            continue
        _, distance, nearest = trimesh.proximity.closest_point(shape.mesh, outcome.contacts.points)
        cosines = np.sum(outcome.contacts.normals * shape.mesh.face_normals[nearest], axis=1)
        distances += list(distance)
        angles += list(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))))
    assert len(distances) >= 8
    assert np.quantile(distances, 0.95) < 1.5e-3
    assert np.quantile(angles, 0.95) < 5.0


def test_contacts_in_a_concave_corner_have_the_normals_of_its_sides() -> None:
    upright = trimesh.creation.box(extents=[0.02, 0.1, 0.1]).apply_translation([-0.04, 0.0, 0.05])
    corner = trimesh.boolean.union([trimesh.creation.box(extents=[0.1, 0.1, 0.02]), upright])
    prober = DynamicProber(Hand.load("allegro"), corner)
    outcome = prober.probe(Probe([-0.03, 0.0, 0.01], [-1.0, 0.0, -1.0], 0.04, 0.02))
    assert outcome.status == "touched"
    found = sorted(outcome.contacts.normals.round(6).tolist())
    # The side touched first stops the motion: one normal is certain, none is a mixture.
    assert all(normal in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]) for normal in found)
    np.testing.assert_allclose(np.linalg.norm(outcome.contacts.normals, axis=1), 1.0)


def test_a_patch_across_an_edge_is_split_into_its_sides() -> None:
    areas = np.array([3.0, 2.0, 1.0, 0.1])
    normals = np.array([[0, 0, 1.0], [1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]])
    centroids = np.array([[0, 0, 0.0], [5.0, 0, 0], [4.0, 0, 0], [9.0, 9, 9]])
    parts = split_patch("tip", areas, centroids, normals, np.zeros(4, np.int32), force=6.1)
    assert [part.normal.tolist() for part in parts] == [[0, 0, 1], [1, 0, 0]]
    np.testing.assert_allclose(parts[0].point, [1.0, 0.0, 0.0])
    assert [part.force for part in parts] == pytest.approx([4.0, 2.0])  # the sliver is dropped


def test_a_patch_on_both_sides_of_a_groove_is_split_at_the_gap() -> None:
    centroids = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    normals = np.array([[0, 0, 1.0], [0, 0, 1.0]])
    pieces = np.array([0, 1], np.int32)
    parts = split_patch("tip", np.array([2.0, 1.0]), centroids, normals, pieces, force=3.0)
    np.testing.assert_allclose([part.point for part in parts], centroids)
    assert [part.force for part in parts] == pytest.approx([2.0, 1.0])


def test_a_tip_across_a_groove_touches_both_of_its_rims() -> None:
    block = trimesh.creation.box(extents=[0.1, 0.1, 0.06]).apply_translation([0.0, 0.0, -0.03])
    groove = trimesh.creation.box(extents=[0.004, 0.2, 0.02])  # narrower than the tip
    prober = DynamicProber(Hand.load("allegro"), trimesh.boolean.difference([block, groove]))
    outcome = prober.probe(Probe([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 0.03, 0.01))
    assert outcome.status == "touched"
    # On the rims, 2 mm to either side: in the middle of the groove there is nothing.
    offsets = outcome.contacts.points[:, 0]
    assert offsets.min() < -0.0017
    assert offsets.max() > 0.0017
    assert np.all(np.abs(offsets) > 0.0017)


@pytest.mark.by_default("wsg50")
def test_the_path_of_a_miss_is_free_space(ball_prober: DynamicProber, hand: Hand) -> None:
    radius = next(iter(hand.probe_postures.values())).radius
    direction = np.array([1.0, 0.0, 0.0])
    outcome = ball_prober.probe(Probe([-0.1, 0.0, 0.0], direction, 0.03, 0.02))
    assert outcome.status == "missed"
    assert len(outcome.contacts) == 0
    assert outcome.duration == pytest.approx(0.05 / 0.1 + 0.05 / 0.25)
    # The sphere's centre, from the start on, a centimetre apart, to the end; then other links.
    along = -0.13 - radius + 0.01 * np.arange(6)
    np.testing.assert_allclose(outcome.free_points[:6], along[:, None] * direction, atol=1e-12)
    np.testing.assert_array_equal(outcome.free_radii[:6], radius)


def test_free_balls_do_not_cut_the_object(ball_prober: DynamicProber) -> None:
    for direction in random_directions(4, np.random.default_rng(2)):
        outcome = ball_prober.probe(Probe(-RADIUS * direction, direction, 0.04, 0.02))
        clearance = np.linalg.norm(outcome.free_points, axis=1) - RADIUS - outcome.free_radii
        assert len(outcome.free_points) >= 4
        assert clearance.min() > -0.2e-3  # the facets of the ball are so much within it


def test_a_start_partly_or_wholly_inside_the_object_is_blocked(
    ball_prober: DynamicProber, hand: Hand
) -> None:
    around = DynamicProber(hand, trimesh.creation.box(extents=[0.8, 0.8, 0.8]))
    for prober in (ball_prober, around):
        outcome = prober.probe(Probe([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.01, 0.01))
        assert outcome.status == "blocked"
        assert len(outcome.contacts) == 0


@pytest.mark.by_default("wsg50")
def test_skipping_free_flight_changes_nothing(
    hand: Hand, coarse_ball: trimesh.Trimesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    probes = [
        Probe(-RADIUS * d, d, 0.03, 0.005) for d in random_directions(3, np.random.default_rng(3))
    ]
    prober = DynamicProber(hand, coarse_ball)
    skipping = [prober.probe(probe) for probe in probes]
    # Longer than the motion: all of it is simulated.
    monkeypatch.setattr(dynamic_prober, "_BEFORE", 1.0)
    for probe, expected in zip(probes, skipping, strict=True):
        whole = prober.probe(probe)
        assert whole.duration == expected.duration
        # The touch is detected at another of the steps of 0.2 mm, with up to 1 N more.
        np.testing.assert_allclose(whole.contacts.points, expected.contacts.points, atol=2e-4)
        np.testing.assert_allclose(whole.contacts.forces, expected.contacts.forces, atol=1.0)


@pytest.mark.by_default("wsg50")
def test_an_outcome_does_not_depend_on_earlier_probes(
    hand: Hand, coarse_ball: trimesh.Trimesh
) -> None:
    first, second = [
        Probe(-RADIUS * d, d, 0.03, 0.01) for d in random_directions(2, np.random.default_rng(4))
    ]
    after = DynamicProber(hand, coarse_ball)
    after.probe(first)
    alone = DynamicProber(hand, coarse_ball).probe(second)
    assert bytes_of(after.probe(second)) == bytes_of(alone)


@pytest.mark.parametrize(
    "finger",
    ["thumb", *(pytest.param(n, marks=pytest.mark.slow) for n in ("index", "middle", "ring"))],
)
def test_every_finger_of_the_allegro_can_lead(finger: str, coarse_ball: trimesh.Trimesh) -> None:
    hand = Hand.load("allegro")
    alone = replace(hand, probe_postures={finger: hand.probe_postures[finger]})
    prober = DynamicProber(alone, coarse_ball)
    outcome = prober.probe(Probe([RADIUS, 0.0, 0.0], [-1.0, 0.0, 0.0], 0.03, 0.01))
    assert outcome.contacts.fingers == (f"{finger}_tip",)


def test_a_hand_without_probe_posture_and_an_open_mesh_are_refused(
    hand: Hand, coarse_ball: trimesh.Trimesh
) -> None:
    with pytest.raises(InvalidHandError) as error:
        DynamicProber(replace(hand, probe_postures={}), coarse_ball)
    assert error.value.key == "probe_postures"
    open_ball = trimesh.Trimesh(coarse_ball.vertices, coarse_ball.faces[:-1])
    with pytest.raises(InvalidMeshError):
        DynamicProber(hand, open_ball)
