"""More touches of one approach: the fingers that did not lead stretch out until they touch."""

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.evaluation.mesh_distance import distances_to_mesh
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Probe
from lis_grasp.hands.hand import Hand
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.probing.guarded_motion import Course, GuardedMotion
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.probing.other_fingers import OtherFingers

DOWN = Probe([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 0.03, 0.02)


@pytest.fixture(scope="module")
def plate() -> trimesh.Trimesh:
    box = trimesh.creation.box(extents=[0.6, 0.6, 0.1])
    box.apply_translation([0.0, 0.0, -0.05])
    return box


def test_on_a_slope_several_fingers_touch_and_each_counts(plate: trimesh.Trimesh) -> None:
    # The fingers beside the leading one are a little behind it: they meet a slope towards them.
    hand = Hand.load("allegro")
    most = 0
    for axis in np.vstack([np.eye(3)[:2], -np.eye(3)[:2]]):
        slope = plate.copy()
        slope.apply_transform(trimesh.transformations.rotation_matrix(np.deg2rad(15.0), axis))
        normal = slope.face_normals[np.argmax(slope.face_normals[:, 2])]
        one = KinematicProber(hand, slope).probe(DOWN)
        every = KinematicProber(hand, slope, fingers="all").probe(DOWN)
        owners = [hand.link_fingers[link] for link in every.contacts.fingers]
        most = max(most, len(owners))
        assert len(one.contacts) == 1
        assert len(set(owners)) == len(owners)
        np.testing.assert_allclose(every.contacts.points @ normal, 0.0, atol=1e-12)
        np.testing.assert_allclose(every.contacts.normals, [normal] * len(owners), atol=1e-12)
        # What the leader felt is the same, and comes first; the rest takes its time.
        np.testing.assert_array_equal(every.contacts.points[0], one.contacts.points[0])
        assert every.contacts.times is not None
        assert np.all(np.diff(every.contacts.times) >= 0.0)
        assert every.duration > one.duration
    assert most >= 3


def test_fingers_stop_where_they_meet_the_surface() -> None:
    shape = shapes.build("mallet", 0.2)
    hand = Hand.load("allegro")
    motion, others = GuardedMotion(hand, shape.mesh, None), OtherFingers(hand, shape.mesh)
    rng = np.random.default_rng(1)
    points, faces = trimesh.sample.sample_surface(shape.mesh, 20, seed=rng)
    met = 0
    for point, normal in zip(points, shape.mesh.face_normals[faces], strict=True):
        aslant = np.cross(normal, rng.normal(size=3)) - normal  # fingers ahead of the leading one
        course = motion.run(Probe(point, aslant, 0.03, 0.02), None)
        if not isinstance(course, Course) or course.met is None:
            continue
        X_OH = course.X_OH.copy()
        X_OH[:3, 3] += course.travelled * course.direction
        q = course.approach.posture.joint_positions
        but = hand.link_fingers.get(course.met.link)
        for stretching in others.stretch(X_OH, q, but=but):
            if stretching.met is not None:
                met += 1
                apart, _ = distances_to_mesh(stretching.met.point[None], shape.mesh)
                assert apart[0] < 1e-9
                assert 0.0 <= stretching.met.distance < 2e-5
                assert hand.link_fingers[stretching.met.link] != but
    assert met >= 3


def test_fingers_of_a_jaw_that_do_not_move_by_themselves_add_nothing(
    plate: trimesh.Trimesh,
) -> None:
    outcome = KinematicProber(Hand.load("wsg50"), plate, fingers="all").probe(DOWN)
    assert len(outcome.contacts) == 1


def test_all_fingers_need_the_kinematic_prober() -> None:
    assert RunConfig(fingers="all", prober="kinematic").fingers == "all"
    with pytest.raises(InvalidOptionError, match="kinematic"):
        RunConfig(fingers="all")
    with pytest.raises(InvalidOptionError, match="fingers must be one of"):
        RunConfig(fingers="two")
