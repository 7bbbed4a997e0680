"""Hands: shipped dimensions, kinematics against Drake, and mistakes in files."""

import copy
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from trimesh.collision import CollisionManager

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import hand_findings
from lis_grasp.robots.schema import HandEntry
from lis_grasp.robots.shipped_models import HAND_NAMES, model_path


@pytest.fixture(scope="module", params=HAND_NAMES)
def hand(request: pytest.FixtureRequest) -> Hand:
    return Hand.load(request.param)


def random_state(hand: Hand, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    X = trimesh.transformations.random_rotation_matrix(rng.uniform(size=3))
    X[:3, 3] = rng.uniform(-1.0, 1.0, 3)
    return X, rng.uniform(hand.lower, hand.upper)


def drake_plant(name: str) -> Any:
    """Parse the URDF by Drake alone: an oracle that shares no code with `Hand`."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModels(str(model_path(f"hands/{name}/{name}.urdf")))
    plant.Finalize()
    return plant


def drake_context(plant: Any, hand: Hand, X_OH: np.ndarray, q: np.ndarray) -> Any:
    from pydrake.math import RigidTransform

    context = plant.CreateDefaultContext()
    X_OL = RigidTransform(X_OH @ np.linalg.inv(hand.X_LH))
    plant.SetFreeBodyPose(context, plant.GetBodyByName(hand.base_link), X_OL)
    positions = plant.GetPositions(context)
    for joint in hand.joints:
        if joint.index >= 0:  # those that a transmission couples to others too
            place = plant.GetJointByName(joint.name).position_start()
            positions[place] = joint.multiplier * q[joint.index] + joint.offset
    plant.SetPositions(context, positions)
    return context


def test_forward_kinematics_agrees_with_drake(hand: Hand) -> None:
    plant, rng = drake_plant(hand.name), np.random.default_rng(1)
    for _ in range(5):
        X_OH, q = random_state(hand, rng)
        context = drake_context(plant, hand, X_OH, q)
        for link, X_OL in hand.forward_kinematics(X_OH, q).items():
            expected = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(link))
            # Both multiply about ten matrices of order 1: rounding alone.
            np.testing.assert_allclose(X_OL, expected.GetAsMatrix4(), atol=1e-13)


def test_pad_jacobians_are_the_derivatives_of_pad_centers_and_axes(hand: Hand) -> None:
    X_OH, q = random_state(hand, np.random.default_rng(3))
    step = 1e-6  # central differences: error of order step^2 plus rounding over step, 1e-10

    def moved(k: int, amount: float) -> tuple[np.ndarray, np.ndarray]:
        X, positions = X_OH.copy(), q.copy()
        if k < 3:
            turn = trimesh.transformations.rotation_matrix(amount, np.eye(3)[k])
            X[:3, :3] = turn[:3, :3] @ X[:3, :3]
        elif k < 6:
            X[k - 3, 3] += amount
        else:
            positions[k - 6] += amount
        return hand.pad_centers(X, positions), hand.pad_axes(X, positions)

    *places, of_centers, of_axes = hand.pad_jacobians(X_OH, q)
    for place, same in zip(places, moved(0, 0.0), strict=True):
        np.testing.assert_allclose(place, same, atol=1e-14)
    for k in range(6 + len(q)):
        ahead, behind = moved(k, step), moved(k, -step)
        for jacobian, plus, minus in zip((of_centers, of_axes), ahead, behind, strict=True):
            difference = (plus - minus) / (2.0 * step)
            np.testing.assert_allclose(jacobian[..., k], difference, atol=1e-8)


def test_a_batch_gives_what_its_members_give(hand: Hand) -> None:
    rng = np.random.default_rng(4)
    states = [random_state(hand, rng) for _ in range(4)]
    X = np.stack([pose for pose, _ in states])[:, None]  # (4, 1, 4, 4)
    q = np.stack([positions for _, positions in states])  # (4, J)
    poses = hand.forward_kinematics(X, q)  # (4, 4, 4, 4) by broadcasting
    centers, axes, jacobian = (
        hand.pad_centers(X, q),
        hand.pad_axes(X, q),
        hand.pad_jacobians(X, q)[2],
    )
    for i in range(4):
        for j in range(4):
            single = hand.forward_kinematics(states[i][0], q[j])
            for link in hand.links:
                np.testing.assert_allclose(poses[link][i, j], single[link], atol=1e-14)
            for batch, one in (
                (centers, hand.pad_centers),
                (axes, hand.pad_axes),
                (jacobian, lambda *state: hand.pad_jacobians(*state)[2]),
            ):
                np.testing.assert_allclose(batch[i, j], one(states[i][0], q[j]), atol=1e-14)


def test_allegro_has_the_published_dimensions() -> None:
    hand = Hand.load("allegro")
    tips = hand.pad_centers(hand.X_LH, np.zeros(16))  # in the base link's frame
    # A fingertip's nail is 6 mm in front of its finger and ends 12 mm beyond the last link.
    front, reach = 0.006, 0.0164 + 0.054 + 0.0384 + 0.0267 + 0.012 - 0.003
    np.testing.assert_allclose(tips[1], [front, 0.0, 0.0007 + reach], atol=1e-12)
    # The index finger leans outwards by 0.0873 rad from its root.
    lean = np.array([0.0, np.sin(0.0873), np.cos(0.0873)])
    np.testing.assert_allclose(tips[0], [front, 0.0435, -0.001542] + reach * lean, atol=1e-12)
    np.testing.assert_allclose(hand.effort_limits, 0.7)
    assert hand.mass == pytest.approx(1.08, abs=0.005)
    assert hand.fingers == ("index", "middle", "ring", "thumb")
    assert hand.finger_joints("thumb") == (12, 13, 14, 15)
    assert hand.link_fingers["ring_link_2"] == "ring"
    assert "palm" not in hand.link_fingers


def test_the_jaw_opens_by_110_mm_between_flat_pads_that_face_each_other() -> None:
    hand = Hand.load("wsg50")
    left, right = hand.pad_centers(np.eye(4), hand.upper)
    np.testing.assert_allclose(left - right, [0.11, 0.0, 0.0], atol=1e-12)
    axes = hand.pad_axes(np.eye(4), hand.upper)
    np.testing.assert_allclose(axes[0], -axes[1])
    assert [pad.radius for pad in hand.pads] == [0.0, 0.0]
    assert hand.kind == "parallel_jaw"
    assert hand.max_contact_force <= hand.effort_limits.min()


@pytest.mark.parametrize(
    ("pregrasp", "gap"), [("wide", 0.14), ("medium", 0.095), ("narrow", 0.055)]
)
def test_allegro_thumb_opposes_the_fingers_before_a_grasp(pregrasp: str, gap: float) -> None:
    hand = Hand.load("allegro")
    q = hand.pregrasps[pregrasp]
    centers, axes = hand.pad_centers(np.eye(4), q), hand.pad_axes(np.eye(4), q)
    between = centers[1] - centers[3]  # thumb to middle finger
    # The names promise the gap to half a centimetre.
    assert np.linalg.norm(between) - 2 * hand.pads[0].radius == pytest.approx(gap, abs=0.005)
    between /= np.linalg.norm(between)
    half_angle = hand.pads[0].half_angle
    assert axes[3] @ between > np.cos(half_angle)
    assert -axes[1] @ between > np.cos(half_angle)


def test_named_postures_do_not_collide_with_the_hand_itself(hand: Hand) -> None:
    probing = {f"probe {f}": p.joint_positions for f, p in hand.probe_postures.items()}
    for name, q in {**hand.pregrasps, **probing}.items():
        assert not self_collisions(hand, q), name


def self_collisions(hand: Hand, q: np.ndarray) -> set[tuple[str, str]]:
    poses, manager = hand.forward_kinematics(np.eye(4), q), CollisionManager()
    for i, body in enumerate(hand.link_geometries):
        manager.add_object(str(i), body.mesh, poses[body.link] @ body.X_LG)
    _, pairs = manager.in_collision_internal(return_names=True)
    links = [body.link for body in hand.link_geometries]
    touching = {tuple(sorted((links[int(a)], links[int(b)]))) for a, b in pairs}
    return {pair for pair in touching if pair[0] != pair[1]} - hand.self_collision_exclusions


@pytest.mark.parametrize(("name", "lead"), [("allegro", 0.08), ("wsg50", 0.05), ("barrett", 0.09)])
def test_the_leading_tip_is_ahead_of_everything_but_its_own_finger(name: str, lead: float) -> None:
    hand = Hand.load(name)
    assert set(hand.probe_postures) == set(hand.fingers)
    for finger, posture in hand.probe_postures.items():
        poses = hand.forward_kinematics(np.eye(4), posture.joint_positions)
        tip = poses[posture.link][:3, :3] @ posture.center_L + poses[posture.link][:3, 3]
        front = tip @ posture.direction_H + posture.radius
        for body in hand.link_geometries:
            vertices = trimesh.transform_points(body.mesh.vertices, poses[body.link] @ body.X_LG)
            own = hand.link_fingers.get(body.link) == finger
            ahead = float((vertices @ posture.direction_H).max())
            # Allegro's middle finger leads a rake: its neighbours are extended beside it.
            beside = own or (name == "allegro" and finger == "middle")
            behind = ahead <= front + 1e-9 if beside else ahead <= front - lead
            assert behind, (finger, body.link)


def test_collision_bodies_are_closed_and_as_large_as_their_dimensions(hand: Hand) -> None:
    for body in hand.link_geometries:
        assert body.mesh.is_volume
        match body.kind:
            case "box":
                volume = np.prod(body.dimensions)
            case "sphere":
                volume = 4.0 / 3.0 * np.pi * body.dimensions[0] ** 3
            case "cylinder":
                volume = np.pi * body.dimensions[0] ** 2 * body.dimensions[1]
        # Facets are within 1 % of the radius, so within 2 % of a cross-section and 3 % of a ball.
        assert body.mesh.volume == pytest.approx(volume, rel=0.03)


def test_arrays_are_read_only(hand: Hand) -> None:
    arrays = [hand.lower, hand.X_LH, hand.approach_H, *hand.pregrasps.values()]
    assert not any(array.flags.writeable for array in arrays)


def shipped(tmp_path: Path) -> tuple[dict[str, Any], Path]:
    """Return the jaw's YAML, and a path to write it to, beside a copy of its URDF."""
    folder = model_path("hands/wsg50")
    (tmp_path / "wsg50.urdf").write_text((folder / "wsg50.urdf").read_text())
    return yaml.safe_load((folder / "wsg50.yaml").read_text()), tmp_path / "mine.yaml"


@pytest.mark.parametrize(
    ("given", "key"),
    [
        (["table"], "families"),
        (["pinch", "flat_faces"], "families"),  # without low_objects
        (["pinch", "toss"], "families[1]"),
    ],
)
def test_families_that_a_hand_cannot_do_are_named(
    tmp_path: Path, given: list[str], key: str
) -> None:
    document, path = shipped(tmp_path)
    path.write_text(yaml.safe_dump(document | {"families": given}))
    with pytest.raises(InvalidHandError) as error:
        Hand.load(path)
    assert (error.value.file, error.value.key) == ("mine.yaml", key)


def test_a_hand_does_the_families_of_its_yaml_or_those_of_its_kind(tmp_path: Path) -> None:
    document, path = shipped(tmp_path)
    path.write_text(yaml.safe_dump(document | {"families": ["pinch", "table"]}))
    assert Hand.load(path).slides_on_table
    assert Hand.load("wsg50").families == ("pinch", "rim")
    assert Hand.load("allegro").families == ("pinch", "rim", "table")


def test_a_hand_of_ones_own_is_read_from_its_yaml(tmp_path: Path) -> None:
    document, path = shipped(tmp_path)
    document["name"] = "mine"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    assert Hand.load(path).name == Hand.load(str(path)).name == "mine"


# What is changed in the file, and the key that the error names.
MISTAKES: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "missing key": (lambda d: d.pop("approach"), "approach"),
    "unknown key": (lambda d: d.update(aproach=[0, 0, 1]), "aproach"),
    "kind": (lambda d: d.update(kind="claw"), "kind"),
    "joint order": (lambda d: d["joints"].reverse(), "joints"),
    "no such link": (lambda d: d["pads"]["left"].update(link="thumb"), "pads.left.link"),
    "negative radius": (lambda d: d["pads"]["left"].update(radius=-0.1), "pads.left.radius"),
    "no angle": (lambda d: d["pads"]["left"].update(half_angle=4.0), "pads.left.half_angle"),
    "zero direction": (lambda d: d.update(approach=[0, 0, 0]), "approach"),
    "not a number": (lambda d: d.update(approach=[0, 0, "1"]), "approach[2]"),
    "truth as a number": (lambda d: d.update(max_contact_force=True), "max_contact_force"),
    "nan": (lambda d: d.update(max_contact_force=float("nan")), "max_contact_force"),
    "no force": (lambda d: d.update(max_contact_force=0), "max_contact_force"),
    "wrong length": (lambda d: d["pregrasps"].update(wide=[0.05]), "pregrasps.wide"),
    "outside limits": (lambda d: d["pregrasps"].update(wide=[0.05, 0.06]), "pregrasps.wide"),
    "one finger": (lambda d: d["pads"].pop("left"), "pads"),
    "no such finger": (
        lambda d: d["probe_postures"].update(nose=d["probe_postures"]["left"]),
        "probe_postures.nose",
    ),
    "odd pair": (
        lambda d: d["self_collision_exclusions"].append(["body"]),
        "self_collision_exclusions[6]",
    ),
    "no such URDF": (lambda d: d.update(urdf="nowhere.urdf"), "urdf"),
    "degrees": (lambda d: d["palm_frame"].update(rpy=[0, 0, 90]), "palm_frame.rpy"),
}


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda d: d["palm_frame"].update(translation=[0, 0, 40]), "palm_frame"),
        (lambda d: d.update(approach=[0, 0, -1]), "approach"),
    ],
)
def test_a_palm_frame_in_mm_and_a_backward_approach_are_to_be_fixed(
    tmp_path: Path, spoil: Callable[[dict[str, Any]], Any], named: str
) -> None:
    document, path = shipped(tmp_path)
    path.write_text(yaml.safe_dump(document))
    assert all(finding.fine for finding in hand_findings(Hand.load(path)))
    spoil(document)
    path.write_text(yaml.safe_dump(document))
    wrong = [each for each in hand_findings(Hand.load(path)) if not each.fine]
    assert any(each.text.startswith(named) for each in wrong)


