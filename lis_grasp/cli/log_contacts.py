"""`lis-grasp contacts`: contacts from a robot's log of forces and poses, or tactile patches."""

from __future__ import annotations

import argparse
from itertools import zip_longest
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.cli.progress import PRINTED, Stage, say
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidInputError, InvalidOptionError
from lis_grasp.geometry import make_pose
from lis_grasp.io import provenance
from lis_grasp.logs.contacts import Finger, LogFrames, contacts_from_log
from lis_grasp.logs.detection import FORCES_ON, NORMAL_SOURCES, TouchDetection
from lis_grasp.logs.patches import PatchDetection, TactilePatches, contacts_from_patches
from lis_grasp.logs.readers import open_log
from lis_grasp.results.folder import result_file
from lis_grasp.robots.joint_frames import with_link_frames
from lis_grasp.robots.model_uri import resolve_uri
from lis_grasp.typing import FloatArray

_DEFAULTS, _PATCHES = TouchDetection(), PatchDetection()


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
    choices = parser.add_argument_group("topics; repeat the first three for several fingers")
    for name, text in (
        ("force", "wrench or force of the fingertip (default: the only one)"),
        ("tip", "topic or transform frame of the tip's pose (default: the only topic of poses)"),
        ("finger", "name of the finger"),
    ):
        choices.add_argument(f"--{name}", action="append", metavar="NAME", help=text)
    choices.add_argument(
        "--urdf",
        metavar="FILE",
        help="URDF, SDF or MJCF of the robot: its links are frames, by the log's joint states",
    )
    choices.add_argument(
        "--object-pose",
        metavar="NAME",
        help="topic or transform frame of the object's pose (default: it is fixed)",
    )
    choices.add_argument(
        "--object-frame",
        type=float,
        nargs="+",
        metavar="NUMBER",
        help="fixed pose of the object, X Y Z [QX QY QZ QW], in the frame of the tip's poses"
        " (default: that frame is the object's)",
    )
    choices.add_argument(
        "--tip-frame", default="", metavar="FRAME", help="frame of the tip's poses, if not in LOG"
    )
    touch = parser.add_argument_group("touches")
    for name, metavar, default, text in (
        ("tip-radius", "METRES", 0.0, "radius of the spherical tip"),
        ("force-threshold", "NEWTONS", _DEFAULTS.threshold, "force at which a touch begins"),
        ("release", "FRACTION", _DEFAULTS.release, "fraction of the threshold at which it ends"),
        ("tare", "SECONDS", 0.0, "subtract the mean force of the first seconds"),
        ("smoothing", "SECONDS", 0.0, "length of a moving mean of the forces"),
    ):
        touch.add_argument(
            f"--{name}",
            type=float,
            default=default,
            metavar=metavar,
            help=f"{text} (default: {default:g})",
        )
    touch.add_argument(
        "--tip-offset",
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X", "Y", "Z"),
        help="centre of the tip in the frame of its pose [m] (default: 0 0 0)",
    )
    touch.add_argument(
        "--spacing",
        type=float,
        metavar="METRES",
        help="another contact whenever a touch has slid so far (default: one for each touch); of"
        f" tactile patches, distance of contacts (default: {_PATCHES.spacing:g})",
    )
    touch.add_argument(
        "--normals",
        choices=NORMAL_SOURCES,
        default=_DEFAULTS.normals,
        help="estimated from all contacts with force or approach as evidence, or one of these alone"
        f" (default: {_DEFAULTS.normals})",
    )
    touch.add_argument(
        "--force-on",
        choices=FORCES_ON,
        help="on what the reported force acts (default: what agrees with the approach)",
    )
    patches = parser.add_argument_group("tactile patches (.npz)")
    patches.add_argument(
        "--indentation",
        type=float,
        default=_PATCHES.threshold,
        metavar="METRES",
        help=f"least indentation of a pixel that touches (default: {_PATCHES.threshold:g})",
    )
    patches.add_argument(
        "--position-noise",
        type=float,
        metavar="METRES",
        help="standard deviation of the heights and of the sensor's position (default: the scatter"
        " of the heights)",
    )
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
    detection = TouchDetection(
        threshold=options.force_threshold,
        release=options.release,
        tip_radius=options.tip_radius,
        spacing=options.spacing,
        normals=options.normals,
        force_on=options.force_on,
    )
    frames = LogFrames(
        object_pose=options.object_pose,
        object_frame=_pose(options.object_frame),
        tip_frame=options.tip_frame.lstrip("/"),
        tip_offset=tuple(options.tip_offset),
        tare=options.tare,
        smoothing=options.smoothing,
    )
    fingers = [
        Finger(force, tip, name or "")
        for force, tip, name in zip_longest(
            options.force or [None], options.tip or [], options.finger or []
        )
    ]
    with Stage(f"Reading {options.log}") as stage:
        log = open_log(options.log, posed=options.urdf is None)
        if options.urdf is not None:
            log = with_link_frames(log, resolve_uri(options.urdf, Path(), "--urdf"))
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
    _write(options, contacts)


def _of_patches(options: argparse.Namespace) -> Contacts:
    for name in ("force", "tip", "finger", "object_pose"):
        if getattr(options, name) is not None:
            flag = f"--{name.replace('_', '-')}"
            message = f"{flag} is for robots' logs; {options.log} has tactile patches: leave it out"
            raise InvalidOptionError(message, option=name)
    spacing = _PATCHES.spacing if options.spacing is None else options.spacing
    detection = PatchDetection(options.indentation, spacing, options.position_noise)
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


def _write(options: argparse.Namespace, contacts: Contacts) -> None:
    path = _output(options)
    header = provenance.describe(source=options.log.name)
    if path.suffix.lower() == ".ply":
        with result_file(path, PRINTED) as temporary:
            contacts.save(temporary, header=header)
    else:
        contacts.save(path, header=header)
    say(f"wrote {path}")
    say(f"next: lis-grasp estimate {path}")


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
