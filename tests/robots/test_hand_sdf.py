"""Hands from SDF files: frames against Drake, couplings, and mistakes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from claw import SDF, YAML

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import hand_findings
from lis_grasp.robots.shipped_models import model_path


def write(folder: Path, sdf: str = SDF) -> Path:
    (folder / "claw.sdf").write_text(sdf)
    path = folder / "claw.yaml"
    path.write_text(yaml.safe_dump(YAML))
    return path


def drake_plant(path: Path) -> Any:
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModels(str(path))
    plant.WeldFrames(plant.world_frame(), plant.GetBodyByName("palm").body_frame())
    plant.Finalize()
    return plant


QUATERNION = (
    '<link name="thumb"><pose>-0.03 0 0.02 0 0 0</pose>',
    '<link name="thumb"><pose rotation_format="quat_xyzw">-0.03 0 0.02 0 0.6 0 0.8</pose>',
)


@pytest.mark.parametrize("change", [("", ""), QUATERNION], ids=["angles", "quaternion"])
def test_every_link_is_where_drake_has_it(change: tuple[str, str], tmp_path: Path) -> None:
    assert change[0] in SDF
    hand = Hand.load(write(tmp_path, SDF.replace(*change, 1)))
    plant, rng = drake_plant(tmp_path / "claw.sdf"), np.random.default_rng(0)
    context = plant.CreateDefaultContext()
    for _ in range(4):
        q = rng.uniform(hand.lower, hand.upper)
        positions = plant.GetPositions(context)
        for joint in hand.joints:
            if joint.index >= 0:
                place = plant.GetJointByName(joint.name).position_start()
                positions[place] = joint.multiplier * q[joint.index] + joint.offset
        plant.SetPositions(context, positions)
        ours = hand.forward_kinematics(hand.X_LH, q)  # the palm link at the world's origin
        for link in ("palm", "finger", "tip", "thumb", "plate"):
            theirs = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(link)).GetAsMatrix4()
            # A dozen products of matrices of order 1.
            np.testing.assert_allclose(ours[link], theirs, atol=1e-12)


def test_limits_couplings_and_masses_are_those_of_the_file(tmp_path: Path) -> None:
    hand = Hand.load(write(tmp_path))
    assert hand.joint_names == ("bend", "slide")
    np.testing.assert_array_equal(hand.lower, [-0.5, -0.5])
    np.testing.assert_array_equal(hand.effort_limits, [3.0, 3.0])
    curl = next(joint for joint in hand.joints if joint.name == "curl")
    assert (curl.follows, curl.multiplier, curl.offset) == (True, 0.5, 0.1)
    assert hand.mass == pytest.approx(0.8)
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    inertia = np.array([[2e-4, 1e-5, 0], [1e-5, 3e-4, -2e-5], [0, -2e-5, 2.5e-4]])
    np.testing.assert_allclose(hand.inertials["tip"].inertia_L, turn @ inertia @ turn.T, atol=1e-18)
    kinds = {geometry.link: geometry.kind for geometry in hand.link_geometries}
    assert kinds == {"palm": "box", "finger": "capsule", "tip": "sphere", "thumb": "cylinder"}


def test_a_body_may_be_placed_relative_to_another_link(tmp_path: Path) -> None:
    here = "<pose>0 0 0.03 0 0 0</pose><geometry><cylinder>"
    there = '<pose relative_to="palm">-0.03 0 0.05 0 0 0</pose><geometry><cylinder>'
    assert here in SDF
    (tmp_path / "other").mkdir()
    first = Hand.load(write(tmp_path)).link_geometries
    second = Hand.load(write(tmp_path / "other", SDF.replace(here, there))).link_geometries
    for ours, theirs in zip(first, second, strict=True):
        np.testing.assert_allclose(ours.X_LG, theirs.X_LG, atol=1e-15)


def test_a_shipped_hand_written_as_sdf_is_the_same_hand(tmp_path: Path) -> None:
    jaw, folder = Hand.load("wsg50"), model_path("hands/wsg50")
    ball = "<geometry><sphere><radius>0.001</radius></sphere></geometry>"
    links = "".join(
        f'<link name="{link}"><inertial><mass>{i.mass}</mass><inertia><ixx>1e-4</ixx>'
        "<iyy>1e-4</iyy><izz>1e-4</izz></inertia></inertial>"
        f'<collision name="c">{ball}</collision></link>'
        for link, i in jaw.inertials.items()
    )
    joints = ""
    for j in jaw.joints:
        joints += f'<joint name="{j.name}" type="{j.kind}"><parent>{j.parent}</parent>'
        joints += f"<child>{j.child}</child>"
        if j.kind != "fixed":
            axis = " ".join(map(str, j.axis_J))
            joints += f"<axis><xyz>{axis}</xyz><limit><lower>{jaw.lower[j.index]}</lower>"
            joints += f"<upper>{jaw.upper[j.index]}</upper><effort>40</effort></limit></axis>"
        joints += "</joint>"
    poses = jaw.forward_kinematics(jaw.X_LH, np.zeros(2))  # in the base link
    for link, X in poses.items():
        x, y, z = X[:3, 3]
        assert np.allclose(X[:3, :3], np.eye(3))
        links = links.replace(
            f'<link name="{link}">', f'<link name="{link}"><pose>{x} {y} {z} 0 0 0</pose>'
        )
    (tmp_path / "wsg50.sdf").write_text(
        f'<sdf version="1.9"><model name="wsg50">{links}{joints}</model></sdf>'
    )
    text = (folder / "wsg50.yaml").read_text().replace("wsg50.urdf", "wsg50.sdf")
    (tmp_path / "wsg50.yaml").write_text(text)
    hand = Hand.load(tmp_path / "wsg50.yaml")
    q, X = np.array([0.02, 0.05]), np.eye(4)
    for link, pose in jaw.forward_kinematics(X, q).items():
        np.testing.assert_allclose(hand.forward_kinematics(X, q)[link], pose, atol=1e-12)
    assert any("no links collide" in finding.text for finding in hand_findings(hand))


def test_a_mimic_joint_of_sdf_is_coupled_about_its_reference(tmp_path: Path) -> None:
    limit = "<upper>1.2</upper><effort>3</effort></limit></axis>"
    coupled = '<mimic joint="bend"><multiplier>0.5</multiplier><offset>0.1</offset>'
    coupled += "<reference>0.3</reference></mimic></axis>"
    head, tail = SDF.split('<joint name="curl"')
    tail = tail.replace(limit, limit.replace("</axis>", coupled), 1)
    tail = tail.replace('<drake:mimic joint="bend" multiplier="0.5" offset="0.1"/>', "")
    hand = Hand.load(write(tmp_path, f'{head}<joint name="curl"{tail}'))
    curl = next(joint for joint in hand.joints if joint.name == "curl")
    # 0.5 (q - 0.3) + 0.1
    assert (curl.follows, curl.multiplier) == (True, 0.5)
    assert curl.offset == pytest.approx(0.1 - 0.5 * 0.3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<model name="claw">', '<model name="claw"><include/>', "nested models are not read"),
        ("</model></sdf>", "</model><model/></sdf>", "one model; it holds 2"),
        ("<parent>palm</parent><child>finger", "<parent>wrist</parent><child>finger", "'wrist'"),
        ('type="prismatic"', 'type="ball"', "is of type 'ball'"),
        ('relative_to="knuckle"', 'relative_to="elbow"', "relative to 'elbow'"),
        ('attached_to="palm"', 'attached_to="knuckle"', "relative to itself"),
        ("<effort>3</effort>", "", "an effort above 0"),
        ("0.02 0.01 0.03 0.2 -0.1 0.4", "0.02 0.01 0.03", "a pose must have 6 numbers"),
        (
            "<radius>0.009</radius>",
            "<radius>wide</radius>",
            "expected instead of 'wide'",
        ),
        ("collision", "light", "must give links collision bodies"),
        ('mimic joint="bend"', 'mimic joint="curl"', "curl mimics itself"),
        ("<sdf ", '<sdf odd:key="1" ', "a name whose prefix it does not declare"),
    ],
)
def test_a_mistake_in_the_sdf_is_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in SDF
    with pytest.raises(InvalidHandError, match=message):
        Hand.load(write(tmp_path, SDF.replace(old, new)))