@pytest.mark.parametrize("limit", ["5.5", "55"])
def test_slides_in_cm_or_mm_are_to_be_fixed(tmp_path: Path, limit: str) -> None:
    document, path = shipped(tmp_path)
    path.write_text(yaml.safe_dump(document))
    urdf = tmp_path / "wsg50.urdf"
    urdf.write_text(re.sub(r'upper="[\d.]+"', f'upper="{limit}"', urdf.read_text()))
    wrong = [each.text for each in hand_findings(Hand.load(path)) if not each.fine]
    assert any("left_slide" in text for text in wrong)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_the_yaml_is_named_in_one_line(tmp_path: Path, mistake: str) -> None:
    original, path = shipped(tmp_path)
    document = copy.deepcopy(original)
    spoil, key = MISTAKES[mistake]
    spoil(document)
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(InvalidHandError) as error:
        Hand.load(path)
    assert (error.value.file, error.value.key) == ("mine.yaml", key)
    assert "\n" not in str(error.value)


def test_a_mistyped_key_that_is_optional_is_compared_with_those_known(tmp_path: Path) -> None:
    document, path = shipped(tmp_path)
    document["effort_limit"] = {}
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(InvalidHandError, match="'effort_limits'"):
        Hand.load(path)


def test_the_shipped_schema_is_that_of_the_package_and_hands_name_it() -> None:
    schema = model_path("hands/hand.schema.json")
    assert json.loads(schema.read_text()) == HandEntry.model_json_schema()
    for name in HAND_NAMES:
        path = model_path(f"hands/{name}/{name}.yaml")
        first = path.read_text().splitlines()[0]
        assert first == "# yaml-language-server: $schema=../hand.schema.json"
        assert (path.parent / "../hand.schema.json").is_file()


