"""Collision checks of a hand with object, support and itself."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from lis_grasp import Hand
from lis_grasp.robots.collision import HandCollisionChecker

JAW = Hand.load("wsg50")
OPEN = JAW.pregrasps["wide"]


def _above(height: float) -> np.ndarray:
    """Return the jaw pointing down, its palm frame `height` above the origin."""
    X_OH = np.diag([1.0, -1.0, -1.0, 1.0])
    X_OH[2, 3] = height
    return X_OH


def hit(
    checker: HandCollisionChecker, X_OH: np.ndarray, q: np.ndarray, **options: bool
) -> str | None:
    """Return the first collision at a pose or on a path."""
    return checker.first_collisions(X_OH.reshape(1, -1, 4, 4), q[None], **options)[0]


def test_a_hand_far_away_collides_with_nothing() -> None:
    checker = HandCollisionChecker(
        JAW, trimesh.creation.box((0.05, 0.05, 0.05)), support_height=-0.025
    )
    assert hit(checker, _above(0.5), OPEN) is None


def test_a_palm_in_the_object_is_found() -> None:
    checker = HandCollisionChecker(JAW, trimesh.creation.box((0.05, 0.05, 0.05)))
    assert hit(checker, _above(0.02), OPEN) == "object"


def test_a_hand_wholly_inside_the_object_is_found() -> None:
    # A triangle mesh is a shell to FCL: nothing touches it here.
    checker = HandCollisionChecker(JAW, trimesh.creation.box((2.0, 2.0, 2.0)))
    assert hit(checker, _above(0.0), OPEN) == "object"


@pytest.mark.parametrize(("at", "inside"), [(0.0, False), (-0.15, True)])
def test_a_body_is_inside_where_its_mesh_is_and_not_its_frame(at: float, inside: bool) -> None:
    # A cube of 1 cm, 15 cm beside its frame's origin, and a block of 5 cm round one of the two.
    (body,) = {g.link: g for g in JAW.link_geometries if g.link == JAW.base_link}.values()
    cube = trimesh.creation.box((0.01, 0.01, 0.01)).apply_translation([0.15, 0.0, 0.0])
    far = replace(body, kind="mesh", dimensions=(), mesh=cube, X_LG=np.eye(4))
    hand = replace(JAW, link_geometries=(far,))
    block = trimesh.creation.box((0.05, 0.05, 0.05))
    X_OL = np.eye(4)
    X_OL[0, 3] = at
    checker = HandCollisionChecker(hand, block)
    assert (hit(checker, X_OL @ hand.X_LH, OPEN) == "object") == inside


def test_a_hand_collides_with_the_support_from_its_lowest_point_on() -> None:
    hand = JAW
    mesh = trimesh.creation.box((0.01, 0.01, 0.01)).apply_translation([0.0, 0.0, 3.0])
    poses = hand.forward_kinematics(_above(0.3), OPEN)
    vertices = [
        trimesh.transform_points(g.mesh.vertices, poses[g.link] @ g.X_LG)
        for g in hand.link_geometries
    ]
    # The shipped jaw ends in boxes and spheres; a sphere's triangle mesh is within 1 % of it.
    lowest = min(v[:, 2].min() for v in vertices)
    for gap, expected in ((0.0015, None), (0.0005, "support"), (-0.002, "support")):
        checker = HandCollisionChecker(hand, mesh, support_height=lowest - gap, clearance=0.001)
        assert hit(checker, _above(0.3), OPEN) == expected


def test_pads_may_touch_only_where_they_are_allowed_to() -> None:
    checker = HandCollisionChecker(JAW, trimesh.creation.box((0.06, 0.03, 0.06)))
    # The jaw is closed to 58 mm round 60 mm: both fingers press in by a millimetre.
    closed = np.clip(np.full(2, 0.029), JAW.lower, JAW.upper)
    X_OH = _above(0.075)
    assert hit(checker, X_OH, closed) == "object"
    assert hit(checker, X_OH, closed, pads_may_touch=True) is None


def test_fingers_through_each_other_are_found() -> None:
    hand = Hand.load("allegro")
    checker = HandCollisionChecker(hand, trimesh.creation.icosphere(radius=0.001))
    far = np.eye(4)
    far[:3, 3] = 1.0
    opened = hand.pregrasps["medium"].copy()
    assert hit(checker, far, opened) is None
    crossed = opened.copy()
    names = list(hand.joint_names)
    crossed[names.index("index_0")] = hand.lower[names.index("index_0")]
    crossed[names.index("middle_0")] = hand.upper[names.index("middle_0")]
    assert hit(checker, far, crossed) == "self"


def test_collision_with_a_ball_agrees_with_sampled_points() -> None:
    # Points of the links' surfaces, at most 10 mm apart, against a ball of 50 mm. A body without a
    # point in the ball may still dip into it: its surface is within 10 / sqrt(3) = 5.8 mm of one.
    rng = np.random.default_rng(0)
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    assert np.linalg.norm(mesh.triangles_center, axis=1).min() > 0.0496
    checker = HandCollisionChecker(JAW, mesh)
    samples = [(g, g.mesh.subdivide_to_size(0.01).vertices) for g in JAW.link_geometries]
    inside = outside = 0
    for _ in range(60):
        X_OH = trimesh.transformations.random_rotation_matrix(rng.random(3))
        X_OH[:3, 3] = rng.normal(scale=0.08, size=3)
        poses = JAW.forward_kinematics(X_OH, OPEN)
        nearest = min(
            np.linalg.norm(trimesh.transform_points(v, poses[g.link] @ g.X_LG), axis=1).min()
            for g, v in samples
        )
        if nearest < 0.0496:
            inside += 1
            assert hit(checker, X_OH, OPEN) == "object"
        elif nearest > 0.056:
            outside += 1
            assert hit(checker, X_OH, OPEN) != "object"
    assert min(inside, outside) > 10


def test_the_nearest_link_of_a_placed_hand_is_found_with_its_distance() -> None:
    mesh = trimesh.creation.box((0.02, 0.02, 0.02))
    checker = HandCollisionChecker(JAW, mesh)
    # The fingers point down and end 0.2 m minus their length above the origin.
    assert not checker.place(_above(0.3), checker.poses_in_hand(OPEN))
    poses = JAW.forward_kinematics(_above(0.3), OPEN)
    query = trimesh.proximity.ProximityQuery(mesh)
    expected = {
        g.link: query.on_surface(
            trimesh.transform_points(
                g.mesh.subdivide_to_size(0.002).vertices, poses[g.link] @ g.X_LG
            )
        )[1].min()
        for g in JAW.link_geometries
    }
    found = checker.nearest(np.zeros(3))
    # Sampled points are at most 2 mm apart, so the distance is overestimated by less than 0.02 mm
    # (a right-angled triangle of 0.2 m and 1.2 mm).
    assert found.distance == pytest.approx(min(expected.values()), abs=2e-4)
    assert expected[found.link] == pytest.approx(found.distance, abs=2e-4)
    assert query.on_surface(found.point[None])[1][0] == pytest.approx(0.0, abs=1e-9)
    # Moved 0.1 m down, the hand is as much nearer.
    assert checker.nearest(np.array([0.0, 0.0, -0.1])).distance < found.distance - 0.05


def test_postures_together_collide_as_one_by_one() -> None:
    mesh = trimesh.creation.box((0.05, 0.05, 0.05))
    checker = HandCollisionChecker(JAW, mesh, support_height=-0.025)
    heights = np.linspace(0.0, 0.3, 13)
    paths = np.array([[_above(height), _above(height + 0.05)] for height in heights])
    q = np.linspace(JAW.lower, JAW.upper, len(heights))
    alone = [hit(checker, path, joints) for path, joints in zip(paths, q, strict=True)]
    assert checker.first_collisions(paths, q) == alone
    assert len(set(alone)) > 1
    above = checker.clearances(paths[-2:, 0], q[[-1, -1]])
    # Higher by one step, above the middle of the object; FCL is precise to a millionth.
    np.testing.assert_allclose(np.diff(above), heights[1] - heights[0], atol=1e-5)
