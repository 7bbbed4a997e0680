"""Edits of a description by a hand's YAML, repaired inertias, and files with vendors' faults."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from lis_grasp.exceptions import InvalidFileError, InvalidHandError, LisGraspWarning
from lis_grasp.robots._build_model import read_description
from lis_grasp.robots._description import DescriptionEdits
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.inertias import (
    impossible_inertias,
    is_possible,
    repaired_inertial,
    without_rounding,
)
from lis_grasp.robots.kinematics import Kinematics
from lis_grasp.robots.link_bodies import balls_inside, convex_body
from lis_grasp.robots.model_uri import resolve_uri
from lis_grasp.robots.repair_file import write_repaired
from lis_grasp.robots.robot_model import Inertial, RobotModel
from lis_grasp.robots.shipped_models import model_path

ALLEGRO = model_path("hands/allegro/allegro.urdf")
METRES = 'ixx="0.5" ixy="0" ixz="0" iyy="0.5" iyz="0" izz="0.5"'  # of a body metres large
BARRETT = model_path("hands/barrett/barrett.urdf")


def poses(model: RobotModel, q: np.ndarray) -> dict[str, np.ndarray]:
    count = len(model.joint_names)
    kinematics = Kinematics(model.links, model.joints, (), X_LH=np.eye(4), actuated=count)
    return kinematics.poses(np.eye(4), q)


@pytest.mark.parametrize("urdf", [ALLEGRO, BARRETT], ids=["revolute", "with followers"])
def test_a_locked_joint_is_where_the_movable_one_would_be(urdf: Path) -> None:
    free = read_description(urdf)
    q = 0.3 * free.lower + 0.7 * free.upper
    # The first joint that others follow, if there is one.
    led = [joint.index for joint in free.joints if joint.follows]
    locked = led[0] if led else 2
    name = free.joint_names[locked]
    fixed = read_description(urdf, DescriptionEdits(locked_joints={name: float(q[locked])}))
    assert name not in fixed.joint_names
    expected, found = poses(free, q), poses(fixed, np.delete(q, locked))
    for link, pose in expected.items():
        np.testing.assert_allclose(found[link], pose, atol=1e-12)


def test_a_hand_is_cut_off_before_its_base_link() -> None:
    whole = read_description(ALLEGRO)
    base = next(joint.child for joint in whole.joints if joint.is_actuated)
    part = read_description(ALLEGRO, DescriptionEdits(base_link=base))
    assert part.links[0] == base
    assert set(part.links) < set(whole.links)
    assert {body.link for body in part.link_geometries} <= set(part.links)


@pytest.mark.parametrize(
    ("edits", "key"),
    [
        (DescriptionEdits(base_link="elbow"), "base_link"),
        (DescriptionEdits(locked_joints={"elbow": 0.0}), "locked_joints.elbow"),
        (DescriptionEdits(effort_limits={"elbow": 1.0}), "effort_limits.elbow"),
    ],
    ids=["base", "locked", "effort"],
)
def test_an_edit_of_what_is_not_there_is_refused(edits: DescriptionEdits, key: str) -> None:
    with pytest.raises(InvalidHandError) as error:
        read_description(ALLEGRO, edits)
    assert error.value.key == key


def test_a_repaired_inertia_is_that_of_the_bodies() -> None:
    # Two cubes of side a with centres 2 d apart make, about the middle, m (a^2 / 6 + d^2) across.
    a, d, mass = 0.02, 0.03, 0.5
    cubes = [trimesh.creation.box([a] * 3).apply_translation([s * d, 0, 0]) for s in (-1, 1)]
    broken = Inertial(mass, np.zeros(3), np.diag([1e-6, 1e-6, 1.0]))
    points = np.vstack([cube.vertices for cube in cubes])
    assert not is_possible(broken, points)
    repaired = repaired_inertial(broken, cubes)
    across = mass * (a**2 / 6.0 + d**2)
    np.testing.assert_allclose(
        repaired.inertia_L, np.diag([mass * a**2 / 6.0, across, across]), rtol=1e-6, atol=1e-12
    )
    assert is_possible(repaired, points)


def test_only_violations_by_rounding_are_corrected_in_silence() -> None:
    rounded = np.diag([1.0, 2.0, 3.0002])
    assert is_possible(Inertial(1.0, np.zeros(3), without_rounding(rounded)), np.empty((0, 3)))
    np.testing.assert_allclose(without_rounding(rounded), rounded, rtol=1e-3)
    wrong = np.diag([1.0, 2.0, 3.1])
    np.testing.assert_array_equal(without_rounding(wrong), wrong)


@pytest.mark.parametrize(
    ("size", "at", "possible"),
    # Of a cube with sides of 0.1 m; its corners are 0.087 m from its middle.
    [(0.1, 0.0, True), (0.3, 0.0, True), (1.0, 0.0, False), (0.1, 0.2, True), (0.1, 1.0, False)],
)
def test_the_inertia_of_a_much_larger_or_distant_body_is_impossible(
    size: float, at: float, possible: bool
) -> None:
    corners = np.asarray(trimesh.creation.box([0.1] * 3).vertices)
    own = Inertial(0.3, np.array([at, 0.0, 0.0]), 0.3 * size**2 / 6.0 * np.eye(3))
    assert is_possible(own, corners) is possible
    assert is_possible(own, np.empty((0, 3)))  # nothing is known without bodies


@pytest.mark.by_default("size")
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('ixx="1.960e-05"', 'ixx="1.960e-02"'),
        ('ixx="9.807e-04" ixy="0" ixz="0" iyy="4.810e-04" iyz="0" izz="6.495e-04"', METRES),
    ],
    ids=["moments", "size"],
)
def test_repair_replaces_impossible_inertias_and_keeps_the_others(
    old: str, new: str, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.urdf"
    text = ALLEGRO.read_text()
    assert old in text
    broken.write_text(text.replace(old, new))
    before, after = (
        read_description(broken),
        read_description(broken, DescriptionEdits(repair=True)),
    )
    faults = impossible_inertias(before.inertials, before.link_geometries)
    assert faults
    assert not impossible_inertias(after.inertials, after.link_geometries)
    copy = tmp_path / "copy.urdf"
    assert len(write_repaired(broken, DescriptionEdits(), copy)) == len(faults)
    copied = read_description(copy).inertials
    for link, inertial in after.inertials.items():
        np.testing.assert_allclose(copied[link].inertia_L, inertial.inertia_L, rtol=1e-6)
        assert inertial.mass == before.inertials[link].mass
        if link not in faults:
            np.testing.assert_array_equal(inertial.inertia_L, before.inertials[link].inertia_L)


def test_a_body_without_extent_is_left_out(tmp_path: Path) -> None:
    text = BARRETT.read_text()
    dummy = '<link name="dummy"><collision><geometry><sphere radius="0"/></geometry></collision>'
    joint = '<joint name="to_dummy" type="fixed"><parent link="palm"/><child link="dummy"/></joint>'
    path = tmp_path / "with_dummy.urdf"
    base = read_description(BARRETT).links[0]
    joint = joint.replace("palm", base)
    path.write_text(text.replace("</robot>", f"{dummy}</link>{joint}</robot>"))
    model = read_description(path)
    assert "dummy" in model.links
    assert "dummy" not in {body.link for body in model.link_geometries}


def test_an_undeclared_prefix_of_names_is_read(tmp_path: Path) -> None:
    path = tmp_path / "prefix.urdf"
    path.write_text(BARRETT.read_text().replace("</robot>", "<drake:note/></robot>"))
    assert read_description(path).joint_names == read_description(BARRETT).joint_names


def test_a_mesh_that_is_not_star_shaped_has_an_inner_ball() -> None:
    # A bent bar: no point of it sees all of it, and the mean of its vertices is outside.
    arms = [
        trimesh.creation.box([0.1, 0.02, 0.02]),
        trimesh.creation.box([0.02, 0.1, 0.02]).apply_translation([0.04, 0.06, 0]),
        trimesh.creation.box([0.1, 0.02, 0.02]).apply_translation([0, 0.12, 0]),
    ]
    bent = trimesh.util.concatenate(arms)
    body = convex_body("finger", np.eye(4), bent)
    centers, radii = balls_inside(body)
    assert len(radii) == 1
    assert trimesh.proximity.signed_distance(body.mesh, centers)[0] >= radii[0] - 1e-9


def test_a_visual_mesh_serves_where_no_collision_body_is(tmp_path: Path) -> None:
    trimesh.creation.icosphere(radius=0.01).export(tmp_path / "ball.stl")
    mesh = '<geometry><mesh filename="ball.stl"/></geometry>'
    link = f'<link name="extra"><visual>{mesh}</visual></link>'
    base = read_description(BARRETT).links[0]
    joint = (
        f'<joint name="to_extra" type="fixed"><parent link="{base}"/><child link="extra"/></joint>'
    )
    path = tmp_path / "visual.urdf"
    path.write_text(BARRETT.read_text().replace("</robot>", f"{link}{joint}</robot>"))
    model = read_description(path)
    assert model.hulls_of_visuals == ("extra",)
    (body,) = [body for body in model.link_geometries if body.link == "extra"]
    np.testing.assert_allclose(body.mesh.extents, 0.02, rtol=0.02)  # facets are inside the ball


def _with_extra(path: Path, mesh: str, more: str = "") -> Path:
    """Write the barrett's description with one more link that a mesh file shows."""
    geometry = f'<geometry><mesh filename="{mesh}"/></geometry>'
    link = f'<link name="extra"><visual>{geometry}</visual>{more}</link>'
    base = read_description(BARRETT).links[0]
    joint = (
        f'<joint name="to_extra" type="fixed"><parent link="{base}"/><child link="extra"/></joint>'
    )
    path.write_text(BARRETT.read_text().replace("</robot>", f"{link}{joint}</robot>"))
    return path