URDF_MISTAKES = {
    "broken XML": ("</robot>", "", "not valid XML"),
    "no effort": ('effort="40"', "", "effort above 0"),
    "limits": ('upper="0.055"', 'upper="-1"', "lower limit below its upper limit"),
    "joint type": ('type="prismatic"', 'type="planar"', "is of type 'planar'"),
    "mass": ("<mass value=", "<mass was=", "a mass above 0"),
    "two roots": ('<parent link="body"/>', '<parent link="left_tip"/>', "one tree|loop|parent"),
    "axis": ('<axis xyz="1 0 0"/>', '<axis xyz="0 0 0"/>', "not all 0"),
    "flat axis": ('<axis xyz="1 0 0"/>', '<axis xyz="1 0"/>', "three numbers in xyz"),
    "missing mesh": (
        '<box size="0.146 0.0495 0.0725"/>',
        '<mesh filename="package://hand/body.stl"/>',
        "was not found",
    ),
    "mesh without a file": (
        '<box size="0.146 0.0495 0.0725"/>',
        '<mesh filenamm="body.stl"/>',
        "each mesh must name its file",
    ),
}


@pytest.mark.parametrize("mistake", URDF_MISTAKES)
def test_a_mistake_in_the_urdf_is_named(tmp_path: Path, mistake: str) -> None:
    document, path = shipped(tmp_path)
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    urdf = tmp_path / "wsg50.urdf"
    right, wrong, message = URDF_MISTAKES[mistake]
    urdf.write_text(urdf.read_text().replace(right, wrong))
    with pytest.raises(InvalidHandError, match=message) as error:
        Hand.load(path)
    assert f"{urdf}" in str(error.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("locked_joints", {"nowhere": 0.0}),
        ("effort_limits", {"nowhere": 1.0}),
        ("base_link", "nowhere"),
        ("convex_parts", ["nowhere"]),
    ],
)
def test_a_mistaken_edit_of_the_urdf_is_said_of_the_yaml(
    key: str, value: Any, tmp_path: Path
) -> None:
    document, path = shipped(tmp_path)
    path.write_text(yaml.safe_dump(document | {key: value}))
    with pytest.raises(InvalidHandError) as error:
        Hand.load(path)
    assert error.value.file == "mine.yaml"
    assert error.value.key.startswith(key)


