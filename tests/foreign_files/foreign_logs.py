"""Logs of touches of a box as other programs write them, each with its truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from foreign import Outcome, outcome_of
from scipy.spatial.transform import Rotation

from lis_grasp import Contacts
from lis_grasp.logs import (
    Finger,
    LogFrames,
    LogReading,
    TouchDetection,
    contacts_from_log,
    open_log,
)
from lis_grasp.typing import FloatArray

SIZE = np.array([0.06, 0.05, 0.04])
RADIUS, STEP, STIFFNESS, DEPTH = 0.005, 0.01, 2e4, 1.5e-4
_TOUCH = TouchDetection(threshold=0.5, tip_radius=RADIUS, normals="force")
# A step of the approach, and the penetration at the threshold.
TOLERANCE = 0.03 / 49 + DEPTH

_PLACES = ("{}", "pos_{}", "p{}", "tcp_{}", "tip.{}", "pose.position.{}", "/tip/pose/position/{}")
_TURNS = ("q{}", "quat_{}", "pose.orientation.{}", "/tip/pose/orientation/{}", "orientation_{}")
_FORCES = ("f{}", "force_{}", "wrench.force.{}", "/ft/wrench/force/{}", "F{}", "tcp_force_{}")
_OBJECTS = ("o{}", "object_{}", "obj_{}", "/object/pose/position/{}")
_LENGTHS = {"": 1.0, " [mm]": 1e3, "_mm": 1e3, " (cm)": 1e2, "_m": 1.0}
_TIMES = {"time": 1.0, "timestamp": 1.0, "time_ms": 1e3, "t [us]": 1e6, "time_ns": 1e9}
_TIMES |= {"%time": 1e9, "stamp": 1.0}
_OTHERS = ("torque_x", "wrench.torque.z", "twist.linear.x", "seq", "battery", "v_x", "temperature")


# Angles: names, what the user answers, the sequence in SciPy's words, and whether in degrees.
_ANGLES: dict[str, tuple[tuple[str, str, str], str, str, bool]] = {
    "rpy": (("roll", "pitch", "yaw"), "", "xyz", False),
    "rpy in degrees": (("roll", "pitch", "yaw"), "", "xyz", True),
    "kuka": (("A", "B", "C"), "ZYX", "ZYX", True),
    "mitsubishi": (("A", "B", "C"), "rpy", "xyz", True),
    "fanuc": (("W", "P", "R"), "", "xyz", True),
    "yaskawa": (("Rx", "Ry", "Rz"), "rpy", "xyz", True),
    "staubli": (("RX", "RY", "RZ"), "XYZ", "XYZ", True),
    "greek": (("alpha", "beta", "gamma"), "ZYZ", "ZYZ", False),
    "strange angles": (("ori1", "ori2", "ori3"), "rpy", "xyz", False),
}
_BASE_FORCES = ("ur", "franka")
_FORMS = ["xyzw", "wxyz", "rotvec", "none", *_BASE_FORCES, *_ANGLES]
_FORMS += ["strange quaternion", "strange matrix"]


@dataclass(frozen=True)
class ForeignLog:
    """A table, what its user knows, and whether a unit in it is mistaken."""

    path: Path
    reading: LogReading
    frames: LogFrames
    mistaken: bool  # a unit that no name states, which must be refused


_CONFUSED: dict[str, Any] = {"wxyz": "xyzw", "xyzw": "wxyz", "rotvec": "rpy", "rpy": "rotvec"}
_CONFUSED |= {"ZYX": "rpy", "XYZ": "rpy", "ZYZ": "rpy"}


@cache
def _samples(count: int = 15) -> tuple[FloatArray, ...]:
    """Return times, tips, forces, true points and normals; the box is at the origin."""
    rng = np.random.default_rng(0)
    points, normals, tips, forces = [], [], [], []
    for n in range(count):
        axis, sign = [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1)][n % 5]
        normal = np.zeros(3)
        normal[axis] = sign
        point = rng.uniform(-0.4, 0.4, 3) * SIZE
        point[axis] = sign * SIZE[axis] / 2
        way = np.concatenate([np.linspace(0.03, -DEPTH, 50), np.linspace(-DEPTH, 0.03, 50)])
        tips.append(point + (RADIUS + way[:, None]) * normal)
        forces.append(STIFFNESS * np.maximum(-way, 0.0)[:, None] * normal)
        points.append(point)
        normals.append(normal)
    centers = np.concatenate(tips)
    times = STEP * np.arange(len(centers))
    return times, centers, np.concatenate(forces), np.array(points), np.array(normals)


def write_log(folder: Path, rng: np.random.Generator) -> ForeignLog:
    """Write a log with names, units, order and orientation drawn at random."""
    times, tips, forces, _, _ = _samples()
    count = len(times) // 15
    drawn = Rotation.from_euler("xyz", rng.uniform(-0.6, 0.6, (15, 3))) * Rotation.from_euler(
        "x", np.pi
    )
    form = str(rng.choice(_FORMS))
    turn = Rotation.from_quat(np.repeat(drawn.as_quat(), count, axis=0))
    offset = np.array([0.0, 0.0, 0.12])
    if form == "none":
        turn, offset = Rotation.identity(len(times)), np.zeros(3)
    move = np.zeros((len(times), 3))
    moving = rng.random() < 0.3
    if moving:
        move[:, :2] = 0.05 * np.column_stack([np.sin(0.2 * times), np.cos(0.2 * times)])
    in_base = form in _BASE_FORCES or (form != "none" and rng.random() < 0.5)
    flange = tips + move - turn.apply(offset)
    felt = forces if in_base else turn.inv().apply(forces)
    columns = _times(times, rng)
    unit, scale = _choice(_LENGTHS, rng)
    mistaken = bool(unit == "" and rng.random() < 0.5) and form not in _BASE_FORCES
    turned, known = _turn_columns(form, turn, rng)
    if form in _BASE_FORCES:
        unit, scale = "", 1.0
        columns |= _arrays(form, flange, turn, felt, rng)
    else:
        columns |= _triple(str(rng.choice(_PLACES)), unit, flange * (1e3 if mistaken else scale))
        columns |= _triple(str(rng.choice(_FORCES)), rng.choice(["", " [N]", "_n"]), felt)
    columns |= turned
    if moving:
        columns |= _triple(str(rng.choice(_OBJECTS)), unit, move * (1e3 if mistaken else scale))
    for name in rng.choice(_OTHERS, size=int(rng.integers(0, 4)), replace=False):
        columns[str(name)] = rng.normal(size=len(times))
    names = [str(name) for name in rng.permutation(list(columns))]
    mark = str(rng.choice([",", ";", "\t"]))
    rows = zip(*(columns[name] for name in names), strict=True)
    lines = [mark.join(names), *(mark.join(_cell(value) for value in row) for row in rows)]
    end = str(rng.choice(["\n", "\r\n"]))
    path = folder / "log.csv"
    path.write_bytes(end.join(lines).encode(str(rng.choice(["utf-8", "utf-8-sig"]))))
    frames = LogFrames(tip_offset=tuple(offset.tolist()), object_pose="object" if moving else None)
    asked = {"force_frame": "base"} if in_base and form not in _BASE_FORCES else {}
    return ForeignLog(path, LogReading(**known), replace(frames, **asked), mistaken)


def _times(times: FloatArray, rng: np.random.Generator) -> dict[str, Any]:
    start = rng.choice([0.0, 1.7e9])
    if rng.random() < 0.15:
        stamps = np.round((start + times) * 1e9).astype(np.int64)
        first, last = (
            ("secs", "nsecs")
            if rng.random() < 0.5
            else ("header.stamp.sec", "header.stamp.nanosec")
        )
        return {first: stamps // 10**9, last: stamps % 10**9}
    name, scale = _choice(_TIMES, rng)
    if rng.random() < 0.15:  # a slower clock
        times = np.floor(times / 0.05 + 1e-9) * 0.05
    stamps = (start + times) * scale
    return {name: np.round(stamps).astype(np.int64) if scale > 1e3 else stamps}


def _turn_columns(
    form: str, turn: Rotation, rng: np.random.Generator
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the columns of an orientation, and what their user knows about them."""
    q = turn.as_quat()
    if form == "xyzw":
        pattern = str(rng.choice(_TURNS))
        return {pattern.format(axis): q[:, k] for k, axis in enumerate("xyzw")}, {}
    if form == "wxyz":
        first = int(rng.integers(0, 2))
        columns = {f"q{first + k}": q[:, (k - 1) % 4] for k in range(4)}
        return columns, {"orientation": "wxyz"}
    if form == "strange quaternion":
        return {f"att_{axis}": q[:, k] for k, axis in enumerate("xyzw")}, {"orientation": "xyzw"}
    if form == "strange matrix":
        table = turn.as_matrix().reshape(-1, 9)
        places = [f"R{row}{column}" for row in range(1, 4) for column in range(1, 4)]
        return dict(zip(places, table.T, strict=True)), {"orientation": "matrix"}
    if form == "rotvec":
        pattern = str(rng.choice(["r{}", "rot_{}", "rotation.{}", "tcp_r{}"]))
        return _triple(pattern, "", turn.as_rotvec()), {"orientation": "rotvec"}
    if form not in _ANGLES:
        return {}, {}
    names, meaning, sequence, degrees = _ANGLES[form]
    table = turn.as_euler(sequence, degrees=degrees)
    ending = str(rng.choice(["_deg", " [deg]", ""] if degrees else ["", "_rad"]))
    known: dict[str, Any] = {"orientation": meaning} if meaning else {}
    known |= {"angles": "deg"} if degrees and not ending else {}
    return {f"{name}{ending}": table[:, k] for k, name in enumerate(names)}, known


