"""Logs that contradict themselves, or leave a question open: asked, said, or read right."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logs.test_log_touches import TOUCH, assert_true, robot_of
from scipy.spatial.transform import Rotation
from touch_recording import Recording, record, write_bag, write_csv

from lis_grasp.cli.main import build_parser, main
from lis_grasp.exceptions import (
    InvalidFileError,
    InvalidInputError,
    InvalidOptionError,
    LisGraspWarning,
)
from lis_grasp.io import provenance
from lis_grasp.io.csv_tables import ANGLES, NEWTONS, SECONDS
from lis_grasp.io.option import options_of
from lis_grasp.io.units import UNITS
from lis_grasp.logs import (
    Finger,
    LogFrames,
    LogReading,
    PatchDetection,
    TactilePatches,
    TouchDetection,
    _column_names,
    contacts_from_log,
    contacts_from_patches,
    open_log,
)
from lis_grasp.logs._bag_log import CONTENT
from lis_grasp.logs.joint_frames import with_link_frames

OBJECT = LogFrames(object_pose="object")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return record()


def table_of(recording: Recording, path: Path, **columns: Any) -> Path:
    """Write the columns of a recording, without those that are None, and with new ones."""
    head, *rows = write_csv(recording, path).read_text().splitlines()
    values = np.array([row.split(",") for row in rows], dtype=np.float64).T
    table = dict(zip(head.split(","), values, strict=True)) | columns
    table = {name: column for name, column in table.items() if column is not None}
    lines = [
        ",".join(repr(float(value)) for value in row) for row in zip(*table.values(), strict=True)
    ]
    path.write_text("\n".join([",".join(table), *lines]))
    return path


NO_TURN = dict.fromkeys(("qx", "qy", "qz", "qw"))


def turns_of(recording: Recording, form: str) -> dict[str, Any]:
    turn = Rotation.from_quat(recording.X_WT[:, 3:])
    if form == "rotvec":
        return {f"r{a}": c for a, c in zip("xyz", turn.as_rotvec().T, strict=True)}
    if form == "rpy":
        return dict(zip(("roll", "pitch", "yaw"), turn.as_euler("xyz").T, strict=True))
    q = turn.as_quat().T
    return {f"q{k}": q[(k - 1) % 4] for k in range(4)}


@pytest.mark.by_default("wxyz")
@pytest.mark.parametrize("form", ["rotvec", "wxyz"])
def test_an_orientation_that_names_do_not_say_is_asked_for_and_then_right(
    form: Any, recording: Recording, tmp_path: Path
) -> None:
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **turns_of(recording, form))
    with pytest.raises(InvalidFileError) as error:
        contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)
    assert error.value.path == path
    log = open_log(path, reading=LogReading(orientation=form))
    assert_true(contacts_from_log(log, [Finger()], OBJECT, TOUCH)[0], recording)


def test_roll_pitch_and_yaw_are_an_orientation_in_radians_or_stated_degrees(
    recording: Recording, tmp_path: Path
) -> None:
    angles = turns_of(recording, "rpy")
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **angles)
    assert_true(contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)[0], recording)
    degrees = {f"{name}_deg": np.degrees(column) for name, column in angles.items()}
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **degrees)
    assert_true(contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)[0], recording)
    unstated = {name: np.degrees(column) for name, column in angles.items()}
    path = table_of(recording, tmp_path / "log.csv", **NO_TURN, **unstated)
    with pytest.raises(InvalidFileError):
        contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)


@pytest.mark.parametrize("lost", ["qw", "oz"])
def test_half_of_an_orientation_or_of_a_place_is_refused(
    lost: str, recording: Recording, tmp_path: Path
) -> None:
    path = table_of(recording, tmp_path / "log.csv", **{lost: None})
    with pytest.raises(InvalidFileError):
        contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)


@pytest.mark.parametrize("unit", ["fx [kips]", "x [um]", "time [min]"])
def test_a_unit_that_is_not_known_is_refused(
    unit: str, recording: Recording, tmp_path: Path
) -> None:
    name = unit.partition(" ")[0]
    head, *rows = write_csv(recording, tmp_path / "log.csv").read_text().splitlines()
    names = [unit if each == name else each for each in head.split(",")]
    (tmp_path / "log.csv").write_text("\n".join([",".join(names), *rows]))
    with pytest.raises(InvalidFileError):
        open_log(tmp_path / "log.csv")


def _in_base(recording: Recording) -> Recording:
    turned = Rotation.from_quat(recording.X_WT[:, 3:]).apply(recording.forces)
    return replace(recording, forces=turned)


def test_forces_that_agree_with_the_motions_in_another_frame_are_asked_for(tmp_path: Path) -> None:
    recording = record(touches=12)
    log = open_log(write_csv(_in_base(recording), tmp_path / "log.csv"))
    with pytest.raises(InvalidInputError):
        contacts_from_log(log, [Finger()], OBJECT, TOUCH)
    given = replace(OBJECT, force_frame="base")
    assert_true(contacts_from_log(log, [Finger()], given, TOUCH)[0], recording)
    with pytest.raises(InvalidOptionError) as error:
        contacts_from_log(log, [Finger()], replace(OBJECT, force_frame="elbow"), TOUCH)
    assert (error.value.option, error.value.value) == ("force_frame", "elbow")


def test_forces_across_the_motions_are_said(tmp_path: Path) -> None:
    still = record(moving=False)
    rng = np.random.default_rng(0)
    size = np.linalg.norm(still.forces, axis=1)[:, None]
    drawn = rng.normal(size=still.forces.shape)
    forces = size * drawn / np.linalg.norm(drawn, axis=1)[:, None]
    log = open_log(write_csv(replace(still, forces=forces), tmp_path / "log.csv"))
    with pytest.warns(LisGraspWarning, match="contradict"):
        contacts_from_log(log, [Finger()], OBJECT, TOUCH)


def test_a_moving_object_that_is_taken_as_fixed_is_said(
    recording: Recording, tmp_path: Path
) -> None:
    log = open_log(write_csv(recording, tmp_path / "log.csv"))
    with pytest.warns(LisGraspWarning, match="object"):
        contacts_from_log(log, [Finger(tip="tip")], LogFrames(), TOUCH)


@pytest.mark.parametrize("step", [0.02, 0.1, 0.2])
def test_rows_that_repeat_a_time_are_taken_in_order(
    step: float, recording: Recording, tmp_path: Path
) -> None:
    coarse = np.floor((recording.times - recording.times[0]) / step + 1e-6) * step
    path = table_of(recording, tmp_path / "log.csv", time=coarse)
    with pytest.warns(LisGraspWarning, match="repeat a time"):
        log = open_log(path)
    assert_true(contacts_from_log(log, [Finger()], OBJECT, TOUCH)[0], recording)


@pytest.mark.parametrize("time", [1.7e9, "whole seconds"])
def test_one_time_for_all_rows_and_whole_seconds_are_refused(
    time: Any, recording: Recording, tmp_path: Path
) -> None:
    whole = np.floor(recording.times) if time == "whole seconds" else 0.0 * recording.times + time
    with pytest.raises(InvalidFileError) as error:
        open_log(table_of(recording, tmp_path / "log.csv", time=whole))
    assert "column time_" not in str(error.value)  # no unit makes them fine


def test_seconds_and_nanoseconds_in_two_columns_and_rostopic_names_are_times(
    recording: Recording, tmp_path: Path
) -> None:
    nanoseconds = np.round(recording.times * 1e9)
    whole = np.floor(recording.times)
    two = {"header.stamp.secs": whole, "header.stamp.nsecs": (recording.times - whole) * 1e9}
    for columns in (two, {"%time": nanoseconds}):
        path = table_of(recording, tmp_path / "log.csv", time=None, **columns)
        assert_true(contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)[0], recording)


def test_two_recordings_in_one_table_are_refused(recording: Recording, tmp_path: Path) -> None:
    path = write_csv(recording, tmp_path / "log.csv")
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *rows, *rows[1:]]))
    shifted = replace(recording, X_WT=recording.X_WT + [0.3, 0, 0, 0, 0, 0, 0])
    other = write_csv(shifted, tmp_path / "other.csv").read_text().splitlines()[1:]
    path.write_text("\n".join([head, *rows, *other]))
    with pytest.raises(InvalidFileError):
        open_log(path)
    path.write_text("\n".join([head, *rows[::-1]]))  # from the last row to the first
    assert_true(contacts_from_log(open_log(path), [Finger()], OBJECT, TOUCH)[0], recording)


def test_poses_that_do_not_change_are_refused(recording: Recording, tmp_path: Path) -> None:
    frozen = replace(
        recording,
        X_WT=np.repeat(recording.X_WT[:1], len(recording.times), axis=0),
        X_WO=np.repeat(recording.X_WO[:1], len(recording.times), axis=0),
    )
    log = open_log(write_csv(frozen, tmp_path / "log.csv"))
    with pytest.raises(InvalidInputError):
        contacts_from_log(log, [Finger()], OBJECT, TOUCH)


def test_what_is_used_and_what_is_not_is_printed_and_in_the_header(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table_of(recording, tmp_path / "log.csv", torque_x=recording.times, note=recording.times)
    command = ["contacts", str(path), "--object-pose", "object", "--tip-radius", "0.006"]
    assert main([*command, "--normals", "force"]) == 0
    assert "not used: torque_x, note" in capsys.readouterr().out
    head = (tmp_path / "contacts.ply").read_bytes()[:4000].decode("latin-1")
    (line,) = (text for text in head.splitlines() if provenance._MARK in text)
    header = json.loads(line[line.index("{") :])
    assert header["unused"] == ["torque_x", "note"]
    assert [text.split()[0] for text in header["used"]] == ["force", "tip", "object"]


def test_every_declared_option_of_logs_and_patches_is_one_of_the_verb() -> None:
    parsed = vars(build_parser("contacts").parse_args(["contacts", "log.csv"]))
    names = {"threshold": "force_threshold"}
    for config in (LogReading, LogFrames, TouchDetection):
        assert {names.get(name, name) for name in options_of(config)} <= set(parsed)
    assert set(options_of(PatchDetection)) - {"threshold"} <= set(parsed)
    assert "indentation" in parsed
    defaults = dict.fromkeys(options_of(LogFrames))
    assert {name: parsed[name] for name in defaults} == defaults


def _with_joints(
    recording: Recording, folder: Path, reading: LogReading = LogReading(), **bag: Any
) -> Any:
    """Return the contacts of joint states, of which some are other publishers'."""
    urdf, joints = robot_of(recording, folder)
    joints |= bag.pop("joints", {})
    joints = {name: values for name, values in joints.items() if values is not None}
    path = write_bag(recording, folder / "bag", "mcap", joints=joints, **bag)
    log = with_link_frames(open_log(path, reading=reading), urdf, reading)
    frames = LogFrames(object_pose="/object")
    return contacts_from_log(log, [Finger(tip="tip")], frames, TOUCH)[0]


