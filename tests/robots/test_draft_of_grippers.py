"""Drafts of small grippers and robots written here, each with a trait of vendors' files."""

import re
import sys
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.lifting.setup import useful_efforts
from lis_grasp.robots._build_model import read_description
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.draft._pads import fit_pads
from lis_grasp.robots.draft._probe_postures import find_probe_postures
from lis_grasp.robots.draft._structure import find_exclusions, find_fingers, find_hand_bases
from lis_grasp.robots.draft.pipeline import draft_hand
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import hand_findings
from lis_grasp.robots.link_bodies import load_link_mesh
from lis_grasp.robots.shipped_models import HAND_NAMES

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
    rpy: tuple = (0, 0, 0),
    kind: str = "prismatic",
    limits: tuple = (0.0, 0.04),
    mimic: str = "",
) -> str:
    follow = f"<mimic {mimic}/>" if mimic else ""
    xyz, turned, along = (" ".join(map(str, row)) for row in (at, rpy, axis))
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{turned}"/><axis xyz="{along}"/>'
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
    model = read_description(written(tmp_path, link(*BASE), *chain))
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
    with pytest.raises(InvalidHandError) as error:
        read_description(written(tmp_path, link(*BASE), *parts))
    assert error.value.file == "gripper.urdf"


def test_a_xacro_file_is_refused_without_xacro_with_the_command_that_converts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    path = tmp_path / "hand.urdf.xacro"
    path.write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="x"><xacro:arg name="a"/></robot>'
    )
    with pytest.raises(InvalidHandError, match=rf"xacro {re.escape(str(path))} > hand\.urdf"):
        read_description(path)


def test_the_pointer_of_a_large_file_is_no_mesh(tmp_path: Path) -> None:
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n"
    (tmp_path / "tip.stl").write_text(pointer)
    with pytest.raises(InvalidFileError, match="git lfs pull"):
        load_link_mesh(tmp_path / "tip.stl", None)


def test_pads_of_a_jaw_are_its_inner_faces_though_racks_cross(tmp_path: Path) -> None:
    model = read_description(written(tmp_path, link(*BASE), *jaw(rack=True)))
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
    model = read_description(written(tmp_path, link(*BASE), *parts))
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
    model = read_description(written(tmp_path, link(*BASE), *parts))
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
    assert find_hand_bases(read_description(path)) == ("grip_palm",)
    draft = draft_hand(path, name="grip", rng=np.random.default_rng(0))
    assert draft.edits.base_link == "grip_palm"
    assert {pad.link for pad in draft.hand.pads} == {"grip_left", "grip_right"}
    assert draft.hand.kind == "parallel_jaw"


def test_a_gripper_alone_has_no_arm_to_leave_out(tmp_path: Path) -> None:
    assert find_hand_bases(read_description(written(tmp_path, link(*BASE), *jaw()))) == ()


def test_fingers_without_bodies_are_refused_in_words(tmp_path: Path) -> None:
    bare = [part for part in jaw() if part.startswith("<joint")]
    bare += [link("left", []), link("right", [])]
    model = read_description(written(tmp_path, link(*BASE), *bare))
    with pytest.raises(InvalidHandError, match="no bodies"):
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


def test_a_horn_that_turns_in_place_is_no_finger(tmp_path: Path) -> None:
    horn = [
        link("horn", [((0.03, 0.006, 0.006), (0.0, 0.0, 0.0))]),
        joint("turn", "base", "horn", (0, 0, 1), at=(0.05, 0, 0), kind="continuous"),
    ]
    model = read_description(written(tmp_path, link(*BASE), *jaw(), *horn))
    assert {finger.name for finger in find_fingers(model)} == {"left", "right"}


def claw(
    name: str, side: int, at: float, bend: float, *, lean: float = 0.0, mimic: str = ""
) -> list[str]:
    """Return a finger of one bar at (at, 0.01 side), leaning outwards, that bends inwards."""
    return [
        link(name, [((0.012, 0.012, 0.07), (0.0, 0.0, 0.05))]),
        joint(
            f"{name}_bend",
            "base",
            name,
            (side, 0, 0),
            at=(at, 0.01 * side, 0.0),
            rpy=(-side * lean, 0.0, 0.0),
            kind="revolute",
            limits=(0.0, bend),
            mimic=mimic,
        ),
    ]


