"""Drafts of small grippers and robots written here, each with a trait of vendors' files."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.hands.draft.draft_hand import draft_hand
from lis_grasp.hands.draft.find_fingers import find_fingers
from lis_grasp.hands.draft.find_hand_bases import find_hand_bases
from lis_grasp.hands.draft.fit_pads import fit_pads
from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_urdf import read_urdf
from lis_grasp.hands.link_bodies import load_mesh
from lis_grasp.hands.shipped_models import HAND_NAMES
from lis_grasp.hands.useful_efforts import useful_efforts

BASE = ("base", [((0.06, 0.1, 0.04), (0.0, 0.0, 0.0))])


def link(name: str, boxes: list) -> str:
    bodies = "".join(
        f'<collision><origin xyz="{" ".join(map(str, center))}"/><geometry>'
        f'<box size="{" ".join(map(str, size))}"/></geometry></collision>'
        for size, center in boxes
    )
    inertia = '<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/>'
    return f'<link name="{name}"><inertial><mass value="0.1"/>{inertia}</inertial>{bodies}</link>'


def joint(
    name: str,
    parent: str,
    child: str,
    axis: tuple,
    *,
    at: tuple = (0, 0, 0),
    kind: str = "prismatic",
    limits: tuple = (0.0, 0.04),
    mimic: str = "",
) -> str:
    follow = f"<mimic {mimic}/>" if mimic else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{" ".join(map(str, at))}"/><axis xyz="{" ".join(map(str, axis))}"/>'
        f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="20" velocity="1"/>{follow}</joint>'
    )


def written(folder: Path, *parts: str) -> Path:
    path = folder / "gripper.urdf"
    path.write_text(f'<robot name="gripper">{"".join(parts)}</robot>')
    return path


def jaw(base: str = "base", *, rack: bool = False) -> list[str]:
    """Return two fingers that slide along y, 10 mm apart when closed; perhaps on long racks."""
    parts = []
    for side, sign in (("left", 1), ("right", -1)):
        boxes = [((0.02, 0.02, 0.06), (0.0, sign * 0.015, 0.05))]
        if rack:  # a bar below the fingers that reaches far to the other side
            boxes.append(((0.01, 0.12, 0.01), (sign * 0.02, -sign * 0.03, 0.026)))
        parts += [link(side, boxes), joint(f"{side}_slide", base, side, (0, sign, 0))]
    return parts


def test_a_joint_that_mimics_a_mimicking_joint_follows_the_leader(tmp_path: Path) -> None:
    chain = [
        *(link(name, [((0.02, 0.02, 0.04), (0, 0, 0.02))]) for name in ("a", "b", "c")),
        joint("one", "base", "a", (1, 0, 0), kind="revolute"),
        joint("two", "a", "b", (1, 0, 0), kind="revolute", mimic='joint="one" multiplier="2"'),
        joint(
            "three",
            "b",
            "c",
            (1, 0, 0),
            kind="revolute",
            mimic='joint="two" multiplier="-3" offset="0.5"',
        ),
    ]
    model = read_urdf(written(tmp_path, link(*BASE), *chain))
    assert model.joint_names == ("one",)
    positions = {j.name: float(j.position(np.array([0.1]))) for j in model.joints}
    assert positions == pytest.approx({"one": 0.1, "two": 0.2, "three": 0.5 - 3 * 0.2})


def test_a_loop_of_mimicking_joints_is_refused(tmp_path: Path) -> None:
    parts = [
        *(link(name, [((0.02, 0.02, 0.04), (0, 0, 0.02))]) for name in ("a", "b", "c")),
        joint("free", "base", "c", (1, 0, 0)),
        joint("one", "base", "a", (1, 0, 0), mimic='joint="two"'),
        joint("two", "base", "b", (1, 0, 0), mimic='joint="one"'),
    ]
    with pytest.raises(InvalidHandError, match="mimics"):
        read_urdf(written(tmp_path, link(*BASE), *parts))


def test_a_xacro_file_is_refused_with_the_command_that_converts_it(tmp_path: Path) -> None:
    path = tmp_path / "hand.urdf.xacro"
    path.write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="x"><xacro:arg name="a"/></robot>'
    )
    with pytest.raises(InvalidHandError, match=r"xacro hand\.urdf\.xacro >"):
        read_urdf(path)


def test_the_pointer_of_a_large_file_is_no_mesh(tmp_path: Path) -> None:
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n"
    (tmp_path / "tip.stl").write_text(pointer)
    with pytest.raises(InvalidFileError, match="git lfs pull"):
        load_mesh(tmp_path / "tip.stl", None)


def test_pads_of_a_jaw_are_its_inner_faces_though_racks_cross(tmp_path: Path) -> None:
    model = read_urdf(written(tmp_path, link(*BASE), *jaw(rack=True)))
    left, right = fit_pads(model, find_fingers(model))
    for pad, sign in ((left, 1), (right, -1)):
        np.testing.assert_allclose(pad.axis_L, [0, -sign, 0], atol=1e-9)
        # The middle of the inner face, whose hull with the rack would be oblique.
        np.testing.assert_allclose(pad.center_L, [0, sign * 0.005, 0.05], atol=1e-6)


def test_a_face_behind_another_body_is_no_pad(tmp_path: Path) -> None:
    parts = jaw()
    for i, sign in ((0, 1), (2, -1)):  # a smaller plate 1 mm in front of each inner face
        plate = ((0.016, 0.002, 0.05), (0.0, sign * 0.005, 0.05))
        parts[i] = link(
            "left" if sign > 0 else "right", [((0.02, 0.02, 0.06), (0, sign * 0.015, 0.05)), plate]
        )
    model = read_urdf(written(tmp_path, link(*BASE), *parts))
    for pad, sign in zip(fit_pads(model, find_fingers(model)), (1, -1), strict=True):
        np.testing.assert_allclose(pad.center_L, [0, sign * 0.004, 0.05], atol=1e-6)


def test_bars_of_a_linkage_are_no_fingers_however_far_the_base_reaches(tmp_path: Path) -> None:
    parts = []
    for side, sign in (("left", 1), ("right", -1)):
        follow = "" if side == "left" else 'joint="left_finger"'
        parts += [
            link(f"{side}_tip", [((0.02, 0.01, 0.1), (0, 0, 0.05))]),
            link(f"{side}_bar", [((0.01, 0.01, 0.06), (0, 0, 0.03))]),
            joint(
                f"{side}_finger",
                "base",
                f"{side}_tip",
                (-sign, 0, 0),
                at=(0, sign * 0.03, 0.3),
                kind="revolute",
                limits=(0, 0.8),
                mimic=follow,
            ),
            joint(
                f"{side}_bar_joint",
                "base",
                f"{side}_bar",
                (-sign, 0, 0),
                at=(0, sign * 0.02, 0.3),
                kind="revolute",
                limits=(0, 0.8),
                mimic='joint="left_finger"',
            ),
        ]
    model = read_urdf(written(tmp_path, link(*BASE), *parts))
    assert {finger.link for finger in find_fingers(model)} == {"left_tip", "right_tip"}


def robot(*hands: str) -> list[str]:
    """Return a robot with wheels, and an arm of three joints for each hand."""
    parts = [link(*BASE)]
    for wheel in ("wheel_1", "wheel_2"):
        parts += [
            link(wheel, [((0.1, 0.02, 0.1), (0, 0, 0))]),
            joint(f"{wheel}_axle", "base", wheel, (0, 1, 0), kind="continuous"),
        ]
    for hand in hands:
        names = ["base", f"{hand}_1", f"{hand}_2", f"{hand}_palm"]
        for parent, child in pairwise(names):
            parts += [
                link(child, [((0.04, 0.06, 0.04), (0, 0, 0))]),
                joint(f"{child}_joint", parent, child, (1, 0, 0), at=(0, 0, 0.1), kind="revolute"),
            ]
        parts += [part.replace('"left', f'"{hand}_left') for part in jaw(names[-1])]
    return [part.replace('"right', f'"{hands[0]}_right') for part in parts]


def test_the_hand_of_a_whole_robot_is_found_at_the_end_of_its_arm(tmp_path: Path) -> None:
    path = written(tmp_path, *robot("grip"))
    assert find_hand_bases(read_urdf(path)) == ("grip_palm",)
    draft = draft_hand(path, name="grip", rng=np.random.default_rng(0))
    assert draft.edits.base_link == "grip_palm"
    assert {pad.link for pad in draft.hand.pads} == {"grip_left", "grip_right"}
    assert draft.hand.kind == "jaw"


def test_a_gripper_alone_has_no_arm_to_leave_out(tmp_path: Path) -> None:
    assert find_hand_bases(read_urdf(written(tmp_path, link(*BASE), *jaw()))) == ()


def test_fingers_without_bodies_are_refused_in_words(tmp_path: Path) -> None:
    bare = [part for part in jaw() if part.startswith("<joint")]
    bare += [link("left", []), link("right", [])]
    model = read_urdf(written(tmp_path, link(*BASE), *bare))
    with pytest.raises(InvalidHandError, match="no bodies"):
        find_fingers(model)


def test_one_finger_against_a_fixed_jaw_is_refused_in_words(tmp_path: Path) -> None:
    model = read_urdf(written(tmp_path, link(*BASE), *jaw()[:2]))
    with pytest.raises(InvalidHandError, match="fixed jaw"):
        find_fingers(model)


@pytest.mark.parametrize("name", HAND_NAMES)
def test_efforts_of_the_shipped_hands_are_all_useful_and_absurd_ones_are_not(name: str) -> None:
    hand = Hand.load(name)
    q = next(iter(hand.pregrasps.values()))
    useful = useful_efforts(hand, q)
    np.testing.assert_array_equal(useful, hand.effort_limits)
    capped = useful_efforts(replace(hand, effort_limits=1e4 * hand.effort_limits), q)
    # No lever of these hands is longer than 0.2 m: three times the force at it bounds the effort.
    turning = {j.index for j in hand.joints if j.is_actuated and j.kind == "revolute"}
    levers = np.array([0.2 if j in turning else 1.0 for j in range(len(capped))])
    assert (capped <= 3.0 * hand.max_contact_force * levers).all()
    assert (capped > 0.0).all()
