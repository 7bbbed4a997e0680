"""Arms: description files, kinematics against another library, mounts, and errors that help."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
import yourdfpy
from scipy.spatial.transform import Rotation

from lis_grasp.arms.mounted_hand import CLEARANCE, back_on_flange, mount_of
from lis_grasp.exceptions import InvalidArmError, InvalidHandError
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.arm_defaults import find_home
from lis_grasp.robots.body_pairs import BodyPairs, balls_around, pairs_of_bodies
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.kinematics import body_poses
from lis_grasp.robots.link_bodies import primitive
from lis_grasp.robots.pose_ik import ANGLE_TOLERANCE, POSITION_TOLERANCE, pose_error
from lis_grasp.robots.schema import ArmEntry
from lis_grasp.robots.shipped_models import model_path

# Two joints, the second sliding, and a gripper of two fingers beyond the flange.
_URDF = """
<robot name="two" xmlns:drake="http://drake.mit.edu">
  <link name="world"/>
  <link name="foot"><collision><origin xyz="0 0 0.05"/><geometry><box size="0.2 0.2 0.1"/>
    </geometry></collision></link>
  <link name="turret"><inertial><mass value="2"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="slide"><inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.05 0.05 0.05"/></geometry></collision></link>
  <link name="tool"/>
  <link name="finger"><inertial><mass value="0.1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="stand" type="fixed"><parent link="world"/><child link="foot"/>
    <origin xyz="0.3 0 0"/></joint>
  <joint name="turn" type="revolute"><parent link="foot"/><child link="turret"/>
    <origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="50" velocity="1.5" drake:acceleration="6"/>
    <dynamics damping="0.3"/></joint>
  <joint name="reach" type="prismatic"><parent link="turret"/><child link="slide"/>
    <origin xyz="0.2 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.3" effort="100"/></joint>
  <joint name="end" type="fixed"><parent link="slide"/><child link="tool"/>
    <origin xyz="0.05 0 0" rpy="0 1.5707963267948966 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="slide"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="10" velocity="1"/></joint>
  <transmission name="t"><type>SimpleTransmission</type><joint name="turn"/>
    <actuator name="m"><drake:rotor_inertia value="0.0002"/><drake:gear_ratio value="100"/>
    </actuator></transmission>