@pytest.mark.slow
def test_pads_are_less_tilted_where_fingers_cannot_face_each_other_otherwise(
    tmp_path: Path,
) -> None:
    # Bars that lean outwards by 0.6 rad at least: axes tilted by 0.45 rad to the tips do not face.
    claws = [
        *claw("first", 1, 0.0, 0.1, lean=0.7),
        *claw("second", -1, -0.015, 0.1, lean=0.7, mimic='joint="first_bend"'),
        *claw("last", -1, 0.015, 0.1, lean=0.7, mimic='joint="first_bend"'),
    ]
    path = written(tmp_path, link(*BASE), *claws)
    hand = draft_hand(path, name="claws", rng=np.random.default_rng(0)).hand
    assert max(abs(pad.axis_L[2]) for pad in hand.pads) < np.sin(0.3)


def test_links_two_joints_apart_may_overlap_near_the_ends_of_their_ranges(tmp_path: Path) -> None:
    # A thumb's tip gets into the hull of the base at the end of the first joint's range only.
    thumb = [
        link("root", [((0.004, 0.004, 0.004), (0.0, 0.0, 0.0))]),
        joint(
            "turn", "base", "root", (0, 0, 1), at=(0, 0.08, 0), kind="revolute", limits=(0, 3.14)
        ),
        link("thumb", [((0.004, 0.025, 0.01), (0.0, 0.0178, 0.0))]),
        joint("bend", "root", "thumb", (0, 1, 0), kind="revolute", limits=(-0.2, 0.2)),
    ]
    path = written(tmp_path, link(*BASE), *thumb, *claw("a", -1, -0.02, 1), *claw("b", -1, 0.02, 1))
    pads = {
        name: {"link": name, "center": [0, 0, 0], "radius": 0.003, "axis": [0, 0, 1]}
        for name in ("thumb", "a", "b")
    }
    document = {
        "name": "claws",
        "kind": "multi_finger",
        "urdf": path.name,
        "joints": ["turn", "bend", "a_bend", "b_bend"],
        "palm_frame": {"translation": [0, 0, 0], "rpy": [0, 0, 0]},
        "approach": [0, 0, 1],
        "max_contact_force": 5,
        "pads": {name: pad | {"half_angle": 1.0} for name, pad in pads.items()},
        "pregrasps": {"only": [0, 0, 0.1, 0.1]},
        "self_collision_exclusions": [],
    }
    (tmp_path / "claws.yaml").write_text(yaml.safe_dump(document))
    hand = Hand.load(tmp_path / "claws.yaml")
    checker = HandCollisionChecker(hand)
    assert checker.self_collisions(np.array([3.14, 0.0, 0.1, 0.1])) == {("base", "thumb")}
    turns = np.linspace(0.0, 2.6, 7)
    assert not any(checker.self_collisions(np.array([t, 0.0, 0.1, 0.1])) for t in turns)
    assert ("base", "thumb") in find_exclusions(hand, checker, rng=np.random.default_rng(0))


@pytest.mark.slow
def test_a_finger_leads_where_the_others_cannot_all_fold() -> None:
    hand = Hand.load("allegro")
    rest = np.clip(0.0, hand.lower, hand.upper)
    joints = [list(hand.finger_joints(pad.finger)) for pad in hand.pads]

    class CrowdedPalm:
        """Lets one finger alone be far from its joint positions 0."""

        def self_collisions(self, q: np.ndarray) -> set[tuple[str, str]]:
            folded = [f for f, own in enumerate(joints) if np.abs(q - rest)[own].max() > 0.8]
            links = [hand.pads[f].link for f in folded]
            return {tuple(sorted(pair)) for pair in combinations(links, 2)}

    palm = CrowdedPalm()
    found = find_probe_postures(hand, palm, rng=np.random.default_rng(0))
    assert len(found) == len(hand.pads)
    for posture in found.values():
        assert not palm.self_collisions(posture.joint_positions)


def parallel_finger(name: str, side: int, at: float, mimic: str = "") -> list[str]:
    """Return a bar that turns inwards, with a flat tip that turns back as much."""
    back = 'joint="one_bar" multiplier="-1"'
    return [
        link(f"{name}_rod", [((0.006, 0.006, 0.05), (0.0, 0.0, 0.03))]),
        joint(
            f"{name}_bar",
            "base",
            f"{name}_rod",
            (side, 0, 0),
            at=(at, 0.03 * side, 0.02),
            kind="revolute",
            limits=(-0.5, 0.5),
            mimic=mimic,
        ),
        link(name, [((0.02, 0.01, 0.05), (0.0, 0.0, 0.0))]),
        joint(
            f"{name}_back",
            f"{name}_rod",
            name,
            (side, 0, 0),
            at=(0, 0, 0.06),
            kind="revolute",
            limits=(-0.5, 0.5),
            mimic=back,
        ),
    ]


