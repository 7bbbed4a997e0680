"""YAML files of arms by name."""

from __future__ import annotations

from pathlib import Path

from lis_grasp.exceptions import InvalidArmError, nearest_of
from lis_grasp.hands.shipped_models import model_path
from lis_grasp.io.yaml_files import YAML_SUFFIXES

ARM_NAMES = ("iiwa14",)
"""The arms that the package ships, by the name that `Arm.load` takes."""

VENDOR_ARMS = ("kuka_iiwa14", "franka_panda", "panda", "ur5e", "ur5", "xarm7")
"""Vendors' arms whose YAML the package ships; the model is installed apart, as an error says."""

READY_ARMS = (*ARM_NAMES, *VENDOR_ARMS)
"""Every arm whose YAML the package ships."""


def arm_path(path_or_name: str | Path) -> Path:
    """Return the YAML file of an arm of the package, or the path of a file that is there.

    Raises `InvalidArmError` if there is no such arm.
    """
    name = str(path_or_name)
    if name in ARM_NAMES:
        return model_path(f"arms/{name}/{name}.yaml")
    if name in VENDOR_ARMS:
        return model_path(f"arms/vendors/{name}.yaml")
    try:
        if Path(path_or_name).is_file():
            return Path(path_or_name)
        if Path(path_or_name).suffix.lower() in YAML_SUFFIXES:
            raise InvalidArmError(
                f"the arm file {path_or_name} does not exist: check its path, or name an arm such"
                f" as {READY_ARMS[0]}"
            )
    except (OSError, ValueError):  # no name that a file can have
        pass
    raise InvalidArmError(
        f"an arm must be one of {', '.join(READY_ARMS)}, or an arm's YAML file; '{name}' is"
        f" neither{nearest_of(name, READY_ARMS)}"
    )
