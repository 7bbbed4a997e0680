"""Kinematic prober: exact on shapes with a formula, and in agreement with Drake."""

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.exploration import Workspace
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.probing.approach_planner import NO_FREE_APPROACH
from lis_grasp.probing.guarded_motion import GuardedMotion
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.surfaces import ESTIMATORS

HANDS = ["allegro", "wsg50", "barrett"]
# By default, what costs a second is done with the hand of the fewest links alone.
OTHERS_SLOW = [pytest.param(n, marks=() if n == "wsg50" else pytest.mark.slow) for n in HANDS]


@pytest.fixture(scope="module", params=HANDS)
def hand(request: pytest.FixtureRequest) -> Hand:
    return Hand.load(request.param)


def random_probes(shape: Shape, count: int, rng: np.random.Generator) -> list[Probe]:
    """Probes at random points of a shape, up to 40 degrees off the normal."""
    points, faces = trimesh.sample.sample_surface(shape.mesh, count, seed=rng)
    probes = []
    for point, normal in zip(points, shape.mesh.face_normals[faces], strict=True):
        side = np.cross(normal, rng.normal(size=3))
        tilt = rng.uniform(0.0, np.deg2rad(40.0))
        direction = np.sin(tilt) * side / np.linalg.norm(side) - np.cos(tilt) * normal
        probes.append(Probe(point, direction, 0.03, 0.02))
    return probes


def test_a_box_is_touched_exactly_at_the_target(hand: Hand) -> None:
    prober = KinematicProber(hand, trimesh.creation.box(extents=[0.1, 0.08, 0.06]))
    outcome = prober.probe(Probe([0.01, -0.02, 0.03], [0.0, 0.0, -1.0], 0.03, 0.02))
    assert outcome.status == "touched"
    # It stops 0.02 mm before the surface at the most; the point is on it.
    assert outcome.contacts.points[0, 2] == pytest.approx(0.03, abs=1e-12)
    np.testing.assert_allclose(outcome.contacts.normals, [[0.0, 0.0, 1.0]], atol=1e-12)
    # 30 mm at 0.1 m/s, and back at 0.25 m/s.
    assert outcome.duration == pytest.approx(0.3 + 0.12, abs=1e-3)


def test_a_touch_on_a_sliver_has_the_normal_around_it() -> None:
    # The upper face's diagonal has its middle as a vertex on one side only: a sliver in between.
    box = trimesh.creation.box(extents=[0.1, 0.08, 0.06])
    top = np.flatnonzero(box.face_normals[:, 2] > 0.5)
    first, second = box.faces[top[0]].tolist(), set(box.faces[top[1]].tolist())
    k = next(k for k in range(3) if {first[k], first[(k + 1) % 3]} <= second)
    a, b, c = first[k], first[(k + 1) % 3], first[(k + 2) % 3]
    split = [[a, 8, c], [8, b, c], [a, b, 8]]
    mesh = trimesh.Trimesh(
        np.vstack([box.vertices, [0.0, 0.0, 0.03]]),
        np.vstack([split[::-1], np.delete(box.faces, top[0], axis=0)]),
        process=False,
    )
    assert mesh.is_watertight
    prober = KinematicProber(Hand.load("allegro"), mesh)
    touched = [
        prober.probe(Probe([x, 0.8 * x, 0.03], [0.0, 0.0, -1.0], 0.03, 0.02))
        for x in np.linspace(-0.02, 0.02, 9)
    ]
    normals = np.concatenate([outcome.contacts.normals for outcome in touched])
    np.testing.assert_allclose(normals, np.tile([0.0, 0.0, 1.0], (9, 1)), atol=1e-12)