def test_a_mesh_of_the_urdf_is_found_beside_it_and_scaled(tmp_path: Path) -> None:
    document, path = shipped(tmp_path)
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    urdf = tmp_path / "wsg50.urdf"
    trimesh.creation.box(extents=[146.0, 49.5, 72.5]).export(tmp_path / "body.stl")
    mesh = '<mesh filename="package://hand/body.stl" scale="0.001 0.001 0.001"/>'
    urdf.write_text(urdf.read_text().replace('<box size="0.146 0.0495 0.0725"/>', mesh))
    body = Hand.load(path).link_geometries[0]
    assert body.kind == "mesh"
    np.testing.assert_allclose(body.mesh.extents, [0.146, 0.0495, 0.0725], rtol=1e-6)  # float32


def test_a_package_uri_does_not_lead_out_of_its_package(tmp_path: Path) -> None:
    folder = tmp_path / "hand"
    folder.mkdir()
    document, path = shipped(folder)
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    trimesh.creation.box().export(tmp_path / "body.stl")
    urdf = folder / "wsg50.urdf"
    mesh = '<mesh filename="package://hand/../body.stl"/>'
    urdf.write_text(urdf.read_text().replace('<box size="0.146 0.0495 0.0725"/>', mesh))
    with pytest.raises(InvalidHandError) as error:
        Hand.load(path)
    assert (error.value.file, error.value.key) == ("mine.yaml", "urdf")