def _arrays(
    form: str, places: FloatArray, turn: Rotation, felt: FloatArray, rng: np.random.Generator
) -> dict[str, Any]:
    """Return the arrays that the recorders of two robots write, with their other columns."""
    noise = rng.normal(size=(len(places), 7))
    if form == "ur":
        pose = np.hstack([places, turn.as_rotvec()])
        arrays = {"actual_TCP_pose": pose, "actual_TCP_force": np.hstack([felt, noise[:, :3]])}
        arrays |= {"actual_q": noise[:, :6], "actual_TCP_speed": noise[:, :6]}
    else:
        matrices = np.tile(np.eye(4), (len(places), 1, 1))
        matrices[:, :3, :3], matrices[:, :3, 3] = turn.as_matrix(), places
        own = turn.inv().apply(felt)
        arrays = {
            "O_T_EE": matrices.transpose(0, 2, 1).reshape(-1, 16),  # by columns
            "O_F_ext_hat_K": np.hstack([felt, noise[:, :3]]),
            "K_F_ext_hat_K": np.hstack([own, noise[:, :3]]),
            "q": noise,
        }
    mark = str(rng.choice(["{}_{}", "{}[{}]"])) if form == "franka" else "{}_{}"
    return {
        mark.format(name, k): table[:, k]
        for name, table in arrays.items()
        for k in range(table.shape[1])
    }


