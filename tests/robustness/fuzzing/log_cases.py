"""Fuzzing cases of damaged files of points, and of damaged robots' logs."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from fuzzing.cases import Case, Kind, require
from fuzzing.mutations import damage_bytes
from lis_grasp.logs import Finger, LogFrames, TouchDetection, contacts_from_log, open_log
from lis_grasp.surfaces import load_contacts

Generator = np.random.Generator


def make(group: str, index: int, rng: Generator, folder: Path) -> Case:
    """Return a damaged file of points or log; one in a hundred is whole."""
    kind, ending = group.split()
    whole = _points(ending) if kind == "points" else _log(ending)
    sound = bool(rng.random() < 0.01)
    damaged, fault = (whole, "nothing wrong") if sound else damage_bytes(rng, whole)
    path = folder / f"file.{ending}"
    path.write_bytes(damaged)
    check = _check_points if kind == "points" else check_log
    return Case(f"{group}, {fault}", lambda: check(path), sound)


@cache
def _points(ending: str) -> bytes:
    points = np.random.default_rng(0).normal(size=(16, 3))
    points *= 0.04 / np.linalg.norm(points, axis=1, keepdims=True)
    rows = [" ".join(f"{value:.6f}" for value in point) for point in points]
    if ending == "csv":
        rows = ["x,y,z", *(row.replace(" ", ",") for row in rows)]
    elif ending == "off":
        rows = ["OFF", "16 0 0", *rows]
    elif ending == "ply":
        names = [f"property double {axis}" for axis in "xyz"]
        rows = ["ply", "format ascii 1.0", "element vertex 16", *names, "end_header", *rows]
    return ("\n".join(rows) + "\n").encode()


@cache
def _log(ending: str) -> bytes:
    """Return a log of three touches of a plane; the force is a number, the tip a pose."""
    times = np.arange(60) / 20.0
    heights = 0.02 * np.abs(np.sin(np.pi * times)) - 0.001
    forces = np.where(heights < 0.0, 5.0, 0.0)
    if ending == "csv":
        rows = [f"{t},{f},{0.01 * t},0,{h}" for t, f, h in zip(times, forces, heights, strict=True)]
        return "\n".join(["time,force,x,y,z", *rows]).encode()
    ros1 = ending == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    make_message = store.types
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        if ros1:
            writer = rosbag1.Writer(path)
        else:
            plugins = rosbag2.StoragePlugin
            plugin = plugins.MCAP if ending == "mcap" else plugins.SQLITE3
            writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
        serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
        with writer:
            force_type, pose_type = "std_msgs/msg/Float64", "geometry_msgs/msg/Pose"
            force = writer.add_connection("/force", force_type, typestore=store)
            tip = writer.add_connection("/tip", pose_type, typestore=store)
            for time, newtons, height in zip(times, forces, heights, strict=True):
                point = make_message["geometry_msgs/msg/Point"](0.01 * time, 0.0, height)
                turn = make_message["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
                pose = make_message[pose_type](point, turn)
                now = round(1e9 * (time + 1.0))
                writer.write(
                    force, now, serialize(make_message[force_type](float(newtons)), force_type)
                )
                writer.write(tip, now, serialize(pose, pose_type))
        file = path if ros1 else next(path.glob(f"*.{ending}"))
        return file.read_bytes()


def _check_points(path: Path) -> None:
    contacts = load_contacts(path)
    require(bool(np.isfinite(contacts.points).all()), "points are finite")
    if contacts.normal_noise is not None:
        require(bool(np.all(contacts.normal_noise > 0.0)), "deviations are above 0")


def check_log(path: Path) -> None:
    touch = TouchDetection(normals="approach")
    contacts, _ = contacts_from_log(open_log(path), [Finger()], LogFrames(), touch)
    require(bool(np.isfinite(contacts.points).all()), "points are finite")


KIND = Kind(
    (
        *("points csv", "points off", "points ply", "points xyz"),
        *("log csv", "log bag", "log mcap", "log db3"),
    ),
    make,
)