</robot>
"""


@pytest.fixture(scope="module")
def arm() -> Arm:
    return Arm.load("iiwa14")


def _write(folder: Path, urdf: str = _URDF, **changes: object) -> Path:
    (folder / "two.urdf").write_text(urdf)
    entry = {"name": "two", "urdf": "two.urdf", "flange": "tool", "home": [0.1, 0.1], **changes}
    path = folder / "two.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in entry.items() if v is not None}))
    return path


def test_flange_poses_equal_those_of_another_library(arm: Arm) -> None:
    robot = yourdfpy.URDF.load(model_path("arms/iiwa14/iiwa14.urdf"), load_meshes=False)
    q = np.random.default_rng(1).uniform(arm.lower, arm.upper, size=(20, 7))
    for posture, X_AF in zip(q, arm.kinematics.flange_poses(q), strict=True):
        robot.update_cfg(posture)
        np.testing.assert_allclose(X_AF, robot.get_transform("flange", "base"), atol=1e-12)


def test_the_upright_arm_is_as_high_as_published(arm: Arm) -> None:
    X_AF = arm.kinematics.flange_poses(np.zeros(7))
    np.testing.assert_allclose(X_AF[:3, 3], [0.0, 0.0, 0.36 + 0.42 + 0.40 + 0.126], atol=1e-12)
    fixed = sum(i.mass for link, i in arm.inertials.items() if link in arm.fixed_links)
    assert arm.mass + fixed == pytest.approx(29.9)


def test_jacobian_is_the_derivative_of_the_pose(tmp_path: Path, arm: Arm) -> None:
    rng, step = np.random.default_rng(2), 1e-6
    for each in (arm, Arm.load(_write(tmp_path))):  # with and without a sliding joint
        q = rng.uniform(each.lower, each.upper, size=(5, len(each.lower)))
        X, J = each.kinematics.jacobians(q)
        np.testing.assert_allclose(X, each.kinematics.flange_poses(q), atol=1e-14)
        for j in range(q.shape[1]):
            delta = step * np.eye(q.shape[1])[j]
            ahead, behind = (each.kinematics.flange_poses(q + s * delta) for s in (1, -1))
            # The error of a central difference is about step^2 + rounding / step.
            np.testing.assert_allclose(
                pose_error(behind, ahead) / (2.0 * step), J[:, :, j], atol=1e-8
            )


def test_joint_axes_turn_the_links_after_them(arm: Arm) -> None:
    q = np.random.default_rng(3).uniform(arm.lower, arm.upper)
    points, axes, turns = arm.kinematics.axes(q)
    assert turns.all()
    for j, angle in enumerate(np.linspace(0.2, 0.8, 7)):
        moved = q.copy()
        moved[j] += angle
        turn = Rotation.from_rotvec(angle * axes[j]).as_matrix()
        expected = np.eye(4)
        expected[:3, :3], expected[:3, 3] = turn, points[j] - turn @ points[j]
        np.testing.assert_allclose(
            arm.kinematics.flange_poses(moved),
            expected @ arm.kinematics.flange_poses(q),
            atol=1e-12,
        )


def test_ik_returns_to_poses_that_are_reached(arm: Arm) -> None:
    q = np.random.default_rng(4).uniform(arm.lower, arm.upper, size=(60, 7))
    targets = arm.kinematics.flange_poses(q)
    found = arm.ik.solve(targets, seeds=8)
    assert found.reached.mean() >= 0.95
    error = pose_error(arm.kinematics.flange_poses(found.q), targets[:, None])[found.solved]
    assert np.linalg.norm(error[:, :3], axis=1).max() < POSITION_TOLERANCE
    assert np.linalg.norm(error[:, 3:], axis=1).max() < ANGLE_TOLERANCE
    assert arm.within_limits(found.q[found.solved]).all()


def test_pose_error_is_the_rotation_vector_up_to_half_a_turn() -> None:
    vectors = np.random.default_rng(5).normal(size=(50, 3))
    vectors *= np.linspace(0.0, np.pi, 50)[:, None] / np.linalg.norm(vectors, axis=1, keepdims=True)
    X = np.tile(np.eye(4), (50, 1, 1))
    X[:, :3, :3] = Rotation.from_rotvec(vectors).as_matrix()
    error = pose_error(np.tile(np.eye(4), (50, 1, 1)), X)
    np.testing.assert_allclose(error[:-1, 3:], vectors[:-1], atol=1e-7)
    assert np.linalg.norm(error[-1, 3:]) == pytest.approx(np.pi)  # the axis is lost there


def test_limits_and_motors_come_from_the_file_and_the_yaml(tmp_path: Path) -> None:
    arm = Arm.load(
        _write(tmp_path, velocity_limits={"reach": 0.5}, position_limits={"turn": [-1, 1]})
    )
    assert arm.joint_names == ("turn", "reach")
    assert arm.links == ("world", "foot", "turret", "slide", "tool")  # no gripper
    np.testing.assert_array_equal([arm.lower, arm.upper], [[-1.0, 0.0], [1.0, 0.3]])
    np.testing.assert_array_equal(arm.velocity_limits, [1.5, 0.5])
    np.testing.assert_allclose(arm.acceleration_limits, [6.0, 0.5 / 0.2])
    np.testing.assert_allclose(arm.rotor_inertias, [2.0, 0.0])
    np.testing.assert_array_equal(arm.damping, [0.3, 0.0])
    np.testing.assert_allclose(arm.stiffness, [2000.0, 4000.0])
    assert arm.fixed_links == {"world", "foot"}
    assert arm.flange_links == {"slide", "tool"}


def test_a_flange_points_along_the_last_joint_to_its_free_side(tmp_path: Path) -> None:
    assert np.array_equal(Arm.load(_write(tmp_path)).X_LF, np.eye(4))  # +z of the tool is out
    of_slide = Arm.load(_write(tmp_path, flange="slide")).X_LF
    np.testing.assert_allclose(of_slide[:, 2], [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(of_slide[:3, 3], 0.0)
    assert np.linalg.det(of_slide) == pytest.approx(1.0)
    longer = _URDF.replace('size="0.05 0.05 0.05"', 'size="0.2 0.05 0.05"')
    moved = Arm.load(_write(tmp_path, longer, flange="slide")).X_LF
    np.testing.assert_allclose(moved[:3, 3], [0.1, 0.0, 0.0], atol=1e-12)
    given = Arm.load(
        _write(tmp_path, flange="slide", flange_pose={"translation": [0, 0, 0.1]})
    ).X_LF
    np.testing.assert_allclose(given[:3, 3], [0.0, 0.0, 0.1])
    np.testing.assert_allclose(given[:3, :3], np.eye(3))


def test_base_link_and_locked_joints_leave_the_rest(tmp_path: Path) -> None:
    path = _write(tmp_path, base_link="foot", locked_joints={"turn": 1.0}, home=[0.1])
    arm = Arm.load(path)
    assert arm.joint_names == ("reach",)
    X_AF = arm.kinematics.flange_poses([0.1])
    np.testing.assert_allclose(X_AF[:3, 3], [0.35 * np.cos(1), 0.35 * np.sin(1), 0.2], atol=1e-12)


def test_a_home_is_found_where_none_is_given(arm: Arm) -> None:
    home = find_home(arm, arm.kinematics, arm.self_collision_exclusions)
    assert arm.within_limits(home)
    X_AF = arm.kinematics.flange_poses(home)
    np.testing.assert_allclose(X_AF[:3, 2], [0.0, 0.0, -1.0], atol=ANGLE_TOLERANCE)
    assert X_AF[0, 3] > 0.3
    assert X_AF[2, 3] > 0.3
    bodies = BodyPairs(arm.link_geometries, pairs_of_bodies(arm, arm.self_collision_exclusions))
    bodies.place(body_poses(arm, home[None])[0])
    assert not list(bodies.touching(np.arange(len(bodies.pairs))))


@pytest.mark.parametrize("name", ["allegro", "wsg50", "barrett"])
def test_a_hand_is_mounted_by_its_back_with_the_least_adapter(arm: Arm, name: str) -> None:
    hand = Hand.load(name)
    mount = mount_of(arm, hand)
    flush = back_on_flange(hand)
    np.testing.assert_allclose(mount.X_FB[:3, :3], flush[:3, :3])
    np.testing.assert_allclose(mount.X_FB[:3, 3] - flush[:3, 3], [0, 0, mount.adapter], atol=1e-12)
    X_FH = flush @ hand.X_LH
    np.testing.assert_allclose(X_FH[:3, :3] @ hand.approach_H, [0.0, 0.0, 1.0], atol=1e-12)
    base = [g for g in hand.link_geometries if g.link == hand.base_link]
    heights = [(g.mesh.vertices @ (flush @ g.X_LG)[2, :3]) + (flush @ g.X_LG)[2, 3] for g in base]
    assert min(float(h.min()) for h in heights) == pytest.approx(0.0, abs=1e-9)


def test_the_adapter_keeps_moving_links_off_the_flange(arm: Arm) -> None:
    hand = Hand.load("allegro")
    mount = mount_of(arm, hand)
    assert mount.adapter > 0.0  # flush, the thumb is nearer than the clearance
    last = [g for g in arm.link_geometries if g.link == "link_7"]
    thumb = [g for g in hand.link_geometries if g.link.startswith("thumb")]
    pairs = np.array([(i, len(last) + j) for i in range(len(last)) for j in range(len(thumb))])
    bodies = BodyPairs([*last, *thumb], pairs)
    links = arm.forward_kinematics(np.eye(4), arm.home)
    nearest = {}
    for adapter in (0.0, mount.adapter):
        X_FB = back_on_flange(hand)
        X_FB[2, 3] += adapter
        X_AH = arm.kinematics.flange_poses(arm.home) @ X_FB @ hand.X_LH
        found = []
        for q in hand.pregrasps.values():
            in_hand = hand.forward_kinematics(X_AH, q)
            poses = [links[g.link] @ g.X_LG for g in last]
            bodies.place(np.array(poses + [in_hand[g.link] @ g.X_LG for g in thumb]))
            found += [bodies.distance(pair) for pair in range(len(pairs))]
        nearest[adapter] = min(found)
    assert nearest[0.0] < CLEARANCE <= nearest[mount.adapter]


def test_a_mount_inside_the_arm_is_refused(arm: Arm, tmp_path: Path) -> None:
    text = model_path("hands/allegro/allegro.yaml").read_text()
    urdf = model_path("hands/allegro/allegro.urdf")
    text = text.replace("urdf: allegro.urdf", f"urdf: {urdf}")
    (tmp_path / "own.yaml").write_text(text + "mount: {translation: [0, 0, -0.05]}\n")
    hand = Hand.load(tmp_path / "own.yaml")
    with pytest.raises(InvalidHandError) as error:
        mount_of(arm, hand)
    assert error.value.key == "mount"
    (tmp_path / "own.yaml").write_text(
        text + "mount: {translation: [0, 0, 0.2], rpy: [1.57, 0, 0]}\n"
    )
    own = mount_of(arm, Hand.load(tmp_path / "own.yaml"))
    np.testing.assert_allclose(own.X_FB[:3, 3], [0.0, 0.0, 0.2])
    assert own.adapter == 0.0


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere", "capsule"])
def test_balls_cover_a_body(kind: str) -> None:
    sizes = {
        "box": [0.3, 0.1, 0.05],
        "cylinder": [0.05, 0.4],
        "sphere": [0.1],
        "capsule": [0.05, 0.2],
    }
    body = primitive("link", np.eye(4), kind, sizes[kind])
    centers, radii = balls_around(body)
    points = body.mesh.sample(500, seed=0)
    inside = np.linalg.norm(points[:, None] - centers, axis=2) <= radii + 1e-9
    assert inside.any(axis=1).all()


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"flange": "nothing"}, "flange"),
        ({"base_link": "slide", "flange": "turret"}, "flange"),
        ({"home": [0.1]}, "home"),
        ({"home": [3.0, 0.1]}, "home"),
        ({"joints": ["reach", "turn"]}, "joints"),
        ({"velocity_limits": {"elbow": 1.0}}, "velocity_limits.elbow"),
        ({"position_limits": {"turn": [1.0, 0.0]}}, "position_limits.turn"),
        ({"speed_fraction": 1.5}, "speed_fraction"),
        ({"speed": 1.0}, "speed"),
        ({"stiffness": [1.0]}, "stiffness"),
        ({"urdf": "other.urdf"}, "urdf"),
        ({"self_collision_exclusions": [["foot", "wing"]]}, "self_collision_exclusions[0]"),
    ],
)
def test_a_mistake_in_the_yaml_is_named(tmp_path: Path, changes: dict, key: str) -> None:
    with pytest.raises(InvalidArmError) as error:
        Arm.load(_write(tmp_path, **changes))
    assert (error.value.file, error.value.key) == ("two.yaml", key)


def test_a_mistake_in_the_urdf_is_an_error_of_the_arm(tmp_path: Path) -> None:
    with pytest.raises(InvalidArmError) as error:
        Arm.load(_write(tmp_path, _URDF.replace('<mass value="1"/>', '<mass value="0"/>')))
    assert (error.value.file, error.value.key) == ("two.yaml", "urdf")
    with pytest.raises(InvalidArmError) as error:
        Arm.load(_write(tmp_path, _URDF.replace("</robot>", "")))
    assert (error.value.file, error.value.key) == ("two.yaml", "urdf")


def test_unknown_arms_are_refused_with_the_nearest_name(tmp_path: Path) -> None:
    with pytest.raises(InvalidArmError, match="'iiwa14'"):
        Arm.load("iiwa41")
    with pytest.raises(InvalidArmError) as error:
        Arm.load(tmp_path / "absent.yaml")
    assert error.value.file == "absent.yaml"


def test_a_description_given_as_an_arm_needs_its_yaml() -> None:
    with pytest.raises(InvalidArmError) as error:
        Arm.load("two.urdf")
    assert error.value.file == "two.urdf"


def test_the_shipped_schema_is_that_of_the_package_and_arms_name_it() -> None:
    schema = model_path("arms/arm.schema.json")
    assert json.loads(schema.read_text()) == ArmEntry.model_json_schema()
    files = [*model_path("arms").glob("*/*.yaml")]
    assert len(files) >= 7
    for path in files:
        first = path.read_text().splitlines()[0]
        assert first == "# yaml-language-server: $schema=../arm.schema.json"


@pytest.mark.slow  # imports Drake
def test_drake_reads_the_shipped_arm_alike(arm: Arm) -> None:
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModels(str(arm.path))
    plant.WeldFrames(plant.world_frame(), plant.GetBodyByName(arm.base_link).body_frame())
    plant.Finalize()
    context = plant.CreateDefaultContext()
    joints = [plant.GetJointByName(name) for name in arm.joint_names]
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    limits = np.array(
        [
            [
                j.position_lower_limits()[0],
                j.position_upper_limits()[0],
                j.velocity_upper_limits()[0],
            ]
            for j in joints
        ]
    )
    np.testing.assert_allclose(limits.T, [arm.lower, arm.upper, arm.velocity_limits])
    np.testing.assert_allclose(
        [j.acceleration_upper_limits()[0] for j in joints], arm.acceleration_limits
    )
    np.testing.assert_allclose([a.effort_limit() for a in actuators], arm.effort_limits)
    np.testing.assert_allclose(
        [a.default_gear_ratio() ** 2 * a.default_rotor_inertia() for a in actuators],
        arm.rotor_inertias,
    )
    np.testing.assert_allclose([j.default_damping() for j in joints], arm.damping)
    for q in np.random.default_rng(7).uniform(arm.lower, arm.upper, size=(5, 7)):
        plant.SetPositions(context, q)
        flange = plant.GetBodyByName(arm.flange)
        X_AF = plant.EvalBodyPoseInWorld(context, flange).GetAsMatrix4()
        np.testing.assert_allclose(arm.kinematics.flange_poses(q), X_AF, atol=1e-12)
    assert plant.CalcTotalMass(context) == pytest.approx(29.9)


def test_a_key_given_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "two.yaml"
    path.write_text("name: two\nname: three\n")
    with pytest.raises(InvalidArmError, match="occurs 2 times") as error:
        Arm.load(path)
    assert error.value.file == "two.yaml"
