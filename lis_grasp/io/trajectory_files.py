"""Writing of joint trajectories: CSV, and YAML of ROS 2's trajectory_msgs/JointTrajectory."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.yaml_files import word
from lis_grasp.typing import FloatArray

_DIGITS = 6  # after the decimal point: 1 um, 1 urad


def write_trajectory_csv(
    path: Path,
    joint_names: Sequence[str],
    times: FloatArray,
    positions: FloatArray,
    velocities: FloatArray,
) -> None:
    """Write a trajectory as a table.

    Its columns are ``time`` [s], the position of each joint by its name [rad or m], and its
    velocity as ``<name>_velocity``. Shapes: times (T,), positions and velocities (T, J).
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["time", *joint_names, *(f"{name}_velocity" for name in joint_names)])
    rows = np.column_stack([times, positions, velocities])
    table.writerows([_text(value) for value in row] for row in rows)
    write_text(path, text.getvalue())


def write_joint_trajectory(
    path: Path,
    joint_names: Sequence[str],
    times: FloatArray,
    positions: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
) -> None:
    """Write a trajectory as the YAML of a `trajectory_msgs/msg/JointTrajectory`.

    ROS 2 tools and drivers play it, such as ``ros2 topic pub``. Times are (T,), the others (T, J).
    """
    lines = [
        "header:",
        "  stamp: {sec: 0, nanosec: 0}",
        "  frame_id: ''",
        "joint_names:",
        *(f"- {word(name)}" for name in joint_names),
        "points:",
    ]
    for time, *state in zip(times, positions, velocities, accelerations, strict=True):
        seconds, nanoseconds = divmod(round(float(time) * 1e9), 10**9)
        names = ("positions", "velocities", "accelerations")
        for start, name, values in zip("-  ", names, state, strict=True):
            lines.append(f"{start} {name}: [{', '.join(_text(value) for value in values)}]")
        lines.append("  effort: []")
        lines.append(f"  time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}")
    write_text(path, "\n".join(lines) + "\n")


def _text(value: float) -> str:
    text = f"{value:.{_DIGITS}f}"
    return f"{0.0:.{_DIGITS}f}" if float(text) == 0.0 else text  # no "-0"