def test_a_spherical_tip_touches_a_slope_beside_the_target() -> None:
    # A sphere of radius r that moves down on a slope at 30 degrees, its lowest point along a line,
    # meets it r sin 30 beside that line.
    slope = trimesh.creation.box(extents=[0.2, 0.2, 0.1]).apply_translation([0.0, 0.0, -0.05])
    slope.apply_transform(trimesh.transformations.rotation_matrix(np.deg2rad(30.0), [0, 1, 0]))
    hand = Hand.load("allegro")
    radius = next(iter(hand.probe_postures.values())).radius
    prober = KinematicProber(hand, slope)
    outcome = prober.probe(Probe([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 0.05, 0.02))
    normal = np.array([0.5, 0.0, np.sqrt(0.75)])
    np.testing.assert_allclose(outcome.contacts.normals, [normal], atol=1e-9)
    assert outcome.contacts.points[0] @ normal == pytest.approx(0.0, abs=1e-12)
    # 0.02 mm of slack across the slope, twice as much along it.
    assert outcome.contacts.points[0, 0] == pytest.approx(-0.5 * radius, abs=5e-5)


@pytest.mark.parametrize("hand", OTHERS_SLOW, indirect=True)
@pytest.mark.parametrize(
    "name",
    ["hollow_cylinder", *(pytest.param(n, marks=pytest.mark.slow) for n in ("cylinder", "mallet"))],
)
def test_both_probers_agree(name: str, hand: Hand) -> None:
    shape = shapes.build(name, 0.2)
    kinematic, dynamic = KinematicProber(hand, shape.mesh), DynamicProber(hand, shape.mesh)
    gaps, angles, links, alike = [], [], [], []
    for probe in random_probes(shape, 25, np.random.default_rng(7)):
        quick, full = kinematic.probe(probe), dynamic.probe(probe)
        alike.append(quick.status == full.status)
        if quick.status == full.status == "touched":
            apart = np.linalg.norm(full.contacts.points - quick.contacts.points[0], axis=1)
            nearest = int(np.argmin(apart))
            gaps.append(apart[nearest])
            cosine = full.contacts.normals[nearest] @ quick.contacts.normals[0]
            angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
            links.append(quick.contacts.fingers[0] in full.contacts.fingers)
    # A grazing tip or link may or may not press 0.2 N before it passes.
    assert np.mean(alike) >= 0.9
    assert np.mean(links) >= 0.9
    # Up to 0.2 N a tip moves on by a third of a millimetre, oblique ones along the surface.
    assert np.median(gaps) < 1e-3
    assert np.quantile(gaps, 0.9) < 3e-3
    # Facets meet at up to 4 degrees; an edge gives either side's normal.
    assert np.median(angles) < 2.0


def test_a_ring_is_entered(hand: Hand) -> None:
    ring = trimesh.creation.torus(major_radius=0.055, minor_radius=0.015)
    prober = KinematicProber(hand, ring)
    outcome = prober.probe(Probe([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 0.04, 0.02))
    assert outcome.status == "missed"
    assert outcome.duration == pytest.approx(0.6 + 0.24)
    radius = next(iter(hand.probe_postures.values())).radius
    np.testing.assert_allclose(outcome.free_points[0], [0.0, 0.0, 0.04 + radius], atol=1e-12)


@pytest.mark.parametrize("side", [0.1, 0.8])
def test_a_start_inside_the_object_is_blocked(hand: Hand, side: float) -> None:
    # Only the tip is in the small box; the whole hand is in the large one, and touches nothing.
    prober = KinematicProber(hand, trimesh.creation.box(extents=[side] * 3))
    outcome: ProbeOutcome = prober.probe(Probe([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.01, 0.01))
    assert outcome.status == "blocked"


def prior_knowledge(shape: Shape) -> ObstacleModel:
    space = Workspace(0.25 * shape.size, shape.mesh.bounds.mean(axis=0), shape.size)
    return ObstacleModel(space, Contacts.empty(), None)


@pytest.mark.by_default("True-wsg50")
@pytest.mark.parametrize("hand", OTHERS_SLOW, indirect=True)
@pytest.mark.parametrize("from_outside", [False, True])
def test_the_whole_hand_is_collision_free_up_to_the_touch(hand: Hand, from_outside: bool) -> None:
    shape = shapes.build("mallet", 0.2)
    motion = GuardedMotion(hand, shape.mesh)
    oracle = HandCollisionChecker(hand, shape.mesh)

    def touches(X_OH: np.ndarray, q: np.ndarray) -> bool:
        return "object" in oracle.first_collisions(X_OH[None, None], q[None])

    obstacles = prior_knowledge(shape) if from_outside else None
    touched = on_approach = 0
    for probe in random_probes(shape, 16, np.random.default_rng(3)):
        course = motion.run(probe, obstacles)
        if isinstance(course, str):
            continue
        q, moved, last = course.joint_positions, np.eye(4), course.last
        for leg in course.legs:  # where the probe's motion begins, the whole approach is free
            for part in np.linspace(0.0, 0.999, 7):
                moved[:3, 3] = part * leg.length * leg.direction
                assert "object" not in oracle.first_collisions(
                    (moved @ leg.X_OH)[None, None], q[None]
                )
        on_approach += len(course.legs) == 1
        if course.touched is not None:
            touched += 1
            # Beyond the 0.02 mm at which it counts as touching; a graze at 40 degrees needs more.
            moved[:3, 3] = (last.length + 2e-4) * last.direction
            assert touches(moved @ last.X_OH, q)
    assert touched > 8
    assert on_approach < 5


def test_an_unknown_obstacle_is_touched_on_the_approach(hand: Hand) -> None:
    # An unknown plate covers the target.
    plate = trimesh.creation.box(extents=[0.3, 0.3, 0.01]).apply_translation([0.0, 0.0, 0.08])
    space = Workspace(0.05, np.zeros(3), 0.2)
    prober = KinematicProber(hand, plate)
    probe = Probe([0.0, 0.0, 0.03], [0.0, 0.0, -1.0], 0.02, 0.01)
    outcome = prober.probe(probe, ObstacleModel(space, Contacts.empty(), None))
    assert outcome.status == "touched"
    assert outcome.contacts.points[0, 2] == pytest.approx(0.085, abs=1e-4)
    # Approach from outside of the ball at 0.1 m/s, since nothing is known, and back at 0.25 m/s.
    length = float(np.sqrt(3.0)) * 0.1 - 0.085
    radius = next(iter(hand.probe_postures.values())).radius
    assert outcome.duration == pytest.approx((length - radius) * (10.0 + 4.0), abs=0.1)
    assert outcome.duration == pytest.approx(sum(outcome.seconds.values()))


def test_a_hand_does_not_approach_through_the_known_object(hand: Hand) -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    normals = np.vstack([np.eye(3), -np.eye(3)])
    contacts = Contacts(0.1 * normals, normals)
    space = Workspace(0.1, np.zeros(3), 0.2)
    surface = ESTIMATORS["gpis"](contacts)
    prober = KinematicProber(hand, ball)
    inside_out = Probe([0.0, 0.0, 0.1], [0.0, 0.0, 1.0], 0.02, 0.02)
    outcome = prober.probe(inside_out, ObstacleModel(space, contacts, surface))
    assert outcome.status == "blocked"
    assert outcome.reason == NO_FREE_APPROACH
    # The unknown ball is touched on the approach, on its other side.
    assert (
        prober.probe(inside_out, ObstacleModel(space, Contacts.empty(), None)).status == "touched"
    )


def test_the_wall_of_a_bore_is_touched_by_a_finger_along_the_bore() -> None:
    shape = shapes.build("hollow_cylinder", 0.2)
    prober = KinematicProber(Hand.load("allegro"), shape.mesh)
    direction = np.array([1.0, 0.0, 0.0])
    probe = Probe([0.1, 0.0, 0.08], direction, 0.1, 0.0)  # 20 mm below the rim
    # All of the outside is known, so that the hand cannot approach through the other wall.
    points, faces = trimesh.sample.sample_surface(shape.mesh, 150, seed=0)
    contacts = Contacts(points, shape.mesh.face_normals[faces])
    space = Workspace(0.05, np.zeros(3), 0.2)
    obstacles = ObstacleModel(space, contacts, ESTIMATORS["gpis"](contacts))
    outcome = prober.probe(probe, obstacles)
    assert outcome.status == "touched"
    inner = np.linalg.norm(outcome.contacts.points[0, :2])
    assert outcome.contacts.normals[0] @ direction < -0.9
    assert inner < 0.95 * np.linalg.norm(shape.mesh.vertices[:, :2], axis=1).max()


def test_an_open_mesh_is_refused(hand: Hand) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    with pytest.raises(InvalidMeshError):
        KinematicProber(hand, trimesh.Trimesh(ball.vertices, ball.faces[:-1]))