def test_pads_of_tips_that_are_kept_parallel_face_each_other_straight(tmp_path: Path) -> None:
    follow = 'joint="one_bar"'
    claws = [
        *parallel_finger("one", 1, 0.0),
        *parallel_finger("two", -1, -0.03, follow),
        *parallel_finger("three", -1, 0.03, follow),
    ]
    model = read_description(written(tmp_path, link(*BASE), *claws))
    fingers = find_fingers(model)
    assert [finger.name for finger in fingers] == ["one", "two", "three"]
    for pad, side in zip(fit_pads(model, fingers), (1, -1, -1), strict=True):
        np.testing.assert_allclose(pad.axis_L, [0, -side, 0], atol=1e-9)
        # On the inner face and its middle line (but for the lattice of directions), near the end.
        np.testing.assert_allclose(
            (pad.center_L + pad.radius * pad.axis_L)[:2], [0, -0.005 * side], atol=1e-4
        )
        assert pad.center_L[2] > 0.0


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("thdistal", "thumb"),
        ("rh_thtip", "thumb"),
        ("th", "thumb"),
        ("ff_link_3", "index"),
        ("lf", "left"),  # of two fingers: no little one
        ("three", "three"),
        ("off_side", "off_side"),
        ("right_index_tip", "index"),
    ],
)
def test_a_short_name_of_a_finger_is_a_word_of_its_own(
    tmp_path: Path, name: str, expected: str
) -> None:
    parts = [part.replace('"left', f'"{name}') for part in jaw()]
    fingers = find_fingers(read_description(written(tmp_path, link(*BASE), *parts)))
    assert len(fingers) == 2
    assert expected in {finger.name for finger in fingers}


def test_no_point_of_a_tip_is_ahead_of_its_probing_sphere() -> None:
    hand = Hand.load("barrett")
    found = find_probe_postures(hand, HandCollisionChecker(hand), rng=np.random.default_rng(0))
    assert found
    for posture in found.values():
        poses = hand.forward_kinematics(np.eye(4), posture.joint_positions)
        center = poses[posture.link][:3, :3] @ posture.center_L + poses[posture.link][:3, 3]
        bodies = [b for b in hand.link_geometries if b.link == posture.link]
        ahead = max(
            float((points @ posture.direction_H).max())
            for body in bodies
            for X in [poses[body.link] @ body.X_LG]
            for points in [np.asarray(body.mesh.vertices) @ X[:3, :3].T + X[:3, 3]]
        )
        assert ahead <= center @ posture.direction_H + posture.radius + 1e-9


def test_a_mark_at_the_end_of_a_finger_carries_no_pad(tmp_path: Path) -> None:
    marks = []
    for side, sign in (("left", 1), ("right", -1)):
        marks += [
            link(f"{side}_mark", [((0.002, 0.002, 0.002), (0.0, 0.0, 0.0))]),
            joint(
                f"{side}_fixed",
                side,
                f"{side}_mark",
                (0, 0, 1),
                at=(0, sign * 0.015, 0.085),
                kind="fixed",
            ),
        ]
    model = read_description(written(tmp_path, link(*BASE), *jaw(), *marks))
    assert {finger.link for finger in find_fingers(model)} == {"left", "right"}


def test_a_face_behind_a_protruding_fingertip_is_no_pad(tmp_path: Path) -> None:
    parts = jaw()
    for i, (side, sign) in ((0, ("left", 1)), (2, ("right", -1))):
        block = ((0.03, 0.01, 0.03), (0.0, sign * 0.025, 0.035))  # the larger face, at y = 20 mm
        tip = ((0.016, 0.016, 0.02), (0.0, sign * 0.013, 0.06))  # 15 mm in front of it
        parts[i] = link(side, [block, tip])
    path = written(tmp_path, link(*BASE), *parts)
    draft = draft_hand(path, name="stepped", rng=np.random.default_rng(0))
    for pad, sign in zip(draft.hand.pads, (1, -1), strict=True):
        np.testing.assert_allclose(pad.center_L, [0, sign * 0.005, 0.06], atol=1e-6)
    # On the block they would be no good pads, and doctor says so.
    behind = tuple(
        replace(pad, center_L=np.array([0.0, sign * 0.020, 0.035]))
        for pad, sign in zip(draft.hand.pads, (1, -1), strict=True)
    )
    for pads, fine in ((draft.hand.pads, True), (behind, False)):
        found = hand_findings(replace(draft.hand, pads=pads))
        of_pads = [finding for finding in found if finding.text.startswith("pad ")]
        assert [finding.fine for finding in of_pads] == [fine, fine]
