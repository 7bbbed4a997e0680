"""Coverage by touches, on shapes whose covered part is known."""

import numpy as np
import pytest
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.touch_coverage import reachable_coverage, touch_coverage, touch_radius
from lis_grasp.shapes.builtin import hollow_cylinder, sphere

# The surface is sampled at 4,000 even points: a fraction is off by about the root of their number
# on the border of the covered part.
SAMPLED = 0.01


def test_one_touch_of_a_ball_covers_its_cap() -> None:
    # A cap within a chord c of its pole has the area pi c^2 of 4 pi r^2.
    ball = sphere(0.1).mesh
    contacts = Contacts([[0.0, 0.0, 0.05]], [[0.0, 0.0, 1.0]])
    covered = touch_coverage(ball, contacts, radius=0.04)
    assert covered == pytest.approx(0.04**2 / (4.0 * 0.05**2), abs=SAMPLED)


def test_a_touch_does_not_cover_the_far_side_of_a_thin_wall() -> None:
    plate = trimesh.creation.box((0.2, 0.2, 0.002))
    above = Contacts([[0.0, 0.0, 0.001]], [[0.0, 0.0, 1.0]])
    covered = touch_coverage(plate, above, radius=0.05)
    assert covered == pytest.approx(np.pi * 0.05**2 / plate.area, abs=SAMPLED)


@pytest.mark.slow
def test_a_bore_narrower_than_the_fingertip_is_not_reachable() -> None:
    # Touches all over the outside of a tube: what is missing is the bore, if a tip fits in.
    tube = hollow_cylinder(0.1).mesh
    points, faces = trimesh.sample.sample_surface_even(tube, 3000, seed=0)
    normals = tube.face_normals[faces]
    inside = np.einsum("nk,nk->n", points[:, :2], normals[:, :2]) < -1e-6
    contacts = Contacts(points[~inside], normals[~inside])
    of_bore = 2.0 * np.pi * 0.0225 * 0.1 / tube.area
    for tip_radius, expected in ((0.01, 1.0 - of_bore), (0.03, 1.0)):
        covered = reachable_coverage(tube, contacts, tip_radius=tip_radius, radius=0.008)
        # Of the bore, rings of up to a radius at both rims are within it of the rims' contacts.
        assert covered == pytest.approx(expected, abs=SAMPLED + of_bore * 2.0 * 0.008 / 0.1)


def test_the_underside_of_an_object_on_a_table_is_not_reachable() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    above = Contacts([[0.0, 0.0, 0.05]], [[0.0, 0.0, 1.0]])
    # All of the top is within 71 mm of its middle: 1 of 6 faces, or of 5 less a strip of 10 mm
    # round their lower ends.
    options = {"tip_radius": 0.01, "radius": 0.0708}
    in_air = reachable_coverage(box, above, **options)
    on_table = reachable_coverage(box, above, **options, support_height=-0.05)
    assert on_table == pytest.approx(in_air * 6.0 / (1.0 + 4.0 * 0.9), abs=SAMPLED)


def test_no_contacts_cover_nothing_and_no_reach_is_none() -> None:
    ball = sphere(0.1).mesh
    assert touch_coverage(ball, Contacts.empty(), radius=0.01) == 0.0
    nowhere = reachable_coverage(
        ball, Contacts.empty(), tip_radius=0.01, radius=0.01, support_height=1.0
    )
    assert nowhere is None


def test_the_radius_of_a_touch_is_half_the_balls_radius() -> None:
    # The inscribed polyhedron has a little less area than the ball.
    assert touch_radius(sphere(0.1).mesh) == pytest.approx(0.025, rel=2e-3)
