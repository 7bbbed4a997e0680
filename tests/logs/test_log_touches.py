"""Contacts from robots' logs: simulated touches of a moving box, in every format."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from touch_recording import HALF, RADIUS, STIFFNESS, Recording, record, write_bag, write_csv

from lis_grasp import Contacts
from lis_grasp.cli.main import main
from lis_grasp.exceptions import (
    InvalidFileError,
    InvalidHandError,
    InvalidInputError,
    LisGraspWarning,
)
from lis_grasp.exploration.touch_detection import (
    TouchDetection,
    contacts_of_touches,
    detect_touches,
)
from lis_grasp.logs.contacts import Finger, LogFrames, contacts_from_log
from lis_grasp.logs.joint_frames import with_link_frames
from lis_grasp.logs.readers import open_log

TOUCH = TouchDetection(threshold=1.0, tip_radius=RADIUS, normals="force")
# Penetration at the threshold, and the advance of the tip in one sample along its oblique path.
TOLERANCE = 1.0 / STIFFNESS + 2.0 * 0.0303 / 119


@pytest.fixture(scope="module")
def recording() -> Recording:
    return record()


def assert_true(
    contacts: Contacts, recording: Recording, *, normal: float = 0.02, position: float = 0.0
) -> None:
    assert len(contacts) == len(recording.points)
    errors = np.linalg.norm(contacts.points - recording.points, axis=1)
    assert errors.max() < TOLERANCE + position
    cosines = np.sum(contacts.normals * recording.normals, axis=1)
    assert np.arccos(np.clip(cosines, -1.0, 1.0)).max() < normal
    assert contacts.times is not None
    assert np.all(np.diff(contacts.times) > 0.0)
    assert contacts.forces is not None
    assert np.all(contacts.forces >= 1.0)
    # Free balls are outside of the box.
    gaps = np.linalg.norm(contacts.free_points - np.clip(contacts.free_points, -HALF, HALF), axis=1)
    assert len(gaps) > 20
    assert np.all(gaps > contacts.free_radii)


@pytest.mark.parametrize(
    "kind",
    ["ros1", "sqlite3", "mcap", "csv"]
    + [pytest.param(kind, marks=pytest.mark.slow) for kind in ("file.mcap", "file.db3")],
)
def test_contacts_of_every_format_are_the_true_ones(
    kind: str, recording: Recording, tmp_path: Path
) -> None:
    if kind == "csv":
        path = write_csv(recording, tmp_path / "log.csv")
        topics = Finger(), LogFrames(object_pose="object")
    else:
        pytest.importorskip("rosbags")
        storage = {"file.mcap": "mcap", "file.db3": "sqlite3"}.get(kind, kind)
        path = write_bag(recording, tmp_path / ("log.bag" if kind == "ros1" else "log"), storage)
        if kind.startswith("file"):
            (path,) = path.glob(f"*{Path(kind).suffix}")
        topics = Finger(), LogFrames(object_pose="/object")
    contacts, touches = contacts_from_log(open_log(path), [topics[0]], topics[1], TOUCH)
    assert_true(contacts, recording)
    assert touches[0].unposed == 0


def test_tip_and_object_may_be_transform_frames(recording: Recording, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    log = open_log(write_bag(recording, tmp_path / "log", "sqlite3", with_tf=True))
    frames = LogFrames(object_pose="object")
    for tip in ("tip", "finger"):  # the finger is fixed to the tip
        contacts, touches = contacts_from_log(log, [Finger(tip=tip)], frames, TOUCH)
        assert_true(contacts, recording)
        assert touches[0].unposed == 0
    assert log.frames().frames == ["finger", "object", "tip", "world"]


def test_a_tree_of_its_own_does_not_hide_the_base(recording: Recording, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    log = open_log(write_bag(recording, tmp_path / "log", "sqlite3", with_tf=True))
    tree = log.frames()
    own = {("mount", "camera"): tree.transforms["world", "tip"]}
    tree = replace(tree, transforms={**tree.transforms, **own})
    log.frames = lambda: tree
    frames = LogFrames(object_pose="object", tip_frame="world")
    contacts, _ = contacts_from_log(log, [Finger(tip="tip")], frames, TOUCH)
    assert_true(contacts, recording)


def test_a_sensor_may_report_the_opposite_force_and_an_offset(
    recording: Recording, tmp_path: Path
) -> None:
    for sign in (1.0, -1.0):
        shifted = replace(recording, forces=sign * recording.forces + [4.0, -3.0, 10.0])
        log = open_log(write_csv(shifted, tmp_path / "log.csv"))
        frames = LogFrames(object_pose="object", tare=0.2)
        contacts, _ = contacts_from_log(log, [Finger()], frames, TOUCH)
        assert_true(contacts, recording)


def test_estimated_normals_are_near_the_true_ones(recording: Recording, tmp_path: Path) -> None:
    log = open_log(write_csv(recording, tmp_path / "log.csv"))
    frames = LogFrames(object_pose="object")
    contacts, _ = contacts_from_log(log, [Finger()], frames, replace(TOUCH, normals="estimate"))
    angles = np.arccos(np.clip(np.sum(contacts.normals * recording.normals, axis=1), -1.0, 1.0))
    assert np.degrees(angles.mean()) < 10.0
    assert contacts.normal_noise is not None
    # At least as uncertain as wrong, on average over the components.
    assert np.sqrt(np.mean(contacts.normal_noise**2)) > 0.5 * np.sqrt(np.mean(angles**2) / 2.0)


def test_normals_may_be_the_approach(recording: Recording, tmp_path: Path) -> None:
    log = open_log(write_csv(recording, tmp_path / "log.csv"))
    frames = LogFrames(object_pose="object")
    contacts, _ = contacts_from_log(log, [Finger()], frames, replace(TOUCH, normals="approach"))
    cosines = np.sum(contacts.normals * recording.normals, axis=1)
    # The path is oblique: tan = 0.4.
    assert cosines == pytest.approx(1.0 / np.hypot(1.0, 0.4), abs=0.01)


def test_a_fixed_object_has_a_given_frame(tmp_path: Path) -> None:
    still = record(moving=False)
    X_WO = np.eye(4)
    X_WO[:3, 3] = still.X_WO[0, :3]
    turn = ["0", "0", repr(float(np.sin(0.15))), repr(float(np.cos(0.15)))]
    path = write_csv(still, tmp_path / "log.csv")
    place = [repr(float(value)) for value in still.X_WO[0, :3]]
    arguments = ["contacts", str(path), "--tip", "tip", "--object-frame", *place, *turn]
    arguments += ["--tip-radius", str(RADIUS), "--normals", "force", "--output", str(tmp_path)]
    assert main(arguments) == 0
    assert_true(Contacts.load(tmp_path / "contacts.ply"), still)


def test_contacts_of_another_name_are_replaced_by_the_next(
    recording: Recording, tmp_path: Path
) -> None:
    log, output = write_csv(recording, tmp_path / "log.csv"), tmp_path / "mine.ply"
    command = ["contacts", str(log), "--tip", "tip", "--object-pose", "object"]
    command += ["--output", str(output), "--tip-radius", str(RADIUS), "--normals"]
    assert main([*command, "force"]) == 0
    before = output.read_bytes()
    assert main([*command, "approach"]) == 0
    assert output.read_bytes() != before


def test_two_fingers_are_merged_in_time_order(recording: Recording, tmp_path: Path) -> None:
    log = open_log(write_csv(recording, tmp_path / "log.csv"))
    fingers = [Finger(tip="tip", name="index"), Finger(tip="tip", name="thumb")]
    frames = LogFrames(object_pose="object")
    contacts, touches = contacts_from_log(log, fingers, frames, TOUCH)
    assert len(contacts) == 2 * len(recording.points)
    assert contacts.fingers[:4] == ("index", "thumb", "index", "thumb")
    assert [each.finger for each in touches] == ["index", "thumb"]


def test_a_sliding_touch_gives_contacts_at_a_spacing() -> None:
    from lis_grasp.exploration.touch_detection import detect_touches

    times = np.arange(200) / 100.0
    tips = np.column_stack([0.1 * times, 0.0 * times, np.where(times < 0.5, 0.01, 0.0)])
    forces = np.where(times < 0.5, 0.0, 3.0)[:, None]
    one = detect_touches(times, forces, tips, TouchDetection())
    assert len(one.times) == 1
    many = detect_touches(times, forces, tips, TouchDetection(spacing=0.02))
    assert np.diff(many.centers[:, 0]) == pytest.approx(0.02, abs=0.0011)
    assert len(many.times) == 8


def test_hysteresis_counts_a_noisy_touch_once() -> None:
    from lis_grasp.exploration.touch_detection import detect_touches

    force = np.array([0, 2, 0.9, 1.1, 0.8, 1.2, 0.4, 0.9, 0.6, 1.3, 0.2, 0.0])
    tips = np.arange(12.0)[:, None] * [1e-3, 0.0, 0.0]
    found = detect_touches(np.arange(12.0), force[:, None], tips, TouchDetection(threshold=1.0))
    assert found.times == pytest.approx([1.0, 9.0])
    begun = detect_touches(np.arange(11.0), force[1:, None], tips[1:], TouchDetection())
    assert begun.times == pytest.approx([8.0])  # the log begins in contact


def test_touches_in_a_gap_of_the_poses_are_counted_and_left_out(
    recording: Recording, tmp_path: Path
) -> None:
    table = write_csv(recording, tmp_path / "log.csv").read_text().splitlines()
    lost = [
        row if not 100 < i < 400 else ",".join([*row.split(",")[:4], *["nan"] * 14])
        for i, row in enumerate(table)
    ]
    (tmp_path / "log.csv").write_text("\n".join(lost))
    frames = LogFrames(object_pose="object")
    contacts, touches = contacts_from_log(open_log(tmp_path / "log.csv"), [Finger()], frames, TOUCH)
    assert len(contacts) == len(recording.points) - touches[0].unposed
    assert touches[0].unposed == 2  # those at about samples 120 and 360


def test_a_row_without_time_and_columns_of_text_are_ignored(
    recording: Recording, tmp_path: Path
) -> None:
    table = write_csv(recording, tmp_path / "log.csv").read_text().splitlines()
    rows = [f"{row},{'phase' if i == 0 else 'probe'}" for i, row in enumerate(table)]
    rows[5] = ",".join(["nan", *rows[5].split(",")[1:]])
    (tmp_path / "log.csv").write_text("\n".join(rows))
    frames = LogFrames(object_pose="object")
    contacts, _ = contacts_from_log(open_log(tmp_path / "log.csv"), [Finger()], frames, TOUCH)
    assert_true(contacts, recording)


def _changed(recording: Recording, path: Path, names: str = "", **factors: float) -> Path:
    """Write a log with other names of its columns, and columns times a factor."""
    head, *rows = write_csv(recording, path).read_text().splitlines()
    scale = np.array([factors.get(name, 1.0) for name in head.split(",")])
    table = np.array([row.split(",") for row in rows], dtype=np.float64) * scale
    lines = [",".join(repr(float(value)) for value in row) for row in table]
    path.write_text("\n".join([names or head, *lines]))
    return path


@pytest.mark.parametrize(
    ("names", "factors"),
    [
        ("time_ms,fx,fy,fz,x,y,z,qx,qy,qz,qw,ox,oy,oz,oqx,oqy,oqz,oqw", {"time": 1e3}),
        ("time [ns],fx,fy,fz,x,y,z,qx,qy,qz,qw,ox,oy,oz,oqx,oqy,oqz,oqw", {"time": 1e9}),
        (
            "timestamp,fx,fy,fz,x [mm],y [mm],z [mm],qx,qy,qz,qw,ox,oy,oz,oqx,oqy,oqz,oqw",
            {"x": 1e3, "y": 1e3, "z": 1e3},
        ),
        (
            "__time,/ft/wrench/force/x,/ft/wrench/force/y,/ft/wrench/force/z,pose.position.x,"
            "pose.position.y,pose.position.z,pose.orientation.x,pose.orientation.y,"
            "pose.orientation.z,pose.orientation.w,ox,oy,oz,oqx,oqy,oqz,oqw",
            {},
        ),
    ],
)
def test_columns_of_a_log_may_state_units_and_have_names_of_bags(
    names: str, factors: dict, recording: Recording, tmp_path: Path
) -> None:
    log = open_log(_changed(recording, tmp_path / "log.csv", names, **factors))
    contacts, _ = contacts_from_log(log, [Finger()], LogFrames(object_pose="object"), TOUCH)
    assert_true(contacts, recording)


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"time": 1e3}, "are 5 apart .*: if they are ms, name the column time_ms"),
        ({"time": 1e6}, "if they are us, name the column time_us"),
        ({"time": 1e9}, "if they are ns, name the column time_ns"),
        ({"x": 1e3, "y": 1e3, "z": 1e3}, "in millimetres, name the columns x_mm"),
    ],
)
def test_mistaken_units_of_a_log_are_noticed(
    factors: dict, said: str, recording: Recording, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match=said):
        log = open_log(_changed(recording, tmp_path / "log.csv", **factors))
        contacts_from_log(log, [Finger()], LogFrames(object_pose="object"), TOUCH)


def test_blank_cells_and_zero_quaternions_are_counted(recording: Recording, tmp_path: Path) -> None:
    head, *rows = write_csv(recording, tmp_path / "log.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    cells[3][4:7] = ["", "", ""]
    cells[9][7:11] = ["0"] * 4
    (tmp_path / "log.csv").write_text("\n".join([head, *map(",".join, cells)]))
    with pytest.warns(LisGraspWarning, match=f"tip: 2 of {len(rows)} poses are left out"):
        contacts, _ = contacts_from_log(
            open_log(tmp_path / "log.csv"), [Finger()], LogFrames(object_pose="object"), TOUCH
        )
    assert_true(contacts, recording)


def test_slow_topics_of_poses_are_named(recording: Recording, tmp_path: Path) -> None:
    head, *rows = write_csv(recording, tmp_path / "log.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    for row in (row for k, row in enumerate(cells) if k % 100):  # a pose every 0.5 s
        row[4:7] = ["", "", ""]
    (tmp_path / "log.csv").write_text("\n".join([head, *map(",".join, cells)]))
    with pytest.raises(InvalidInputError, match="tip has a pose every 0.5 s"):
        contacts_from_log(
            open_log(tmp_path / "log.csv"), [Finger()], LogFrames(object_pose="object"), TOUCH
        )


def test_a_force_in_an_unknown_frame_has_no_direction() -> None:
    force = np.tile([0.0, 0.0, 2.0], (40, 1))
    force[::10] = 0.0  # a touch after each
    tips = np.column_stack([np.zeros((40, 2)), 0.1 - 0.02 * (np.arange(40) % 10)])
    known = np.arange(40) < 20
    found = detect_touches(np.arange(40.0), force, tips, TOUCH, directed=known)
    assert np.linalg.norm(found.directions, axis=1) == pytest.approx([1.0, 1.0, 0.0, 0.0])
    assert found.forces == pytest.approx(4 * [2.0])
    assert contacts_of_touches([found], TOUCH).times == pytest.approx([1.0, 11.0])


@pytest.mark.parametrize(
    ("finger", "frames", "touch", "said"),
    [
        (Finger(force="/nothing"), LogFrames(), TOUCH, r"'/nothing' is not: the log has force"),
        (Finger(), LogFrames(), TOUCH, r"has 2 topics of content 'pose' .* choose one by `tip`"),
        (Finger(tip="elbow"), LogFrames(), TOUCH, "'elbow' is not: the log has the topics object"),
        (
            Finger(),
            LogFrames(object_pose="object"),
            TouchDetection(threshold=1e3),
            "no force rises from below 500 N to 1000 N: lower the threshold",
        ),
    ],
)
def test_what_is_missing_or_ambiguous_is_said(
    finger: Finger,
    frames: LogFrames,
    touch: TouchDetection,
    said: str,
    recording: Recording,
    tmp_path: Path,
) -> None:
    log = open_log(write_csv(recording, tmp_path / "log.csv"))
    with pytest.raises(InvalidInputError, match=said):
        contacts_from_log(log, [finger], frames, touch)


def test_frames_that_nothing_connects_are_said(recording: Recording, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    log = open_log(write_bag(recording, tmp_path / "log.bag", "ros1"))
    frames = LogFrames(object_pose="/object", tip_frame="base")
    with pytest.raises(InvalidInputError, match="'base'"):
        contacts_from_log(log, [Finger()], frames, TOUCH)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("log.csv", "time,x,y,z\n0,1,2,3\n"),
        ("log.bag", "nonsense"),
        ("log.mcap", "nonsense"),
        ("log.txt", "nonsense"),
    ],
)
def test_unreadable_logs_are_refused(name: str, content: str, tmp_path: Path) -> None:
    if name.endswith(("bag", "mcap")):
        pytest.importorskip("rosbags")
    (tmp_path / name).write_text(content)
    with pytest.raises(InvalidFileError) as error:
        open_log(tmp_path / name)
    assert error.value.path == tmp_path / name
    assert main(["contacts", str(tmp_path / name), "--list"]) == 2


def test_the_list_shows_topics_and_frames(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rosbags")
    path = write_bag(recording, tmp_path / "log.bag", "ros1")
    assert main(["contacts", str(path), "--list"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    count = len(recording.times)
    assert ["force", str(count), "/wrench", "(geometry_msgs/WrenchStamped)"] in lines
    assert ["pose", str(count // 2 + 6), "/tip_pose", "(geometry_msgs/PoseStamped)"] in lines
    assert lines[-1] == ["frames:", "none"]


PUSHES = Path(os.environ.get("LIS_GRASP_PUSHES", "no folder"))


@pytest.mark.slow
@pytest.mark.skipif(not PUSHES.is_dir(), reason="LIS_GRASP_PUSHES names no folder of pnpush's bags")
def test_real_pushes_find_the_faces_of_the_block() -> None:
    pytest.importorskip("rosbags")
    touch = TouchDetection(
        threshold=0.6,
        release=0.6,
        tip_radius=0.00475,
        spacing=0.005,
        normals="force",
        force_on="tip",
    )
    frames = LogFrames(object_pose="vicon/SteelBlock/SteelBlock", tare=0.3, smoothing=0.08)
    finger = Finger("/netft_data", "link_probe")
    found = [
        contacts_from_log(open_log(path), [finger], frames, touch)[0]
        for path in sorted(PUSHES.rglob("Test_st_*.bag"))
    ]
    points = np.vstack([contacts.points for contacts in found])
    normals = np.vstack([contacts.normals for contacts in found])
    for axis in (0, 1):
        faces = [points[sign * normals[:, axis] > 0.8, axis] for sign in (1.0, -1.0)]
        offsets = [float(np.median(face)) for face in faces]
        assert 0.08 < offsets[0] - offsets[1] < 0.1
        for face, offset in zip(faces, offsets, strict=True):
            assert len(face) > 8
            assert np.median(np.abs(face - offset)) < 0.002


ROBOT = {  # a Cartesian robot whose last link is the tip
    "along_x": ("prismatic", "1 0 0"),
    "along_y": ("prismatic", "0 1 0"),
    "along_z": ("prismatic", "0 0 1"),
    "yaw": ("revolute", "0 0 1"),
    "pitch": ("revolute", "0 1 0"),
    "roll": ("continuous", "2 0 0"),
}


def robot_of(recording: Recording, folder: Path) -> tuple[Path, dict[str, np.ndarray]]:
    """Write a URDF, and return it with positions of its joints: its tip moves as recorded."""
    links, joints, parent = '<link name="world"/>', "", "world"
    for name, (kind, axis) in ROBOT.items():
        links += f'<link name="after_{name}"/>'
        joints += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="after_{name}"/><axis xyz="{axis}"/>'
            '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        )
        parent = f"after_{name}"
    mimic = f'<mimic joint="yaw" multiplier="-2"/><parent link="{parent}"/><child link="idle"/>'
    joints += f'<joint name="follower" type="continuous"><axis xyz="0 0 1"/>{mimic}</joint>'
    joints += (
        f'<joint name="mount" type="fixed"><parent link="{parent}"/><child link="tip"/>'
        '<origin xyz="0 0 0" rpy="3.141592653589793 0 0"/></joint>'
    )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{links}<link name="idle"/><link name="tip"/>{joints}</robot>')
    t = recording.times - recording.times[0]
    turns = {"yaw": 0.5 + 0.05 * t, "pitch": 0.2 * t, "roll": 0.0 * t}
    return path, dict(zip(ROBOT, recording.X_WT.T[:3], strict=False)) | turns


@pytest.mark.by_default("csv")
@pytest.mark.parametrize("kind", ["csv", "mcap"])
def test_joint_states_and_a_urdf_give_the_pose_of_the_tip(
    kind: str, recording: Recording, tmp_path: Path
) -> None:
    urdf, joints = robot_of(recording, tmp_path)
    if kind == "csv":
        write_csv(recording, tmp_path / "log.csv")
        lines = (tmp_path / "log.csv").read_text().splitlines()
        titles, kept = lines[0].split(","), [0, 1, 2, 3, *range(11, 18)]
        names = [f"/joint_states/{name}/position" for name in joints]
        rows = np.array([line.split(",") for line in lines[1:]])[:, kept]
        table = np.column_stack([rows, *([*map(repr, map(float, q))] for q in joints.values())])
        header = ",".join([*(titles[k] for k in kept), *names])
        (tmp_path / "log.csv").write_text("\n".join([header, *map(",".join, table)]) + "\n")
        log, topics = open_log(tmp_path / "log.csv", posed=False), LogFrames(object_pose="object")
    else:
        pytest.importorskip("rosbags")
        log = open_log(write_bag(recording, tmp_path / "log", kind, joints=joints))
        topics = LogFrames(object_pose="/object")
    log = with_link_frames(log, urdf)
    contacts, _ = contacts_from_log(log, [Finger(tip="tip")], topics, TOUCH)
    assert_true(contacts, recording)
    turned = log.frames().pose("after_roll", "idle", recording.times[:1])[0]  # follows the yaw
    assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(-2.0 * joints["yaw"][0])
    with pytest.raises(InvalidInputError, match="along_x, "):
        with_link_frames(open_log(write_csv(recording, tmp_path / "none.csv")), urdf)
    urdf.write_text(re.sub('<axis xyz="[^"]*"', '<axis xyz="0 0 0"', urdf.read_text()))
    with pytest.raises(InvalidHandError) as error:
        with_link_frames(log, urdf)
    assert error.value.file == urdf.name


def test_links_beyond_a_joint_that_is_not_logged_have_no_pose(
    recording: Recording, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    urdf, joints = robot_of(recording, tmp_path)
    del joints["roll"]
    log = with_link_frames(
        open_log(write_bag(recording, tmp_path / "l", "mcap", joints=joints)), urdf
    )
    assert "after_pitch" in log.frames().frames
    with pytest.raises(InvalidInputError, match="roll"):
        contacts_from_log(log, [Finger(tip="tip")], LogFrames(tip_frame="world"), TOUCH)