@pytest.mark.parametrize("content", [None, "no triangles"])
def test_a_visual_that_is_a_links_only_body_must_be_there(
    content: str | None, tmp_path: Path
) -> None:
    if content is not None:
        (tmp_path / "palm.stl").write_text(content)
    with pytest.raises(InvalidFileError) as refused:
        read_description(_with_extra(tmp_path / "hand.urdf", "palm.stl"))
    assert "palm.stl" in str(refused.value)


def test_a_missing_visual_of_a_link_with_a_body_is_noted(tmp_path: Path) -> None:
    body = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'
    with pytest.warns(LisGraspWarning) as noted:
        model = read_description(_with_extra(tmp_path / "hand.urdf", "palm.stl", body))
    (message,) = (str(w.message) for w in noted)
    assert "extra" in message
    assert "palm.stl" in message
    assert "extra" not in {visual.link for visual in model.visuals}


@pytest.mark.parametrize("uri", ["package://old_name/meshes/a.stl", "package://meshes/a.stl"])
def test_files_of_a_renamed_or_missing_package_are_found_above_the_file(
    uri: str, tmp_path: Path
) -> None:
    mesh = tmp_path / "new_name" / "meshes" / "a.stl"
    urdf = tmp_path / "new_name" / "urdf"
    for folder in (mesh.parent, urdf):
        folder.mkdir(parents=True)
    mesh.write_text("solid")
    assert resolve_uri(uri, urdf, "claw.urdf").samefile(mesh)


def test_models_are_found_in_a_folder_given_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "models" / "somebodys_hands" / "claw"
    package.mkdir(parents=True)
    document = yaml.safe_load(model_path("hands/barrett/barrett.yaml").read_text())
    document["urdf"] = "package://somebodys_hands/claw/claw.urdf"
    document["model_from"] = "pip install somebodys-hands"
    path = tmp_path / "claw.yaml"
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(InvalidHandError, match="pip install somebodys-hands"):
        Hand.load(path)
    (package / "claw.urdf").write_text(BARRETT.read_text())
    monkeypatch.setenv("LIS_GRASP_MODELS", str(tmp_path / "models"))
    assert Hand.load(path).joint_names == Hand.load("barrett").joint_names
    # A repository may hold the package, and hold it in a folder of packages.
    for deeper in ("repository", "of_more"):
        (tmp_path / "models").rename(tmp_path / deeper)
        (tmp_path / "models").mkdir()
        (tmp_path / deeper).rename(tmp_path / "models" / deeper)
        assert Hand.load(path).joint_names == Hand.load("barrett").joint_names
