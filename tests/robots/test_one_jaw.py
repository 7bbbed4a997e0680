"""Hands of one moving jaw against a fixed one: draft, plan, and lifts in both simulators."""

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lis_grasp import Hand, lift, plan, shapes
from lis_grasp.exceptions import InvalidHandError
from lis_grasp.geometry import apply_pose, rotate
from lis_grasp.results.notes import say_width
from lis_grasp.robots.draft.pipeline import draft_hand
from lis_grasp.robots.hand_check import opening_range

MASS = '<inertial><mass value="{0}"/><inertia ixx="{1}" iyy="{1}" izz="{1}"/></inertial>'
BODY = '<collision><origin xyz="{0}"/><geometry><box size="{1}"/></geometry></collision>'
PALM = BODY.format("0 0 0.02", "0.08 0.04 0.04")
# Inner faces at x = -0.01 and, with the joint at 0.2 rad, parallel to it 36 mm away.
FIXED = BODY.format("-0.015 0 0.08", "0.01 0.02 0.08")
JAW = BODY.format("0 0 0.04", "0.01 0.02 0.08")


def one_jaw(folder: Path, *, fixed: str = FIXED, arm: bool = False) -> Path:
    jaw = (
        f'<link name="base">{MASS.format(0.3, 2e-4)}{PALM}{fixed}</link>'
        f'<link name="jaw">{MASS.format(0.05, 3e-5)}{JAW}</link>'
        '<joint name="close" type="revolute"><parent link="base"/><child link="jaw"/>'
        '<origin xyz="0.031 0 0.04" rpy="0 -0.2 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-0.3" upper="1.2" effort="3" velocity="2"/></joint>'
    )
    chain = ["a", "b", "c", "d", "base"] if arm else []
    for parent, child in pairwise(chain):
        link = "" if child == "base" else f'<link name="{child}">{MASS.format(0.3, 2e-4)}</link>'
        jaw += (
            f'{link}<joint name="{child}_turn" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="0 0 1"/>'
            '<limit lower="-1" upper="1" effort="9" velocity="1"/></joint>'
        )
    jaw += '<link name="a"/>' if arm else ""
    path = folder / "one_jaw.urdf"
    path.write_text(f'<robot name="one_jaw">{jaw}</robot>')
    return path


def drafted(path: Path) -> Hand:
    return draft_hand(path, name="one_jaw", rng=np.random.default_rng(0)).hand


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return drafted(one_jaw(tmp_path_factory.mktemp("hand")))


@pytest.mark.parametrize("arm", [pytest.param(False, marks=pytest.mark.slow), True])
def test_the_pads_are_the_inner_faces_and_the_approach_ends_on_the_fixed_one(
    arm: bool, tmp_path: Path
) -> None:
    hand = drafted(one_jaw(tmp_path, arm=arm))
    assert hand.base_link == "base"
    assert hand.fixed_fingers == ("base",)
    moving, fixed = hand.pads
    assert (moving.link, fixed.link) == ("jaw", "base")
    np.testing.assert_allclose(fixed.axis_L, [1.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(moving.axis_L, [-1.0, 0.0, 0.0], atol=1e-6)
    assert fixed.center_L[0] == pytest.approx(-0.01)
    assert moving.center_L[0] == pytest.approx(-0.005)
    # Both are in the outer 40 mm of the moving jaw, which is 80 mm long.
    assert 0.08 < fixed.center_L[2] < 0.12
    assert 0.04 < moving.center_L[2] < 0.08
    towards_object = rotate(np.linalg.inv(hand.X_LH), fixed.axis_L)
    assert 0.3 < hand.approach_H @ towards_object < 0.6
    assert hand.link_fingers == {"base": "base", "jaw": "jaw"}


def test_a_fixed_jaw_off_the_base_is_a_finger_too(
    tmp_path: Path,
) -> None:
    path = one_jaw(tmp_path)
    mount = (
        f'<link name="mount">{MASS.format(0.3, 2e-4)}</link><joint name="fix" type="fixed">'
        '<parent link="mount"/><child link="base"/></joint></robot>'
    )
    path.write_text(path.read_text().replace("</robot>", mount))
    hand = drafted(path)
    assert hand.base_link == "mount"
    assert hand.link_fingers == {"base": "base", "jaw": "jaw"}


@pytest.mark.slow
def test_the_hand_holds_widths_at_which_its_jaws_are_about_parallel(hand: Hand) -> None:
    turned = sum(pad.half_angle for pad in hand.pads)  # of the jaw, whose face is parallel at 0.2
    # The centre of the moving pad, about the joint at x = 0.031, z = 0.04.
    radius = np.array([hand.pads[0].center_L[0], hand.pads[0].center_L[2]])
    fixed = hand.pads[1].center_L[[0, 2]]
    gaps = []
    for angle in np.linspace(-turned, turned, 200):
        c, s = np.cos(angle), np.sin(angle)
        moving = np.array([0.031, 0.04]) + np.array([[c, s], [-s, c]]) @ radius
        gaps.append(np.linalg.norm(moving - fixed))
    np.testing.assert_allclose(opening_range(hand), (min(gaps), max(gaps)), atol=1e-4)
    said: list[str] = []
    say_width(shapes.find("box", size=0.12).mesh, hand, SimpleNamespace(say=said.append))
    widths = f"{1e3 * min(gaps):.0f} to {1e3 * max(gaps):.0f} mm"
    assert len(said) == 1
    assert f"60 mm wide where it is narrowest, and pads of one_jaw are {widths} apart" in said[0]


def test_a_finger_with_nothing_opposite_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(InvalidHandError) as error:
        drafted(one_jaw(tmp_path, fixed=""))
    assert error.value.file == "one_jaw.urdf"


@pytest.mark.slow
def test_no_link_is_in_the_object_a_little_off_the_contacts(hand: Hand) -> None:
    box = shapes.find("box", size=0.06)
    search = plan(box, hand, grasps=3)
    assert len(search) == 3
    for grasp in search:
        fixed = grasp.contact_fingers.index("base")
        outward = grasp.contact_normals[fixed]
        assert grasp.approach_O @ outward < -0.3  # the fixed jaw comes onto its contact
        poses = hand.forward_kinematics(grasp.X_OH, grasp.joint_positions)
        for body in hand.link_geometries:
            X_OG = poses[body.link] @ body.X_LG
            depth = box.mesh.nearest.signed_distance(apply_pose(X_OG, body.mesh.vertices))
            assert (depth < 0.006).all()  # 3 mm off each jaw


@pytest.mark.slow
@pytest.mark.parametrize("simulator", ["drake", "mujoco"])
def test_the_wrist_brings_the_fixed_jaw_into_contact_and_the_object_is_held(
    simulator: str, tmp_path: Path
) -> None:
    if simulator == "mujoco":
        pytest.importorskip("mujoco")
    hand = drafted(one_jaw(tmp_path))
    box = shapes.find("box", size=0.06)
    search = plan(box, hand, grasps=4)
    results = [lift(box, hand, grasp, simulator=simulator, mass=0.1) for grasp in search]
    # The jaws are 0.08 rad from parallel, nearest at their tips. In MuJoCo bodies are rigid: the
    # tip's edge turns the box off the fixed jaw, and it slides; 2 of 4 are lifted, 1 of 4 is held.
    held = [result.held if simulator == "drake" else result.lifted for result in results]
    assert sum(held) >= (3 if simulator == "drake" else 2)
    for result in results:
        assert set(result.measured_contacts.fingers) == {"base", "jaw"}
