"""Names of a log's columns: which quantity of tip, object or sensor each one is."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Literal, get_args

Orientation = Literal["xyzw", "wxyz", "rotvec", "rpy", "ZYX", "XYZ", "ZYZ", "matrix", "ignored"]
ORIENTATIONS: tuple[str, ...] = get_args(Orientation)

COUNTS: Mapping[Orientation, int] = {
    **dict.fromkeys(("xyzw", "wxyz"), 4),
    **dict.fromkeys(("rotvec", "rpy", "ZYX", "XYZ", "ZYZ"), 3),
    "matrix": 9,
}
"""Numbers of columns of each form of an orientation."""

_MATRIX = tuple(f"m{row}{column}" for row in range(3) for column in range(3))

# Likely meanings of the columns of an orientation; of several, the user has to choose.
TURNS: Mapping[tuple[str, ...], tuple[Orientation, ...]] = {
    ("qx", "qy", "qz", "qw"): ("xyzw",),
    ("rx", "ry", "rz", "rw"): ("xyzw",),
    ("rotvecx", "rotvecy", "rotvecz"): ("rotvec",),
    ("roll", "pitch", "yaw"): ("rpy",),
    _MATRIX: ("matrix",),
    ("w", "p", "r"): ("rpy",),
    ("a", "b", "c"): ("ZYX", "rpy"),
    ("rx", "ry", "rz"): ("rotvec", "rpy", "XYZ"),
    ("alpha", "beta", "gamma"): ("rpy", "ZYX", "XYZ", "ZYZ"),
    ("phi", "theta", "psi"): ("rpy", "ZYX", "ZYZ"),
    ("q0", "q1", "q2", "q3"): ("wxyz", "xyzw"),
    ("q1", "q2", "q3", "q4"): ("wxyz", "xyzw"),
}
IN_DEGREES = (("w", "p", "r"), ("a", "b", "c"))
"""Names of robots that count in degrees; loggers also write rad, so that the unit is asked for."""

FORCES = (("fx", "fy", "fz"), ("force",))
POINT = ("x", "y", "z")
TIME = ("time", "timestamp", "stamp", "__time", "t", "%time")
"""Names of the time; ``%time``, by ``rostopic echo -p``, is in nanoseconds."""

ARRAYS: Mapping[str, tuple[str, ...]] = {
    "actual_tcp_pose": (*POINT, "rotvecx", "rotvecy", "rotvecz"),
    "actual_tcp_force": FORCES[0],
    "o_t_ee": (*(f"m{k % 4}{k // 4}" if k % 4 < 3 else "" for k in range(12)), *POINT),
    "o_f_ext_hat_k": FORCES[0],
}
"""Elements of the arrays that recorders of UR (RTDE) and Franka write, in small letters.

Matrices are by columns.
"""
IN_BASE = ("actual_tcp_force", "o_f_ext_hat_k")
"""Arrays of forces in the base frame, as their robots' manuals state."""

JOINT_ARRAYS: Mapping[str, tuple[str, ...]] = {
    "actual_q": (
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    ),
}
"""Joints of the arrays of positions; a prefix may precede the names."""

BODIES = {"tip": ["tip", "tcp", "ee", "eef", "tool", "fingertip"], "object": ["object", "obj", "o"]}
"""Words before a quantity that name its body; without one it is the tip's."""

KINDS = {
    "f": ["f", "force"],
    "": ["p", "pos", "position", "translation"],
    "q": ["q", "quat", "quaternion"],
    "r": ["r", "rot", "rotation", "orientation", "euler", "angle"],
    "rotvec": ["rotvec", "rotation_vector", "axis_angle"],
}
"""Words of a quantity before its axis: force, position, quaternion, an orientation."""

COMMANDS = {
    *("target", "targets", "desired", "command", "commands", "commanded", "cmd", "goal"),
    *("reference", "ref", "setpoint"),
}
"""Words in the names of columns and topics that are commands and no measurements."""

