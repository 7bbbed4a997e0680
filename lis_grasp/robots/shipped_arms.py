"""YAML files of arms by name."""

from __future__ import annotations

from pathlib import Path

from lis_grasp.exceptions import InvalidArmError, nearest_of
from lis_grasp.io.yaml_files import find_yaml_file
from lis_grasp.robots.shipped_models import model_path

ARM_NAMES = ("iiwa14",)
"""The arms that the package ships, by the name that `Arm.load` takes."""

VENDOR_ARMS = ("kuka_iiwa14", "franka_panda", "panda", "ur5e", "ur5", "xarm7")
"""Vendors' arms whose YAML the package ships; the model is installed apart, as an error says."""

READY_ARMS = (*ARM_NAMES, *VENDOR_ARMS)
"""Every arm whose YAML the package ships."""

_ARM_FILE = (
    "write a YAML file with name, urdf (this file) and flange (the link that carries the hand)"
)


def arm_path(path_or_name: str | Path) -> Path:
    """Return the YAML file of an arm of the package, or the path of a file that is there.

    Raises `InvalidArmError` if there is no such arm.
    """
    name = str(path_or_name)
    if name in ARM_NAMES:
        return model_path(f"arms/{name}/{name}.yaml")
    if name in VENDOR_ARMS:
        return model_path(f"arms/vendors/{name}.yaml")
    path = find_yaml_file(
        name, "arm", example=ARM_NAMES[0], advice=_ARM_FILE, error=InvalidArmError
    )
    if path is not None:
        return path
    raise InvalidArmError(
        f"an arm must be one of {', '.join(READY_ARMS)}, or an arm's YAML file; '{name}' is"
        f" neither{nearest_of(name, READY_ARMS)}"
    )
