"""`lis-grasp contacts`: contacts from a robot's log of forces and poses, or tactile patches."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.cli.options import add_declared, add_xacro_args, xacro_args
from lis_grasp.cli.progress import PRINTED, Stage, next_step, say
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidInputError, InvalidOptionError
from lis_grasp.exploration.touch_detection import TOUCHES, TouchDetection
from lis_grasp.geometry import make_pose
from lis_grasp.io import provenance
from lis_grasp.io.option import options_of
from lis_grasp.logs import Finger, LogFrames, contacts_from_log, open_log
from lis_grasp.logs.contacts import account_of
from lis_grasp.logs.joint_frames import with_link_frames
from lis_grasp.logs.patches import PatchDetection, TactilePatches, contacts_from_patches
from lis_grasp.logs.reading import PATCHES, TOPICS, LogReading
from lis_grasp.results.folder import result_file
from lis_grasp.robots.model_uri import resolve_uri
from lis_grasp.typing import FloatArray

# The options, each with the record that declares it; "spacing" belongs to touches and patches.
_FIELDS = tuple(
    (config, name)
    for config in (LogReading, LogFrames, TouchDetection, PatchDetection)
    for name in options_of(config)
    if (config, name) not in ((PatchDetection, "spacing"), (LogFrames, "object_frame"))
)
_OF_LOGS = ("force", "tip", "finger", "urdf", "xacro_args", "list")
_FLAGS = {
    (TouchDetection, "threshold"): "force-threshold",
    (PatchDetection, "threshold"): "indentation",
}
_PATCH_SPACING = (
    f"{options_of(PatchDetection)['spacing'].help} (default: {PatchDetection().spacing:g})"
)

_Config = TypeVar("_Config")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument(
        "log",
        type=Path,
        metavar="LOG",
        help=".bag (ROS 1), .mcap, .db3 or a folder (ROS 2), or a .csv with columns time, fx,fy,fz"
        " or force, x,y,z of the tip, and optionally qx,qy,qz,qw, ox,oy,oz, oqx,oqy,oqz,oqw; or"
        " .npz with heights, poses and pitch of tactile patches",
    )
    parser.add_argument("--list", action="store_true", help="list the topics and frames of LOG")
    groups = {title: parser.add_argument_group(title) for title in (TOPICS, TOUCHES, PATCHES)}
    for name, text in (
        ("force", "wrench or force of the fingertip (default: the only one)"),
        ("tip", "topic or transform frame of the tip's pose (default: the only topic of poses)"),
        ("finger", "name of the finger"),
    ):
        groups[TOPICS].add_argument(f"--{name}", action="append", metavar="NAME", help=text)
    groups[TOPICS].add_argument(
        "--urdf",
        metavar="FILE",
        help="URDF, SDF or MJCF of the robot: its links are frames, by the log's joint states",
    )
    add_xacro_args(groups[TOPICS])
    fixed = options_of(LogFrames)["object_frame"]
    groups[TOPICS].add_argument(
        "--object-frame",
        type=float,
        nargs="+",
        metavar=fixed.metavar,
        help=f"{fixed.help} (default: {fixed.words})",
    )
    for config, name in _FIELDS:
        group, flag = groups[options_of(config)[name].group], _FLAGS.get((config, name), "")
        also = f"; of tactile patches, {_PATCH_SPACING}" if name == "spacing" else ""
        add_declared(group, config, name, flag=flag, also=also)
    parser.add_argument(
        "--output",
        type=Path,
        metavar="PATH",
        help="a .ply or .csv file, or the folder for contacts.ply (default: beside LOG)",
    )
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """List the topics, or detect the touches and write the contacts."""
    if options.log.suffix.lower() == ".npz":
        _write(options, _of_patches(options))
        return
    _refuse(options, (PatchDetection,), "tactile patches")
    for name in ("xacro_args", "joint_states") if options.urdf is None else ():
        if value := getattr(options, name):
            message = f"--{name.replace('_', '-')} needs a description: give --urdf"
            raise InvalidOptionError(message, option=name, value=value)
    frames = _given(options, LogFrames, object_frame=_pose(options.object_frame))
    detection = _given(options, TouchDetection)
    reading = _given(options, LogReading)
    fingers = [
        Finger(force, tip, name or "")
        for force, tip, name in zip_longest(
            options.force or [None], options.tip or [], options.finger or []
        )
    ]
    with Stage(f"Reading {options.log}") as stage:
        log = open_log(options.log, posed=options.urdf is None, reading=reading)
        if options.urdf is not None:
            path = resolve_uri(options.urdf, Path(), "--urdf")
            log = with_link_frames(log, path, reading, xacro_args=xacro_args(options))
        stage.result = f"{len(log.topics)} topics"
    if options.list:
        for topic in log.topics:
            say(f"{topic.content:10s} {topic.messages:7d}  {topic.name}  ({topic.type})")
        say(f"frames: {', '.join(log.frames().frames) or 'none'}")
        return
    with Stage("Detecting touches") as stage:
        contacts, touches = contacts_from_log(log, fingers, frames, detection)
        lost = sum(t.unposed for t in touches)
        stage.result = f"{len(contacts)} contacts" + (f", {lost} without a pose" if lost else "")
    account = account_of(log, [stream for touch in touches for stream in touch.streams])
    say(str(account))
    _write(options, contacts, used=account.used, unused=account.unused)


def _of_patches(options: argparse.Namespace) -> Contacts:
    _refuse(options, (LogReading, LogFrames, TouchDetection), "robots' logs", *_OF_LOGS)
    detection = _given(options, PatchDetection)
    with Stage(f"Reading {options.log}") as stage:
        patches = TactilePatches.load(options.log)
        count, rows, columns = patches.heights.shape
        stage.result = f"{count} patches of {rows} x {columns} pixels"
    with Stage("Finding contacts") as stage:
        contacts = contacts_from_patches(patches, detection)
        stage.result = f"{len(contacts)} contacts"
    if not len(contacts):
        raise InvalidInputError("no patch is pressed in far enough: give a lower --indentation")
    X_FO = _pose(options.object_frame)
    return contacts if X_FO is None else contacts.in_frame(X_FO)


def _refuse(
    options: argparse.Namespace, configs: tuple[type, ...], users: str, *others: str
) -> None:
    """Raise `InvalidOptionError` for an option that the kind of file does not use."""
    names = [_FLAGS.get(field, field[1]) for field in _FIELDS if field[0] in configs]
    for name in (*names, *others):
        value = getattr(options, name.replace("-", "_"))
        if value not in (None, (), False) and name != "spacing":
            flag = f"--{name.replace('_', '-')}"
            message = f"{flag} is for {users}; {options.log} is none: leave it out"
            raise InvalidOptionError(message, option=name, value=value)


def _given(options: argparse.Namespace, config: Callable[..., _Config], **values: Any) -> _Config:
    """Return a record of the given options."""
    for name in options_of(config):
        flag = _FLAGS.get((cast("type", config), name), name).replace("-", "_")
        if (value := getattr(options, flag)) is not None:
            values.setdefault(name, value)
    return config(**values)


def _write(options: argparse.Namespace, contacts: Contacts, **account: Any) -> None:
    path = _output(options)
    header = provenance.describe(source=options.log.name, **account)
    if path.suffix.lower() == ".ply":
        with result_file(path, PRINTED) as temporary:
            contacts.save(temporary, header=header)
    else:
        contacts.save(path, header=header)
    say(f"wrote {path}")
    say(next_step("lis-grasp estimate {}", path))


def _output(options: argparse.Namespace) -> Path:
    output = options.output or options.log.parent
    path = output if output.suffix.lower() in (".ply", ".csv") else output / "contacts.ply"
    if path.exists() and path.samefile(options.log):
        raise InvalidOptionError(
            f"--output must be another file than the log; it is {path}: name a folder",
            option="--output",
            value=str(path),
        )
    return path


def _pose(numbers: list[float] | None) -> FloatArray | None:
    """Return the pose of X Y Z [QX QY QZ QW], (4, 4)."""
    if numbers is None:
        return None
    if len(numbers) not in (3, 7) or (len(numbers) == 7 and not np.any(numbers[3:])):
        raise InvalidOptionError.out_of_range(
            "object-frame", numbers, "X Y Z, or X Y Z QX QY QZ QW with a quaternion that is not 0"
        )
    quaternion = numbers[3:] if len(numbers) == 7 else [0.0, 0.0, 0.0, 1.0]
    return make_pose(Rotation.from_quat(quaternion).as_matrix(), numbers[:3])
