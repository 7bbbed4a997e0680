"""Hands from MJCF files: frames, masses, bodies and couplings against MuJoCo's own."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from lis_grasp.exceptions import LisGraspError
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose
from lis_grasp.robots._build_model import build_model
from lis_grasp.robots._description import DescriptionEdits, parse_description
from lis_grasp.robots.kinematics import link_kinematics
from lis_grasp.robots.link_bodies import fibonacci_directions
from lis_grasp.robots.robot_model import RobotModel

# Degrees, a class, inherited classes, a base with a free joint, a loose object, anchors off the
# body's origin, reference positions, two joints of one body, unnamed bodies, and each kind of geom.
HAND = """<mujoco model="odd"><compiler angle="degree" autolimits="true"/>
<default><default class="finger"><joint range="-20 80" axis="0 1 0"/><geom density="700"/>
<default class="seen"><geom contype="0" conaffinity="0"/></default></default></default>
<asset><mesh name="wedge" scale="1 2 -1" vertex="0 0 0 .02 0 0 0 .01 0 0 0 .04 .02 .01 .04"/>
</asset><worldbody><geom type="plane" size="1 1 .1"/>
<body name="palm" pos=".1 .2 .3" euler="10 20 30"><freejoint/>
  <geom type="box" size=".05 .04 .01"/><geom class="seen" type="sphere" size=".09"/>
  <body name="one" pos=".03 0 .02" euler="0 90 20" childclass="finger">
    <joint name="knuckle" pos="0 .004 -.01" ref="15"/><geom type="mesh" mesh="wedge" euler="5 6 7"/>
    <body pos="0 0 .04"><joint name="tip" axis="1 1 0" ref="12"/>
      <geom type="capsule" fromto="0 0 0 .01 .02 .03" size=".005"/></body></body>
  <body name="two" pos="-.03 0 .02" childclass="finger"><inertial pos="0 .01 0" mass=".2"
      fullinertia="3e-4 2e-4 2e-4 1e-5 0 0"/>
    <joint name="spread" axis="0 0 1"/><joint name="bend" pos=".001 0 0"/>
    <geom type="ellipsoid" size=".004 .006 .02" pos="0 0 .02" quat="1 .2 0 0"/>
    <body name="slider" pos="0 0 .05"><joint name="slide" type="slide" range="0 .01"/>
      <geom type="cylinder" size=".004 .01"/></body></body>
  <body name="three" pos="0 .03 .02" childclass="finger"><joint name="sprung" springref="30"/>
    <geom type="sphere" size=".006"/>
    <body name="last" pos="0 0 .02"><joint name="pulled"/><geom type="sphere" size=".006"/>
    </body></body>
</body>
<body name="cube" pos="0 0 1"><freejoint/><geom type="box" size=".02 .02 .02"/></body></worldbody>
<tendon><fixed name="pair"><joint joint="spread" coef=".5"/><joint joint="pulled" coef="-1"/>
</fixed></tendon><equality><joint joint1="tip" joint2="knuckle" polycoef=".1 .7 0 0 0"/></equality>
<actuator><position joint="knuckle" kp="5" forcerange="-2 3"/><motor joint="bend" gear="10"
ctrlrange="-.4 .3"/><position joint="slide" kp="3"/><motor tendon="pair" ctrlrange="0 4"/>
</actuator></mujoco>"""


def written(folder: Path, text: str = HAND) -> Path:
    path = folder / "odd.xml"
    path.write_text(text)
    return path


def read(path: Path) -> RobotModel:
    return build_model(
        parse_description(path), path, DescriptionEdits(effort_limits={"slide": 9.0})
    )


@pytest.fixture
def mujoco() -> Any:
    return pytest.importorskip("mujoco")


def test_links_of_an_mjcf_are_where_mujoco_has_them(tmp_path: Path, mujoco: Any) -> None:
    path = written(tmp_path)
    model = read(path)
    assert model.joint_names == ("knuckle", "spread", "bend", "slide")
    oracle = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(oracle)
    rng = np.random.default_rng(3)
    for q in rng.uniform(model.lower, model.upper, (20, 4)):
        placed = link_kinematics(model).poses(np.eye(4), q)
        at = {joint.name: joint.position(q) for joint in model.joints if joint.kind != "fixed"}
        at |= {
            "tip": np.radians(12.0) + 0.1 + 0.7 * (q[0] - np.radians(15.0)),
            "pulled": -2.0 * q[1],
        }
        at["sprung"] = np.radians(30.0)
        for name, position in at.items():
            data.qpos[oracle.joint(name).qposadr[0]] = position
        mujoco.mj_kinematics(oracle, data)
        X_WB = _pose(data, oracle.body("palm").id)
        for number in range(oracle.body("palm").id, oracle.body("cube").id):
            name = oracle.body(number).name or f"body_{number}"
            X_BL = inverse_pose(X_WB) @ _pose(data, number)
            np.testing.assert_allclose(placed[name], X_BL, atol=1e-12)
            _same_bodies(model, name, oracle, number)


def _pose(data: Any, body: int) -> np.ndarray:
    return make_pose(data.xmat[body].reshape(3, 3), data.xpos[body])


def _same_bodies(model: RobotModel, name: str, oracle: Any, number: int) -> None:
    """Compare mass, inertia and the support of all colliding bodies with MuJoCo's."""
    own = model.inertials[name]
    R = make_pose(trimesh.transformations.quaternion_matrix(oracle.body_iquat[number])[:3, :3])
    inertia = R[:3, :3] @ np.diag(oracle.body_inertia[number]) @ R[:3, :3].T
    assert own.mass == pytest.approx(oracle.body_mass[number])
    np.testing.assert_allclose(own.center_L, oracle.body_ipos[number], atol=1e-12)
    np.testing.assert_allclose(own.inertia_L, inertia, atol=1e-9 * inertia.max())
    bodies = [body for body in model.link_geometries if body.link == name]
    points = np.vstack([apply_pose(body.X_LG, body.mesh.vertices) for body in bodies])
    for u in fibonacci_directions(60):
        expected = max(
            _support(oracle, g, u)
            for g in range(oracle.ngeom)
            if oracle.geom_bodyid[g] == number and oracle.geom_contype[g]
        )
        # Facets of round bodies are within a hundredth of their radius.
        assert (points @ u).max() == pytest.approx(expected, abs=3e-4)


