"""Orientations and frames of logs: names of robots' recorders, open names, wrong answers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logs.test_log_doubts import NO_TURN, OBJECT, table_of, turns_of
from logs.test_log_touches import TOUCH, assert_true, robot_of
from scipy.spatial.transform import Rotation
from touch_recording import Recording, record, write_bag, write_csv

from lis_grasp.cli.main import main
from lis_grasp.exceptions import (
    InvalidFileError,
    InvalidInputError,
    InvalidOptionError,
    LisGraspWarning,
)
from lis_grasp.logs import Finger, LogFrames, LogReading, contacts_from_log, open_log
from lis_grasp.logs._doubts import require_places
from lis_grasp.logs.joint_frames import with_link_frames
from lis_grasp.robots.described_joints import reach_of, read_joints


@pytest.fixture(scope="module")
def recording() -> Recording:
    return record()


_ARRAYS = {
    "ur": {"actual_TCP_pose": 6, "actual_TCP_force": 6},
    "franka": {"O_T_EE": 16, "O_F_ext_hat_K": 6},
}


@pytest.mark.parametrize("robot", _ARRAYS)
@pytest.mark.parametrize("mark", ["{}_{}", "/state/{}[{}]"])
def test_arrays_of_ur_and_franka_are_poses_and_forces_in_the_base_frame(
    robot: str, mark: str, recording: Recording, tmp_path: Path
) -> None:
    places, turn = recording.X_WT[:, :3], Rotation.from_quat(recording.X_WT[:, 3:])
    forces = np.pad(turn.apply(recording.forces), ((0, 0), (0, 3)))
    if robot == "ur":
        poses = np.hstack([places, turn.as_rotvec()])
    else:
        matrices = np.tile(np.eye(4), (len(places), 1, 1))
        matrices[:, :3, :3], matrices[:, :3, 3] = turn.as_matrix(), places
        poses = matrices.transpose(0, 2, 1).reshape(-1, 16)
    columns: dict[str, Any] = dict.fromkeys(("fx", "fy", "fz", "x", "y", "z"), None)
    for name, table in zip(_ARRAYS[robot], (poses, forces), strict=True):
        columns |= {mark.format(name, k): column for k, column in enumerate(table.T)}
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **columns)
    contacts, touches = contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)
    assert_true(contacts, recording)
    assert ("force", "force", "in the frame base") in touches[0].streams


@pytest.mark.parametrize(
    ("names", "sequence", "form", "degrees"),
    [
        (("A", "B", "C"), "ZYX", "ZYX", True),  # KUKA
        (("A", "B", "C"), "xyz", "rpy", True),  # Mitsubishi
        (("W", "P", "R"), "xyz", None, True),  # Fanuc
        (("rot_x", "rot_y", "rot_z"), "XYZ", "XYZ", False),
        pytest.param(("alpha", "beta", "gamma"), "ZYX", "ZYX", False, marks=pytest.mark.slow),
        pytest.param(("ori_1", "ori_2", "ori_3"), "xyz", "rpy", False, marks=pytest.mark.slow),
        (("s", "u", "v"), "xyz", "rpy", False),  # nothing but their numbers says it
    ],
)
def test_angles_of_any_names_are_asked_for_and_then_right(
    names: tuple[str, ...],
    sequence: str,
    form: Any,
    degrees: bool,
    recording: Recording,
    tmp_path: Path,
) -> None:
    turn = Rotation.from_quat(recording.X_WT[:, 3:])
    angles = turn.as_euler(sequence, degrees=degrees).T
    columns = dict(zip(names, angles, strict=True))
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **columns)
    with pytest.raises(InvalidFileError) as error:
        contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)
    assert error.value.path == path
    reading = LogReading(orientation=form, angles="deg" if degrees else None)
    log = open_log(path, reading=reading)
    assert {name.lower() for name in names}.isdisjoint(log.unused)
    assert_true(contacts_from_log(log, [Finger()], OBJECT, TOUCH)[0], recording)


@pytest.mark.by_default("9")
@pytest.mark.parametrize("count", [4, 9])
def test_a_quaternion_and_a_matrix_of_unknown_names_are_asked_for(
    count: int, recording: Recording, tmp_path: Path
) -> None:
    turn = Rotation.from_quat(recording.X_WT[:, 3:])
    table = turn.as_quat() if count == 4 else turn.as_matrix().reshape(-1, 9)
    columns: dict[str, Any] = {f"state{k}": column for k, column in enumerate(table.T)}
    columns |= {f"torque_{axis}": recording.forces[:, 0] for axis in "xyz"}  # never asked about
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **columns)
    with pytest.raises(InvalidFileError, match="state0"):
        contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)
    log = open_log(path, reading=LogReading(orientation="xyzw" if count == 4 else "matrix"))
    assert_true(contacts_from_log(log, [Finger()], OBJECT, TOUCH)[0], recording)


def test_two_groups_of_columns_that_may_be_an_orientation_are_refused(
    recording: Recording, tmp_path: Path
) -> None:
    quaternion = recording.X_WT[:, 3:].T
    columns = {f"{name}{k}": quaternion[k] for name in ("state", "other") for k in range(4)}
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **columns)
    with pytest.raises(InvalidFileError, match="state0 to state3 or other0 to other3"):
        contacts_from_log(
            open_log(path, reading=LogReading(orientation="xyzw")), [Finger()], OBJECT, TOUCH
        )


@pytest.mark.parametrize("torques", [("torque_x", "torque_y", "torque_z"), ("tx", "ty", "tz")])
def test_torques_are_no_orientation(
    torques: tuple[str, ...], recording: Recording, tmp_path: Path
) -> None:
    columns: dict[str, Any] = dict(zip(torques, 0.1 * recording.forces.T, strict=True))
    path = table_of(
        recording, tmp_path / "log.csv", **columns, oqx=None, oqy=None, oqz=None, oqw=None
    )
    assert set(torques) <= set(open_log(path).unused)
    open_log(path).poses("object")


@pytest.mark.parametrize(
    ("form", "given", "frame", "advice"),
    [
        ("wxyz", "xyzw", None, "`orientation` wxyz"),
        ("rotvec", "rpy", None, "`orientation` rotvec"),
        ("rotvec", "ignored", None, "`orientation` rotvec"),
        ("wxyz", "wxyz", "base", "`force_frame` tip"),
    ],
)
def test_an_answer_that_contradicts_the_data_is_said_with_a_better_one(
    form: Any, given: Any, frame: Any, advice: str, recording: Recording, tmp_path: Path
) -> None:
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **turns_of(recording, form))
    frames = replace(OBJECT, force_frame=frame)
    log = open_log(path, reading=LogReading(orientation=given))
    with pytest.warns(LisGraspWarning, match=rf"{advice}, .* by \d+ deg \(median\), not \d+ deg"):
        contacts_from_log(log, [Finger()], frames, TOUCH)


def test_a_quaternion_whose_names_contradict_the_data_is_said(
    recording: Recording, tmp_path: Path
) -> None:
    mistaken = dict(
        zip(("qx", "qy", "qz", "qw"), turns_of(recording, "wxyz").values(), strict=True)
    )
    path = table_of(recording, tmp_path / "log.csv", **mistaken)
    with pytest.warns(LisGraspWarning, match="name qx,qy,qz,qw q0,q1,q2,q3 and give"):
        contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)


@pytest.mark.slow
def test_a_wrong_orientation_scatters_the_places_of_an_offset_tip(tmp_path: Path) -> None:
    """Forces in the base frame do not tell orientations from each other; the places do."""
    offset = np.array([0.0, 0.0, 0.12])
    still = record(moving=False, touches=24)
    drawn = np.random.default_rng(0).uniform(-0.6, 0.6, (24, 3))
    turn = Rotation.from_euler("xyz", np.repeat(drawn, len(still.times) // 24, axis=0))
    turn *= Rotation.from_euler("x", np.pi)
    forces = Rotation.from_quat(still.X_WT[:, 3:]).apply(still.forces)
    places = still.X_WT[:, :3] - turn.apply(offset)
    moved = replace(still, forces=forces, X_WT=np.hstack([places, turn.as_quat()]))
    path = table_of(moved, tmp_path / "log.csv", **NO_TURN, **turns_of(moved, "rotvec"))
    frames = LogFrames(object_pose="object", force_frame="base", tip_offset=(0.0, 0.0, 0.12))
    log = open_log(path, reading=LogReading(orientation="rotvec"))
    assert_true(contacts_from_log(log, [Finger()], frames, TOUCH)[0], still)
    log = open_log(path, reading=LogReading(orientation="rpy"))
    with pytest.warns(LisGraspWarning, match=r"`orientation` rotvec, .* by [\d.]+ mm"):
        contacts_from_log(log, [Finger()], frames, TOUCH)


@pytest.mark.by_default("beside")
@pytest.mark.parametrize("kind", ["constant", "ahead", "beside"])
def test_commands_that_are_given_as_joint_states_are_said(
    kind: str, recording: Recording, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    _, joints = robot_of(recording, tmp_path)
    ahead = {name: np.roll(values, -12) for name, values in joints.items()}  # 60 ms
    commands = {
        "ahead": ahead,
        "constant": {name: 0.0 * values + values[0] for name, values in joints.items()},
        "beside": {name: values + 0.05 for name, values in joints.items()},
    }[kind]
    topic = "/joint_commands" if kind == "beside" else "/driver"
    reading = LogReading(joint_states=(topic,), angles="rad")
    urdf, states = robot_of(recording, tmp_path)
    path = write_bag(recording, tmp_path / "bag", "mcap", joints=states, others={topic: commands})
    with pytest.warns(LisGraspWarning, match="`joint_states` /joint_states"):
        with_link_frames(open_log(path, reading=reading), urdf, reading)


def test_joints_of_urs_recorder_are_those_of_its_description(
    recording: Recording, tmp_path: Path
) -> None:
    columns = {f"actual_q_{k}": np.full(len(recording.times), float(k)) for k in range(6)}
    log = open_log(table_of(recording, tmp_path / "log.csv", **columns))
    names = ("left_wrist_2_joint", "left_elbow_joint", "finger_joint")
    found = log.joints(names)
    assert {name: series[0].positions[0] for name, series in found.items()} == {
        "left_wrist_2_joint": 4.0,
        "left_elbow_joint": 2.0,
    }


def test_the_reach_of_a_robot_bounds_the_distance_of_contacts(tmp_path: Path) -> None:
    links = "".join(f'<link name="{name}"/>' for name in "abcd")
    joint = (
        '<joint name="{0}{1}" type="{2}"><parent link="{0}"/><child link="{1}"/><axis xyz="0 1 0"/>'
        '<origin xyz="{3}"/><limit lower="-0.2" upper="0.1" effort="1" velocity="1"/></joint>'
    )
    chain = joint.format("a", "b", "revolute", "0 0.3 0.4")
    chain += joint.format("b", "c", "prismatic", "0 0 0.1") + joint.format(
        "a", "d", "fixed", "0 0 0.6"
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{chain}</robot>')
    joints = read_joints(tmp_path / "arm.urdf")
    assert reach_of(joints) == pytest.approx(0.5 + 0.1 + 0.2)
    (tmp_path / "free.urdf").write_text(
        f'<robot name="arm">{links}{chain.replace("prismatic", "floating")}</robot>'
    )
    assert reach_of(read_joints(tmp_path / "free.urdf")) == np.inf
    with pytest.raises(InvalidInputError, match="0.5 m of each other"):
        require_places(np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0]]), "check", reach=0.25)
    require_places(np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]), "check", reach=0.25)


def test_degrees_that_fit_the_limits_as_radians_are_said(
    recording: Recording, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    urdf, joints = robot_of(recording, tmp_path)
    log = open_log(write_bag(recording, tmp_path / "bag", "mcap", joints=joints))
    with pytest.warns(LisGraspWarning, match="within their limits"):
        with_link_frames(log, urdf, LogReading(angles="deg"))


@pytest.mark.slow
def test_advice_fits_the_log_that_it_is_given_for(recording: Recording, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    far = replace(recording, X_WT=recording.X_WT * ([1e3] * 3 + [1.0] * 4))
    table = open_log(write_csv(far, tmp_path / "log.csv"))
    bag = open_log(write_bag(far, tmp_path / "bag", "mcap"))
    for log, tip, has_columns in ((table, "tip", True), (bag, "/tip_pose", False)):
        with pytest.raises(InvalidInputError) as error:
            contacts_from_log(log, [Finger(tip=tip)], LogFrames(), TOUCH)
        assert ("x_mm" in str(error.value)) == has_columns
    # A column that states its unit is in no other one.
    slow = recording.times[0] + 60.0 * (recording.times - recording.times[0])
    for name, proposed in (("time", True), ("time_s", False)):
        with pytest.raises(InvalidFileError) as refused:
            open_log(table_of(recording, tmp_path / "slow.csv", **{"time": None, name: slow}))
        assert ("time_ms" in str(refused.value)) == proposed
    # A joint in two columns, and a log without poses: neither has topics to choose from.
    urdf, joints = robot_of(recording, tmp_path)
    columns = {name: values for name, values in joints.items() if name != "along_x"}
    columns |= {f"{side}/along_x": joints["along_x"] for side in "ab"}
    path = table_of(recording, tmp_path / "two.csv", **columns)
    log = with_link_frames(open_log(path), urdf)
    with pytest.raises(InvalidInputError, match="keep one column"):
        contacts_from_log(log, [Finger(tip="after_along_x")], LogFrames(), TOUCH)
    lonely = open_log(write_bag(recording, tmp_path / "joints", "mcap", joints=joints))
    with pytest.raises(InvalidInputError, match="`urdf`"):
        contacts_from_log(lonely, [Finger()], LogFrames(object_pose="/object"), TOUCH)


def test_stamps_that_repeat_by_both_clocks_are_not_sent_to_the_other(
    recording: Recording, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    whole = replace(recording, times=np.floor(recording.times))
    path = write_bag(whole, tmp_path / "bag", "mcap")
    with pytest.raises(InvalidInputError) as error:
        contacts_from_log(open_log(path), [Finger()], LogFrames(object_pose="/object"), TOUCH)
    assert "`clock`" not in str(error.value)


@pytest.mark.parametrize(
    ("kind", "reading", "option"),
    [
        ("csv", LogReading(clock="recording"), "clock"),
        ("csv", LogReading(joint_states=("/joint_states",)), "joint_states"),
        ("bag", LogReading(orientation="wxyz"), "orientation"),
    ],
)
def test_an_option_that_a_log_has_no_use_for_is_refused(
    kind: str, reading: LogReading, option: str, tmp_path: Path
) -> None:
    path = tmp_path / f"log.{kind}"
    path.touch()
    with pytest.raises(InvalidOptionError) as error:
        open_log(path, reading=reading)
    assert (error.value.option, error.value.value) == (option, getattr(reading, option))


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("log.npz", "--tare 1"),
        ("log.npz", "--urdf r.urdf"),
        ("log.npz", "--list"),
        ("log.csv", "--indentation 0.001"),
        ("log.csv", "--xacro-args a:=b"),
        ("log.csv", "--joint-states /joint_states"),
    ],
)
def test_an_option_of_another_kind_of_file_is_refused(
    name: str, given: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).touch()
    assert main(["contacts", str(tmp_path / name), *given.split()]) == 2
    assert given.split()[0] in capsys.readouterr().err