def _triple(pattern: str, unit: str, table: FloatArray) -> dict[str, FloatArray]:
    return {f"{pattern.format(axis)}{unit}": table[:, k] for k, axis in enumerate("xyz")}


def _choice(table: dict[str, float], rng: np.random.Generator) -> tuple[str, float]:
    name = str(rng.choice(list(table)))
    return name, table[name]


def _cell(value: float) -> str:
    return str(int(value)) if isinstance(value, np.integer) else repr(float(value))


def check_log(folder: Path, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield what becomes of a log without and with what its user knows."""
    foreign = write_log(folder, rng)
    _, _, _, points, normals = _samples()

    def read(reading: LogReading, frames: LogFrames) -> Contacts:
        log = open_log(foreign.path, reading=reading)
        return contacts_from_log(log, [Finger()], frames, _TOUCH)[0]

    def is_right(contacts: Contacts) -> bool:
        if len(contacts) != len(points):
            return False
        apart = np.linalg.norm(contacts.points - points, axis=1).max()
        cosines = np.sum(contacts.normals * normals, axis=1)
        return bool(apart < TOLERANCE and cosines.min() > 0.99)

    bare = replace(foreign.frames, force_frame=None)
    yield "bare", outcome_of(lambda: read(LogReading(), bare), is_right)
    known = outcome_of(lambda: read(foreign.reading, foreign.frames), is_right)
    yield ("mistaken" if foreign.mistaken else "known"), known
    given = foreign.reading.orientation
    if given in _CONFUSED and not foreign.mistaken:
        answer = replace(foreign.reading, orientation=_CONFUSED[given])
        yield "answered wrongly", outcome_of(lambda: read(answer, foreign.frames), is_right)