def _support(oracle: Any, g: int, u: np.ndarray) -> float:
    """Return the extent of a geom along u in its body's frame, by the closed form of its kind."""
    R = trimesh.transformations.quaternion_matrix(oracle.geom_quat[g])[:3, :3]
    v, size = R.T @ u, oracle.geom_size[g]
    match oracle.geom_type[g]:
        case 2:  # sphere
            reach = size[0]
        case 3:  # capsule
            reach = size[0] + size[1] * abs(v[2])
        case 4:  # ellipsoid
            reach = np.linalg.norm(size * v)
        case 5:  # cylinder
            reach = size[0] * np.hypot(v[0], v[1]) + size[1] * abs(v[2])
        case 6:  # box
            reach = size @ np.abs(v)
        case _:  # mesh
            reach = (oracle.mesh_vert @ v).max()
    return float(oracle.geom_pos[g] @ u + reach)


def test_efforts_limits_and_couplings_are_those_of_the_file(tmp_path: Path, mujoco: Any) -> None:
    path = written(tmp_path)
    robot = parse_description(path)
    model = read(path)
    np.testing.assert_allclose(model.lower[:3], np.radians(-20.0))
    np.testing.assert_allclose(model.upper, [*np.radians([80, 80, 80]), 0.01])
    # By virtual work, a tendon of 4 N that pulls q and -2 q with 0.5 and -1 m exerts 4 * 2.5 N m.
    np.testing.assert_allclose(model.effort_limits, [3.0, 10.0, 4.0, 9.0])
    assert "pulls the joints spread, pulled" in robot.notes[0]
    assert "joint sprung has no actuator, and is fixed at 0.524" in robot.notes[1]


def test_a_hand_fixed_to_the_world_by_several_joints_has_the_world_as_base(
    tmp_path: Path, mujoco: Any
) -> None:
    finger = (
        '<body name="{0}"><joint name="j{0}" type="slide" range="0 1"/><geom size=".01"/></body>'
    )
    text = f"<mujoco><worldbody>{finger.format('a')}{finger.format('b')}</worldbody></mujoco>"
    robot = parse_description(written(tmp_path, text))
    assert [link.name for link in robot.links] == ["world", "a", "b"]
    assert all(joint.limit.effort is None for joint in robot.joints)  # no actuators: all move


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (
            '<joint name="sprung" springref="30"/>',
            '<joint name="sprung" type="ball" range="0 80"/>',
            "must be a hinge or a sl",
        ),
        (
            "</equality>",
            '<connect body1="last" body2="two" anchor="0 0 0"/></equality>',
            "closes a",
        ),
        (".1 .7 0 0 0", ".1 .7 .2 0 0", "must be linear"),
        ('range="-20 80"', 'range="-.35 1.4"', "it is 1.8: in an MJCF, ranges are in degrees"),
        ('class="finger"', 'class="toe"', "MuJoCo cannot read"),
        ('<mesh name="wedge" ', '<mesh name="wedge" file="Wedge.STL" ', "there is .*wedge.stl"),
        ("odd", "<", "not valid XML"),
    ],
)
def test_what_a_tree_of_joints_cannot_have_is_named(
    old: str, new: str, reason: str, tmp_path: Path, mujoco: Any
) -> None:
    (tmp_path / "wedge.stl").write_bytes(b"")
    assert old in HAND
    path = written(tmp_path, HAND.replace(old, new, 1))
    with pytest.raises(LisGraspError, match=reason):
        read(path)


def test_a_fault_of_an_included_file_is_not_said_of_the_other_alone(
    tmp_path: Path, mujoco: Any
) -> None:
    (tmp_path / "part.xml").write_text("<mujoco><worldbody><bodi/></worldbody></mujoco>")
    path = tmp_path / "hand.xml"
    path.write_text('<mujoco><include file="part.xml"/></mujoco>')
    with pytest.raises(LisGraspError, match=r"hand\.xml.*'bodi'"):
        parse_description(path)


def test_without_mujoco_the_message_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(LisGraspError, match=r"lis-grasp\[mujoco\]"):
        read(written(tmp_path))
