"""The robot: its hand, its arm, and the sensors of its fingertips."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import TactileSensor
from lis_grasp.exploration.tactile_sensor import REPORTS
from lis_grasp.io.option import (
    NOT_LARGE,
    RATE,
    SPREAD,
    at_least,
    named,
    option,
    options_of,
    place,
    record_of_options,
)
from lis_grasp.io.yaml_files import YAML_SUFFIXES
from lis_grasp.robots.shipped_models import arm_path, hand_path
from lis_grasp.task.option_groups import ARM, CAMERA, SENSOR, TOUCHING

REAL_SENSOR: Mapping[str, float] = MappingProxyType(
    {
        "position_noise": 0.0005,
        "normal_noise": float(np.radians(3.0)),
        "force_threshold": 0.05,
        "taxel_pitch": 0.002,
    }
)
"""A sensor like a real one: 0.5 mm, 3 deg, 0.05 N, taxels 2 mm apart."""

HAND_EYE = (0.002, float(np.radians(0.5)))
"""Error of the pose of a camera that was calibrated with usual care [m], [rad]."""


def _sensor(help: str, name: str, metavar: str, words_else: str = "") -> Any:
    words = f"{REAL_SENSOR[name]:.3g}; 0 with --known or --ideal"
    declared = {"metavar": metavar, "words": words, "words_else": words_else}
    check = {"METRES": NOT_LARGE, "RADIANS": SPREAD}.get(metavar, at_least(0))
    return option(REAL_SENSOR[name], help, SENSOR, check=check, **declared)


def _hand_eye(name: str, value: Any) -> tuple[float, ...]:
    """Return the root mean squares of the error of a camera's pose, in metres and radians."""
    if len(value) != 2 or not all(0.0 <= part <= 1.0 for part in value):
        required = "metres and radians, two numbers from 0 to 1"
        raise InvalidOptionError.out_of_range(name, value, required)
    return tuple(float(part) for part in value)


def _find_model(find: Callable[[str], object]) -> Callable[[str], object]:
    """Return a function that finds names only: a recorded file may have moved."""

    def find_name(name: str) -> object:
        return None if Path(name).suffix.lower() in YAML_SUFFIXES else find(name)

    return find_name


@record_of_options
class Robot:
    """The hand, the arm that carries it, and the tactile sensor of its fingertips.

    Examples
    --------
    >>> Robot(hand="wsg50").sensor.taxel_pitch
    0.002
    """

    hand: str = option(
        "allegro",
        "a hand's YAML file, or a name: allegro, wsg50, barrett, cup; of vendors' hands"
        " allegro_right, robotiq_2f85, panda_hand and more",
        TOUCHING,
        metavar="HAND",
        check=named(_find_model(hand_path)),
    )
    arm: str | None = option(
        None,
        "an arm that carries the hand: a name, such as iiwa14, or an arm's YAML file",
        ARM,
        metavar="ARM",
        words="none, the hand moves freely",
        check=named(_find_model(arm_path)),
    )
    base: tuple[float, ...] | None = option(
        None,
        "place of the arm's base [m]: x and y on the table, height above it; it faces along +x",
        ARM,
        metavar=("X", "Y", "Z"),
        words="chosen for its reach",
        check=place,
    )
    position_noise: float = _sensor(
        "standard deviation of the positions of contacts that do not carry their own",
        "position_noise",
        "METRES",
        "estimated from the contacts",
    )
    normal_noise: float = _sensor(
        "standard deviation of the normals of contacts that do not carry their own",
        "normal_noise",
        "RADIANS",
        "estimated from the contacts",
    )
    force_threshold: float = _sensor(
        "smallest force that the sensor detects, with `prober` dynamic", "force_threshold", "N"
    )
    taxel_pitch: float = _sensor("distance of the sensor's taxels", "taxel_pitch", "METRES")
    miss_rate: float = option(
        0.0,
        "fraction of contacts that the sensor does not report",
        SENSOR,
        metavar="FRACTION",
        check=RATE,
    )
    false_rate: float = option(
        0.0,
        "fraction of probes without a contact that report one, anywhere along the motion",
        SENSOR,
        metavar="FRACTION",
        check=RATE,
    )

    body_error: float = option(
        0.0,
        "largest error of the known places of bodies beside the object, level: contacts this near"
        " to a body, and 1 mm more, are the body's",
        TOUCHING,
        metavar="METRES",
        check=NOT_LARGE,
    )

    reports: Literal["normals", "touch"] = option(
        "normals",
        "what the sensor reports of a contact: its normal, or, as a switch does, that there is one",
        SENSOR,
        choices=REPORTS,
    )
    camera: bool = option(
        False,
        "a simulated depth camera looks once, from the side, before the first touch; touches go"
        " where it did not see",
        CAMERA,
    )
    hand_eye: tuple[float, ...] = option(
        HAND_EYE,
        "root mean squares of the error between camera and hand, of its distance and its angle; a"
        " simulated camera has such an error",
        CAMERA,
        metavar=("METRES", "RADIANS"),
        words="0.002 0.00873, 0.5 deg; 0 0 with --known or --ideal",
        check=_hand_eye,
    )
    depth_noise: Literal["stereo", "none"] = option(
        "stereo",
        "noise of the simulated camera",
        CAMERA,
        choices=("stereo", "none"),
        words="stereo; none with --known or --ideal",
    )

    def __post_init__(self) -> None:
        if self.base is not None and self.arm is None:
            raise InvalidOptionError("a base needs an `arm`", option="base")

    @property
    def sensor(self) -> TactileSensor:
        """The tactile sensor."""
        record: Any = type(self)
        names = [n for n, option in options_of(record).items() if option.group == SENSOR]
        return TactileSensor(**{name: getattr(self, name) for name in names})
