"""Extension of the other fingers until they touch, after the leading one has."""

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Probe
from lis_grasp.pipeline.names_of_2 import RunConfig
from lis_grasp.probing.course import Course
from lis_grasp.probing.guarded_motion import GuardedMotion
from lis_grasp.probing.kinematic_prober import FingerExtender, KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.mesh_distance import distances_to_mesh

DOWN = Probe([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 0.03, 0.02)


@pytest.fixture(scope="module")
def plate() -> trimesh.Trimesh:
    return trimesh.creation.box(extents=[0.6, 0.6, 0.1]).apply_translation([0.0, 0.0, -0.05])


@pytest.mark.slow
def test_several_fingers_touch_a_slope_once_each(plate: trimesh.Trimesh) -> None:
    # The fingers beside the leading one are behind it: they touch a slope towards them.
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
        # The leader's contact is the same and first; the others take longer.
        np.testing.assert_array_equal(every.contacts.points[0], one.contacts.points[0])
        assert np.all(np.diff(every.contacts.times) >= 0.0)
        assert every.duration > one.duration
    assert most >= 3


@pytest.mark.slow
def test_extended_fingers_stop_at_the_surface() -> None:
    shape = shapes.build("mallet", 0.2)
    hand = Hand.load("allegro")
    motion, extender = GuardedMotion(hand, shape.mesh), FingerExtender(hand, shape.mesh)
    rng = np.random.default_rng(1)
    points, faces = trimesh.sample.sample_surface(shape.mesh, 20, seed=rng)
    touches = 0
    for point, normal in zip(points, shape.mesh.face_normals[faces], strict=True):
        oblique = np.cross(normal, rng.normal(size=3)) - normal  # other fingers ahead
        course = motion.run(Probe(point, oblique, 0.03, 0.02))
        if not isinstance(course, Course) or course.touched is None:
            continue
        q = course.joint_positions
        but = hand.link_fingers.get(course.touched.link)
        for extension in extender.extend(course.X_OH_end, q, but=but):
            if extension.touched is not None:
                touches += 1
                apart, _ = distances_to_mesh(extension.touched.point[None], shape.mesh)
                assert apart[0] < 1e-9
                assert 0.0 <= extension.touched.distance < 2e-5
                assert hand.link_fingers[extension.touched.link] != but
    assert touches >= 3


def test_coupled_fingers_of_a_parallel_jaw_gripper_add_no_contact(
    plate: trimesh.Trimesh,
) -> None:
    outcome = KinematicProber(Hand.load("wsg50"), plate, fingers="all").probe(DOWN)
    assert len(outcome.contacts) == 1


def test_all_fingers_need_the_kinematic_prober() -> None:
    assert RunConfig(fingers="all", prober="kinematic").fingers == "all"
    with pytest.raises(InvalidOptionError) as error:
        RunConfig(fingers="all")
    assert error.value.option == "fingers"
    with pytest.raises(InvalidOptionError) as error:
        RunConfig(fingers="two")
    assert (error.value.option, error.value.value) == ("fingers", "two")