OTHERS = {
    *("t", "m", "torque", "moment", "v", "vel", "velocity", "speed", "twist", "linear", "angular"),
    *("w", "omega", "a", "acc", "accel", "acceleration", "accelerometer", "g", "gyro", "mag"),
    *("effort", "current", "voltage", "temperature", "force", "wrench", "ft", "stiffness"),
    *("error", "joint"),
    *COMMANDS,
}
"""Words in the names of columns that are no measured orientation."""

LOOSE = {name for names in TURNS for name in names if len(name) == 1} | {
    *("alpha", "beta", "gamma", "phi", "theta", "psi"),
    *(f"q{digit}" for digit in range(10)),
}
"""Names that are an orientation's only if all of it are there."""

_AXES = ("x", "y", "z", "w")
_BODY = {word: body for body, words in BODIES.items() for word in words}
_KIND = {word: kind for kind, words in KINDS.items() for word in words}


def _either(words: Mapping[str, object]) -> str:
    return "|".join(sorted(words, key=len, reverse=True))


_START = rf"(?:(?P<path>.*?)[./])??(?:(?P<body>{_either(_BODY)})[./_ ]?)??"
_AXIS = re.compile(rf"{_START}(?P<kind>{_either(_KIND)})?[./_ ]?(?P<axis>[xyzw])")
_TURN = re.compile(
    rf"{_START}(?P<turn>roll|pitch|yaw|alpha|beta|gamma|phi|theta|psi|q[0-9]|[abcwpr])"
)
_ARRAY = re.compile(
    rf"(?:.*[./])?(?P<array>{_either({**ARRAYS, **JOINT_ARRAYS})})[_.\[]?(?P<index>\d+)\]?"
)
_GROUP = re.compile(r"(?P<stem>.*?)[_.\[ ]?(?P<element>[a-z]|\d+)\]?")


def array_element(text: str) -> tuple[str, int]:
    """Return the array of `ARRAYS` or `JOINT_ARRAYS` and the index that a name means, or none."""
    found = _ARRAY.fullmatch(text)
    return ("", 0) if found is None else (found["array"], int(found["index"]))


def meaning_of(text: str) -> tuple[str, str] | None:
    """Return the body and the quantity that a column's name means; None if it means none."""
    if text == "force":
        return "tip", "force"
    array, index = array_element(text)
    if array:
        names = ARRAYS.get(array, ())
        return ("tip", names[index]) if index < len(names) and names[index] else None
    found = _AXIS.fullmatch(text)
    if found is not None and not (found["path"] is not None and found["kind"] is None):
        kind = _KIND[found["kind"]] if found["kind"] else ""
        if found["axis"] != "w" or kind in ("q", "r"):
            return "tip" if kind == "f" else _body(found), kind + found["axis"]
    turn = _TURN.fullmatch(text)
    return None if turn is None else (_body(turn), turn["turn"])


def group_of(text: str) -> tuple[str, str, int]:
    """Return the body, the stem and the place in its group of a name that ends with one.

    Places are axes, letters or numbers: x, y, z, w or 1, 2, 3. The stem is empty if the name ends
    with none, and the body if it is of no orientation.
    """
    found = _GROUP.fullmatch(text)
    stem = "" if found is None else found["stem"]
    words = [word for each in (stem, text) for word in re.split(r"[^a-z]+", each) if word[1:]]
    if OTHERS & {*words, stem}:
        return "", "", 0
    body = next((_BODY[word] for word in reversed(words) if word in _BODY), "tip")
    last = "0" if found is None else found["element"]
    if last.isdecimal():
        return body, stem, int(last)
    return body, stem, _AXES.index(last) if last in _AXES else ord(last)


def _body(found: re.Match[str]) -> str:
    words = [*re.split(r"[./]", found["path"] or ""), found["body"] or ""]
    return next((_BODY[word] for word in reversed(words) if word in _BODY), "tip")
