"""Slide of a fingertip after a touch: closed forms, touches and contacts apart, and its choice."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import (
    ExplorationStrategy,
    Observation,
    PoseTracker,
    TactilePerception,
    TactileSensor,
    Workspace,
    begin,
    choose,
)
from lis_grasp.exploration.planar_motion import PoseBelief, planar_pose
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.states import Exploration
from lis_grasp.exploration.targets import choose_slides
from lis_grasp.probing.guarded_motion import GuardedMotion
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.mesh_distance import InsideTest
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.surfaces import ESTIMATORS

DOWN = [0.0, 0.0, -1.0]
STEP = 0.0025


def box(extents: list[float], center: list[float] | None = None) -> trimesh.Trimesh:
    made = trimesh.creation.box(extents=extents)
    return made.apply_translation([0.0, 0.0, 0.0] if center is None else center)


def slid(mesh: trimesh.Trimesh, target: list[float], *slides: list[float]) -> ProbeOutcome:
    probe = Probe(target, DOWN, 0.03, 0.02, slides)
    return KinematicProber(Hand.load("allegro"), mesh).probe(probe)


def test_on_a_plane_the_second_contact_is_at_the_given_distance() -> None:
    plane, probe = box([0.3, 0.3, 0.06]), ([0.0, 0.0, 0.03], [0.018, 0.024, 0.0])
    outcome, alone = slid(plane, *probe), slid(plane, probe[0])
    first, second = outcome.contacts.points
    assert outcome.slid == 1
    np.testing.assert_allclose(second - first, [0.018, 0.024, 0.0], atol=1e-5)
    np.testing.assert_allclose(outcome.contacts.normals, [[0, 0, 1], [0, 0, 1]], atol=1e-12)
    # 30 mm at 0.05 m/s, and back at 0.25 m/s; the touch is as without a slide.
    assert outcome.duration - alone.duration == pytest.approx(0.6 + 0.12, abs=1e-6)
    assert np.ptp(outcome.contacts.times) == pytest.approx(0.6, abs=1e-6)
    np.testing.assert_array_equal(first, alone.contacts.points[0])
    assert len(outcome.free_points) > len(alone.free_points)


def test_a_slide_ends_at_a_convex_edge_within_its_step() -> None:
    found = slid(box([0.1, 0.1, 0.06]), [0.02, 0.0, 0.03], [0.04, 0.0, 0.0]).contacts
    assert 0.05 - STEP <= found.points[1, 0] <= 0.05
    np.testing.assert_allclose(found.normals[1], [0, 0, 1], atol=1e-12)


def test_a_slide_that_is_too_short_gives_way_to_the_next() -> None:
    at, edge, along = [0.045, 0.0, 0.03], [0.03, 0.0, 0.0], [0.0, 0.03, 0.0]
    outcome = slid(box([0.1, 0.1, 0.06]), at, edge, along)
    assert slid(box([0.1, 0.1, 0.06]), at, edge).slid == 0
    np.testing.assert_allclose(np.diff(outcome.contacts.points, axis=0), [along], atol=1e-5)
    assert np.ptp(outcome.contacts.times) > 0.6  # the first one took its time


def test_on_a_sphere_the_second_contact_is_on_the_sphere() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    outcome = slid(sphere, [0.0, 0.0, 0.05], [0.03, 0.0, 0.0])
    points, normals = outcome.contacts.points, outcome.contacts.normals
    inradius = np.linalg.norm(sphere.triangles_center, axis=1).min()
    assert np.all(np.linalg.norm(points, axis=1) >= inradius - 1e-9)
    assert np.all(np.linalg.norm(points, axis=1) <= 0.05 + 1e-9)
    # A step beside the normal turns the line of centres; facets turn normals by up to 1.5 degrees.
    tip = Hand.load("allegro").probe_postures["index"].radius
    turned = 0.03 / STEP * np.arcsin(STEP / (0.05 + tip))
    assert np.arccos(normals[0] @ normals[1]) == pytest.approx(turned, abs=0.05)


def test_a_slide_ends_at_a_wall_without_penetration() -> None:
    floor, wall = box([0.3, 0.3, 0.06]), box([0.02, 0.3, 0.2], [0.06, 0.0, 0.1])
    mesh, hand = trimesh.util.concatenate([floor, wall]), Hand.load("allegro")
    motion = GuardedMotion(hand, mesh)
    probe = Probe([0.0, 0.0, 0.03], DOWN, 0.03, 0.02, [[0.08, 0.0, 0.0]])
    course = motion.run(probe)
    assert not isinstance(course, str)
    assert course.slide is not None
    end = course.slide.touched
    assert end is not None
    assert end.point[0] == pytest.approx(0.05, abs=1e-9)
    np.testing.assert_allclose(course.slide.normal, [-1.0, 0.0, 0.0], atol=1e-12)
    links = hand.forward_kinematics(course.last.X_OH, course.joint_positions)
    start, inside = course.last.X_OH[:3, 3], InsideTest(mesh)
    off = 1e-9 * np.array([-1.0, 0.0, 1.0])  # from the wall and the floor, which links may touch
    for place in course.slide.places:
        for geometry in hand.link_geometries:
            corners = geometry.mesh.copy().apply_transform(links[geometry.link] @ geometry.X_LG)
            assert not inside.inside(corners.vertices + (place - start) + off).any()


def touched(count: int, *, slid: int = 1) -> list[ProbeOutcome]:
    outcomes = []
    for k in range(count):
        points = np.array([[0.1 * k, 0.0, 0.0], [0.1 * k, 0.03, 0.0]])[: 1 + slid]
        contacts = Contacts(points, np.tile([0.0, 0.0, 1.0], (1 + slid, 1)))
        outcomes.append(ProbeOutcome(Probe(points[0], DOWN, 0, 0), "touched", contacts, slid=slid))
    return outcomes


def replayed(outcomes: list[ProbeOutcome], touches: int | None = None) -> Exploration:
    return Exploration.replay(list(map(Observation, outcomes)), touches=touches)


def test_a_touch_is_one_approach_and_the_end_of_its_slide_is_no_other() -> None:
    explored = replayed([*touched(4), *touched(9, slid=0)[4:]], touches=6)
    assert (len(explored.outcomes), len(explored.contacts)) == (6, 10)


def test_noise_is_of_both_contacts_and_an_undetected_touch_has_no_slide() -> None:
    outcome = touched(1)[0]
    reported = TactileSensor(position_noise=1e-3).report(outcome, rng=np.random.default_rng(0))
    assert reported.slid == 1
    assert np.all(np.linalg.norm(reported.contacts.points - outcome.contacts.points, axis=1) > 0)
    unfelt = TactileSensor(miss_rate=1.0).report(outcome, rng=np.random.default_rng(0))
    assert (unfelt.status, unfelt.slid, len(unfelt.contacts)) == ("blocked", 0, 0)


def test_a_slide_goes_to_the_largest_gap_and_not_into_the_table() -> None:
    space = Workspace(0.2, np.zeros(3), 0.05)
    probe = Probe([0.0, 0.0, 0.03], DOWN, 0.05, 0.05)
    known = Contacts([[0.04, 0.0, 0.03]], [[0.0, 0.0, 1.0]])
    best = choose_slides(probe, 0.03, space, known, None)[0]
    np.testing.assert_allclose(best, [-0.03, 0.0, 0.0], atol=1e-12)
    level = replace(probe, target=[0.0, 0.0, 0.0], direction=[1.0, 0.0, 0.0])
    on_table = replace(space, support_height=-0.01, tip_radius=0.01)
    assert choose_slides(level, 0.03, on_table, known, None)[0][2] >= 0.0


@pytest.mark.parametrize("tracker", [None, PoseTracker()])
def test_a_policy_may_choose_slides_but_not_along_an_object_that_may_move(
    tracker: PoseTracker | None,
) -> None:
    wanted = Probe([0.0, 0.0, 0.03], DOWN, 0.05, 0.05, [[0.03, 0.0, 0.0]])
    policy, space = (
        SimpleNamespace(next_probe=lambda *_, **__: wanted),
        Workspace(0.2, [0] * 3, 0.05),
    )
    perception = TactilePerception(ESTIMATORS["patch"], tracker=tracker)
    strategy = ExplorationStrategy(policy, 9, space, slide=0.02)
    state = begin(perception, strategy)
    chosen = choose(strategy, state, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(chosen.probe.slides, wanted.slides[: tracker is None])


def test_a_simulated_slide_ends_where_geometry_says() -> None:
    prober = DynamicProber(Hand.load("allegro"), box([0.3, 0.3, 0.06]))
    outcome = prober.probe(Probe([0.0, 0.0, 0.03], DOWN, 0.03, 0.02, [[0.018, 0.024, 0.0]]))
    assert outcome.slid == 1
    # A finger under PD control gives way by less than a millimetre to 1 N.
    slide = np.diff(outcome.contacts.points, axis=0)
    np.testing.assert_allclose(slide, [[0.018, 0.024, 0.0]], atol=1e-3)
    np.testing.assert_allclose(outcome.contacts.normals, [[0, 0, 1], [0, 0, 1]], atol=0.02)


def test_touches_of_several_fingers_keep_their_outcomes_beside_ends_of_slides() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.05, 0.0, 0.0]])
    contacts = Contacts(points + [1.0, 0.0, 0.0], np.tile([0.0, 0.0, 1.0], (3, 1)))
    last = ProbeOutcome(Probe(points[0], DOWN, 0, 0), "touched", contacts, slid=1)
    explored = replayed([*touched(2), last], touches=3)
    assert (explored.made, len(explored.contacts)) == (3, 6)
    assert [o is last for o in explored.touches] == [False] * 4 + [True] * 2


def test_a_contact_counts_as_what_first_made_it() -> None:
    outcomes = touched(4)
    points = np.array([[1.0, 0.0, 0.0], outcomes[0].contacts.points[0]])  # the end of its slide
    met = replace(outcomes[3], contacts=replace(outcomes[3].contacts, points=points))
    explored = replayed([*outcomes[:3], met])
    assert (explored.made, len(explored.contacts)) == (4, 7)
    stray = Observation(outcomes[3], dropped=points[1:])
    explored = Exploration.replay([*map(Observation, outcomes[:3]), stray])
    assert (explored.made, len(explored.contacts)) == (3, 7)
    at = [outcome.probe.target[0] for outcome in explored.touches]
    assert at == pytest.approx(explored.contacts.points[:, 0])


def test_touches_of_joined_maps_are_counted_without_ends_of_slides() -> None:
    start, X_EF = PoseBelief.start(), planar_pose(np.array([0.01, 0.02, 0.3]))
    observations = [Observation(outcome, start) for outcome in touched(7)]
    observations[3] = replace(observations[3], belief=replace(start, trust="lost"))
    observations[6] = replace(observations[6], belief=replace(start, X_WE=X_EF, joined=X_EF))
    explored = Exploration.replay(observations, touches=7)
    assert (explored.made, len(explored.contacts), len(explored.touches)) == (7, 14, 14)