@pytest.mark.slow
def test_joints_of_two_publishers_on_one_topic_are_one_robot(
    recording: Recording, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    _, joints = robot_of(recording, tmp_path)
    roll = {"roll": joints["roll"]}
    for topic in ("/joint_states", "/gripper/joint_states"):
        folder = tmp_path / topic.replace("/", "_")
        folder.mkdir()
        bag: dict[str, Any] = {"joints": {"roll": None}, "others": {topic: roll}}
        assert_true(_with_joints(recording, folder, **bag), recording, position=3e-4)


@pytest.mark.slow
def test_commands_beside_states_are_asked_for(recording: Recording, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    _, joints = robot_of(recording, tmp_path)
    others = {"/joint_commands": {name: values + 0.05 for name, values in joints.items()}}
    for reading in (LogReading(), LogReading(joint_states=("/joint_states",))):
        folder = tmp_path / str(reading.joint_states is None)
        folder.mkdir()
        if reading.joint_states is None:
            with pytest.raises(InvalidInputError, match="joint_states"):
                _with_joints(recording, folder, reading, others=others)
        else:
            assert_true(_with_joints(recording, folder, reading, others=others), recording)


@pytest.mark.slow
def test_a_publisher_of_zeros_is_left_out_and_two_that_differ_are_refused(
    recording: Recording, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    _, joints = robot_of(recording, tmp_path)
    still = {"/joint_states": {"pitch": 0.0 * joints["pitch"]}}
    (tmp_path / "still").mkdir()
    with pytest.warns(LisGraspWarning, match="pitch"):
        contacts = _with_joints(recording, tmp_path / "still", others=still)
    assert_true(contacts, recording)
    moving = {"/joint_states": {"pitch": 0.3 + joints["pitch"]}}
    (tmp_path / "moving").mkdir()
    with pytest.raises(InvalidInputError, match="pitch"):
        _with_joints(recording, tmp_path / "moving", others=moving)


@pytest.mark.parametrize(
    ("kept", "said"),
    [([0], r"roll .* -0\.2: .* not at 0"), ([0, -1], "the frame after_roll has a pose every")],
)
def test_a_joint_of_few_states_is_named_with_its_position_or_its_gaps(
    kept: list[int],
    said: str,
    recording: Recording,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("rosbags")
    urdf, joints = robot_of(recording, tmp_path)
    joints["roll"] = joints["roll"] - 0.2
    log = open_log(write_bag(recording, tmp_path / "bag", "mcap", joints=joints))
    logged = log.joints(tuple(joints))
    roll = logged["roll"][0]
    logged["roll"] = [replace(roll, times=roll.times[kept], positions=roll.positions[kept])]
    monkeypatch.setattr(log, "joints", lambda names: logged)
    frames = LogFrames(object_pose="/object")
    with pytest.raises(InvalidInputError, match=said):
        contacts_from_log(with_link_frames(log, urdf), [Finger(tip="tip")], frames, TOUCH)


@pytest.mark.slow
def test_joints_in_degrees_are_beyond_their_limits(recording: Recording, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    _, joints = robot_of(recording, tmp_path)
    turned = {name: np.degrees(joints[name]) for name in ("yaw", "pitch", "roll")}
    (tmp_path / "asked").mkdir()
    with pytest.raises(InvalidInputError, match="angles"):
        _with_joints(recording, tmp_path / "asked", joints=turned)
    (tmp_path / "given").mkdir()
    contacts = _with_joints(recording, tmp_path / "given", LogReading(angles="deg"), joints=turned)
    assert_true(contacts, recording)


@pytest.mark.by_default("False")
@pytest.mark.parametrize("with_tf", [False, True])
def test_stamps_of_a_bag_that_repeat_are_asked_for(
    with_tf: bool, recording: Recording, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    path = write_bag(recording, tmp_path / "bag", "mcap", with_tf=with_tf, resolution=1.0)
    names = ("tip", "object") if with_tf else (None, "/object")
    frames = LogFrames(object_pose=names[1])
    with pytest.raises(InvalidInputError, match="clock"):
        contacts_from_log(open_log(path), [Finger(tip=names[0])], frames, TOUCH)
    log = open_log(path, reading=LogReading(clock="recording"))
    assert_true(contacts_from_log(log, [Finger(tip=names[0])], frames, TOUCH)[0], recording)


def test_depths_in_pixels_are_refused_whatever_they_are_scaled_by() -> None:
    y, x = np.mgrid[:120, :160] - np.array([59.5, 79.5])[:, None, None]  # [pixels]
    ball = np.maximum(np.sqrt(np.maximum(300.0**2 - x**2 - y**2, 0.0)) - 290.0, 0.0)
    pitch = 6e-5
    with pytest.raises(InvalidOptionError):
        TactilePatches(ball, np.eye(4), pitch)
    right = contacts_from_patches(TactilePatches(pitch * ball, np.eye(4), pitch))
    assert len(right)
    with pytest.raises(InvalidInputError):  # as millimetres: 1 mm a pixel in place of 0.06
        contacts_from_patches(TactilePatches(1e-2 * 0.1 * 10.0 * ball / 8.0, np.eye(4), pitch))


def test_sensor_poses_in_millimetres_are_refused() -> None:
    y, x = 6e-5 * (np.mgrid[:120, :160] - np.array([59.5, 79.5])[:, None, None])
    depth = np.maximum(np.sqrt(0.03**2 - x**2 - y**2) - 0.0292, 0.0)
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 50.0
    with pytest.raises(InvalidInputError):
        contacts_from_patches(TactilePatches(np.stack([depth, depth]), poses, 6e-5))


def test_the_page_lists_the_columns_units_and_messages_that_are_understood() -> None:
    page = Path(__file__).parents[2] / "docs" / "how-to" / "robot-logs.md"
    lines = [line.split("|")[1:-1] for line in page.read_text("utf-8").splitlines()]
    tables = [row for row in lines if len(row) > 1]
    listed = [
        (row[0].strip(), [set(re.findall(r"`([^`]+)`", c)) for c in row[1:]]) for row in tables
    ]
    listed = [
        (name, [{each.lower() for each in cell} if name == "arrays" else cell for cell in cells])
        for name, cells in listed
    ]
    turns = {False: set[str](), True: set[str]()}
    for names, forms in _column_names.TURNS.items():
        inner = forms[0] in ("rotvec", "matrix") and len(forms) == 1  # of words and arrays
        turns[len(forms) > 1] |= {*(() if inner else names), *(forms if len(forms) > 1 else ())}
    kinds = {word for words in _column_names.KINDS.values() for word in words}
    arrays = {*_column_names.ARRAYS, *_column_names.JOINT_ARRAYS}
    roles = {"force": "force", "pose": "pose", "joints": "joints", "frames": "transforms"}
    expected = [
        ("time", [{*_column_names.TIME, "secs", "nsecs"}, set(SECONDS)]),
        ("force", [set(chain.from_iterable(_column_names.FORCES)), set(NEWTONS)]),
        ("place", [set(_column_names.POINT), set(UNITS)]),
        ("orientation", [turns[False], set(ANGLES)]),
        ("orientation, by `--orientation`", [turns[True], set(ANGLES)]),
        ("arrays", [arrays, set()]),
        ("words for a quantity", [kinds, set()]),
        ("words for the tip", [set(_column_names.BODIES["tip"]), set()]),
        ("words for the object", [set(_column_names.BODIES["object"]), set()]),
        *(
            (role, [{kind.rpartition("/")[2] for kind, of in CONTENT.items() if of == content}])
            for role, content in roles.items()
        ),
    ]
    for row in expected:
        assert row in listed, row[0]
