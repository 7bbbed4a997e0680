"""Links that collide as several convex parts: reading, drafting and checking concave fingers."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.robots._build_model import read_description
from lis_grasp.robots._description import DescriptionEdits
from lis_grasp.robots.draft._flat_pads import face_areas
from lis_grasp.robots.draft._structure import find_fingers
from lis_grasp.robots.draft.pipeline import draft_hand
from lis_grasp.robots.draft.yaml_text import hand_yaml
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import hand_findings
from lis_grasp.shapes.mesh_distance import InsideTest

# An angular finger along z: a plate 24 to 30 mm from the middle, on a foot from 8 mm on.
FOOT, PLATE = (0.008, 0.030), (0.024, 0.030)
FOOT_HEIGHT, HEIGHT, WIDTH = 0.008, 0.050, 0.024


def finger_mesh(sign: int) -> trimesh.Trimesh:
    """Return a watertight angular prism; its foot points to the other finger."""
    outline = [
        (FOOT[0], 0.0),
        (FOOT[1], 0.0),
        (PLATE[1], HEIGHT),
        (PLATE[0], HEIGHT),
        (PLATE[0], FOOT_HEIGHT),
        (FOOT[0], FOOT_HEIGHT),
    ]
    corners = np.array([(sign * y, z) for y, z in outline])
    triangles = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 4], [2, 3, 4]])
    mesh = trimesh.creation.extrude_triangulation(corners, triangles, WIDTH)
    # Extruded along its z, which becomes x.
    mesh.apply_transform(
        np.array([[0, 0, 1, -WIDTH / 2], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    )
    mesh.fix_normals()
    return mesh


@pytest.fixture
def angular_jaw(tmp_path: Path) -> Path:
    """Return a URDF of two angular fingers that slide 20 mm towards each other."""
    inertia = '<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/>'
    mass = f'<inertial><mass value="0.2"/>{inertia}</inertial>'
    parts = [
        f'<link name="base">{mass}<collision><origin xyz="0 0 -0.03"/><geometry>'
        '<box size="0.05 0.1 0.05"/></geometry></collision></link>'
    ]
    for side, sign in (("left", 1), ("right", -1)):
        finger_mesh(sign).export(tmp_path / f"{side}.stl")
        parts.append(
            f'<link name="{side}">{mass}<collision><geometry><mesh filename="{side}.stl"/>'
            f'</geometry></collision></link><joint name="{side}_slide" type="prismatic">'
            f'<parent link="base"/><child link="{side}"/><axis xyz="0 {-sign} 0"/>'
            '<limit lower="-0.02" upper="0.006" effort="20" velocity="1"/></joint>'
        )
    path = tmp_path / "angular.urdf"
    path.write_text(f'<robot name="angular">{"".join(parts)}</robot>')
    return path


def test_a_concave_link_collides_as_parts_that_leave_its_concavity_free(angular_jaw: Path) -> None:
    whole = read_description(angular_jaw)
    parted = read_description(angular_jaw, DescriptionEdits(convex_parts=("left",)))
    inner = np.array([0.0, 0.018, 0.02])  # above the foot, in front of the plate
    for model, count, solid in ((whole, 1, True), (parted, None, False)):
        bodies = [body for body in model.link_geometries if body.link == "left"]
        assert count is None or len(bodies) == count
        assert any(InsideTest(body.mesh).inside(inner[None])[0] for body in bodies) is solid
    assert sum(body.link == "right" for body in parted.link_geometries) == 1
    parts = [body.mesh.volume for body in parted.link_geometries if body.link == "left"]
    assert sum(parts) == pytest.approx(finger_mesh(1).volume, rel=0.1)


def test_convex_parts_of_a_link_that_the_hand_lacks_are_refused(angular_jaw: Path) -> None:
    with pytest.raises(InvalidHandError) as caught:
        read_description(angular_jaw, DescriptionEdits(convex_parts=("thumb",)))
    assert caught.value.key == "convex_parts"


@pytest.mark.slow
def test_faces_of_angular_fingers_are_hidden_by_their_hulls(angular_jaw: Path) -> None:
    hulls = read_description(angular_jaw)
    parts = read_description(angular_jaw, DescriptionEdits(convex_parts=("left", "right")))
    foot, plate = WIDTH * FOOT_HEIGHT, WIDTH * (HEIGHT - FOOT_HEIGHT)
    np.testing.assert_allclose(face_areas(hulls, find_fingers(hulls)), foot, rtol=0.1)
    # A plate may be cut into two parts.
    found = face_areas(parts, find_fingers(parts))
    assert ((found > 0.5 * plate) & (found < 1.01 * plate)).all()


@pytest.mark.slow
def test_pads_of_angular_fingers_are_their_plates_not_their_feet(angular_jaw: Path) -> None:
    draft = draft_hand(angular_jaw, name="angular", rng=np.random.default_rng(0))
    assert draft.edits.convex_parts == ("left", "right")
    for pad, sign in zip(draft.hand.pads, (1, -1), strict=True):
        np.testing.assert_allclose(pad.axis_L, [0, -sign, 0], atol=0.03)
        assert pad.center_L[1] == pytest.approx(sign * PLATE[0], abs=1e-3)
        assert FOOT_HEIGHT < pad.center_L[2] < HEIGHT
    # Written and read again it is the same hand, and the feet beside the pads are no fault.
    text = hand_yaml(draft.hand, angular_jaw.name, draft.edits, draft.notes)
    path = angular_jaw.with_suffix(".yaml")
    path.write_text(text)
    again = Hand.load(path)
    assert len(again.link_geometries) == len(draft.hand.link_geometries)
    about_pads = [finding for finding in hand_findings(again) if "pad " in finding.text]
    assert about_pads
    assert all(finding.fine for finding in about_pads)