def test_names_and_files_that_are_no_hand_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidHandError) as error:
        Hand.load("claw")
    assert (error.value.file, error.value.key) == ("", "")
    with pytest.raises(InvalidHandError) as error:
        Hand.load(tmp_path / "absent.yaml")
    assert error.value.file == "absent.yaml"
    broken = tmp_path / "broken.yaml"
    broken.write_text("name: [")
    with pytest.raises(InvalidHandError) as error:
        Hand.load(broken)
    assert error.value.file == "broken.yaml"
    broken.write_text("just a text")
    with pytest.raises(InvalidHandError) as error:
        Hand.load(broken)
    assert error.value.file == "broken.yaml"


@pytest.mark.parametrize("name", ["mine.urdf", "mine.SDF", "mine.xml"])
def test_a_description_given_as_a_hand_needs_its_yaml(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.touch()
    with pytest.raises(InvalidHandError, match=f"lis-grasp hand new {path}") as error:
        Hand.load(path)
    assert error.value.file == name


@pytest.mark.parametrize(
    ("place", "key", "typo"), [([], "approach", "aproach"), (["pads", "left"], "radius", "radus")]
)
def test_an_unknown_key_is_named_beside_the_missing_one(
    tmp_path: Path, place: list[str], key: str, typo: str
) -> None:
    document, path = shipped(tmp_path)
    mapping = document
    for name in place:
        mapping = mapping[name]
    mapping[typo] = mapping.pop(key)
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(InvalidHandError, match=f"'{typo}'.*'{key}'") as error:
        Hand.load(path)
    assert error.value.key == ".".join([*place, key])


def test_barrett_has_the_published_dimensions_and_couplings() -> None:
    hand = Hand.load("barrett")
    assert hand.mass == pytest.approx(0.98, abs=1e-9)
    assert hand.joint_names == ("spread", "finger_1", "finger_2", "finger_3")
    joints = {joint.name: joint for joint in hand.joints}
    assert np.linalg.norm(joints["finger_3_distal"].X_PJ[:3, 3]) == pytest.approx(0.070)
    tip = hand.forward_kinematics(np.eye(4), np.zeros(4))
    outer = np.linalg.inv(tip["finger_3_outer"]) @ tip["finger_3_tip"]
    assert outer[0, 3] + hand.pads[2].radius == pytest.approx(0.058)
    # 140 degrees of a finger's first joint are 48 of its second; the spread is even.
    closed = np.radians([180.0, 140.0, 140.0, 140.0])
    assert joints["finger_1_distal"].position(closed) == pytest.approx(np.radians(48.2), abs=1e-3)
    left, right, _ = hand.pad_centers(np.eye(4), [0.7, 0.5, 0.5, 0.5])
    # The URDF's right angles have six digits.
    np.testing.assert_allclose(left * [-1.0, 1.0, 1.0], right, atol=2e-6)


def test_a_mimic_joint_without_a_leader_is_refused(tmp_path: Path) -> None:
    folder = model_path("hands/barrett")
    for name in ("barrett.urdf", "barrett.yaml"):
        text = (folder / name).read_text()
        (tmp_path / name).write_text(text.replace('<mimic joint="spread"', '<mimic joint="palm"'))
    with pytest.raises(InvalidHandError) as error:
        Hand.load(tmp_path / "barrett.yaml")
    assert error.value.file == "barrett.urdf"
