"""Depth images of ROS bags, with their cameras' intrinsics and poses, as views."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidFileError, InvalidInputError, note
from lis_grasp.io.limits import ReadError
from lis_grasp.logs._aligned import choose_topic
from lis_grasp.logs._bag_log import BagLog
from lis_grasp.typing import FloatArray
from lis_grasp.views.camera import Intrinsics
from lis_grasp.views.depth_view import DepthView
from lis_grasp.views.image_files import RecordedDepth, camera_facts, view_of

# Encodings of depth (REP 118), and the unit of each [m].
_ENCODINGS = {"16UC1": ("u2", 1e-3), "32FC1": ("f4", 1.0)}


def load_bag_view(bag: Path | str, camera: Path | str | None = None) -> DepthView:
    """Read the first depth image of a ROS bag as a view.

    The intrinsics are those of the `CameraInfo` beside the image. The file of the camera has the
    pose, or `frame`: then the bag's transforms have the pose in this frame; and `topic` where the
    bag has several depth images. See `views.image_files` for the file.

    Raises
    ------
    InvalidFileError
        If the bag has no depth image of known encoding, or a value in a file is wrong.
    InvalidInputError
        If the package `rosbags` is missing, or the topic or the frame is not in the bag.

    Examples
    --------
    >>> load_bag_view("table.mcap", "camera.yaml")
    DepthView(640 x 480 pixels, no mask)
    """
    path, file = Path(bag), None if camera is None else Path(camera)
    facts = camera_facts(file)
    log = BagLog(path)
    images = (topic.name for topic in log.topics if topic.content == "image")
    pictures = [name for name in images if log.first(name, "image")[2].encoding not in _ENCODINGS]
    topic = choose_topic(log, "image", facts.get("topic"), "topic", *pictures)
    time, frame, message = log.first(topic, "image")
    try:
        values, unit = _depth_of(message)
    except ReadError as error:
        raise InvalidFileError.of(path, f"{topic}: {error}") from None
    pose = None
    if "frame" in facts:
        pose = log.frames().pose(str(facts["frame"]).lstrip("/"), frame, np.array([time]))[0]
        if np.isnan(pose).any():
            message = f"the pose of {frame} in {facts['frame']} is unknown at the image's time"
            raise InvalidInputError(f"{path}: {message}")
    return view_of(RecordedDepth(path, values, unit, _intrinsics(log, topic), pose), file, facts)


def _depth_of(message: Any) -> tuple[FloatArray, float]:
    """Return the numbers of an Image (H, W), and their unit [m]."""
    if message.encoding not in _ENCODINGS:
        raise ReadError(
            f"its encoding is {message.encoding}; a depth image is {' or '.join(_ENCODINGS)}"
        )
    kind, unit = _ENCODINGS[message.encoding]
    form = np.dtype(("<", ">")[bool(message.is_bigendian)] + kind)
    rows = np.frombuffer(np.asarray(message.data, dtype=np.uint8).tobytes(), np.uint8)
    height, width, step = message.height, message.width, message.step
    if len(rows) < height * step or step < width * form.itemsize:
        raise ReadError(f"it has {len(rows)} bytes, not {height} rows of {step}")
    whole = rows[: height * step].reshape(height, step)[:, : width * form.itemsize]
    return np.ascontiguousarray(whole).view(form).astype(np.float64), unit


def _intrinsics(log: BagLog, topic: str) -> Intrinsics | None:
    """Return the intrinsics of the topic's camera; None if the bag does not have them."""
    folder = topic.rpartition("/")[0]
    beside = [each.name for each in log.topics if each.content == "camera"]
    named = [name for name in beside if name.rpartition("/")[0] == folder] or beside
    if len(named) != 1:
        return None
    _, _, info = log.first(named[0], "camera")
    matrix, distortion = (getattr(info, key, getattr(info, key.upper(), ())) for key in "kd")
    if np.any(distortion):
        note(f"{named[0]} has a distortion, which is not corrected: record the rectified image")
    matrix = np.reshape(matrix, (3, 3))
    return Intrinsics(matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
