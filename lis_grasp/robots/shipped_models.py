"""Hands and arms by name: the package's own, and hands that installed packages register."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from lis_grasp.exceptions import InvalidArmError, InvalidFileError, InvalidHandError, nearest_of
from lis_grasp.io.yaml_files import find_yaml_file
from lis_grasp.plugins import Registry, errors_of

HAND_NAMES = ("allegro", "wsg50", "barrett", "cup")
"""The hands that the package ships, by the name that `Hand.load` takes."""

VENDOR_HANDS = (
    "allegro_right",
    "allegro_left",
    "leap",
    "shadow",
    "barrett_bh280",
    "schunk_svh",
    "robotiq_2f85",
    "panda_hand",
    "jaco",
    "dex3_left",
    "ability_hand",
    "inspire_hand",
    "wuji_right",
    "dex5_right",
    "linker_l10",
    "linker_o7",
    "robotiq_3f",
)
"""Vendors' hands whose YAML the package ships; the model is installed apart, as an error says."""

READY_HANDS = (*HAND_NAMES, *VENDOR_HANDS)
"""Every hand whose YAML the package ships."""

_PACKAGE = Path(__file__).resolve().parent.parent

HAND_REGISTRY = Registry("hand", dict.fromkeys(READY_HANDS))
"""Names of hands; a plug-in is the path of a YAML file, or a function that returns it."""

ARM_NAMES = ("iiwa14",)
"""The arms that the package ships, by the name that `Arm.load` takes."""

VENDOR_ARMS = ("kuka_iiwa14", "franka_panda", "panda", "ur5e", "ur5", "xarm7")
"""Vendors' arms whose YAML the package ships; the model is installed apart, as an error says."""

READY_ARMS = (*ARM_NAMES, *VENDOR_ARMS)
"""Every arm whose YAML the package ships."""

_ARM_FILE = (
    "write a YAML file with name, urdf (this file) and flange (the link that carries the hand)"
)


def model_path(relative: str) -> Path:
    """Return the path of a shipped model file or folder below ``models/``.

    Raises `InvalidFileError` if the package ships no such file.
    """
    # The wheel carries models/ as lis_grasp/_models; a source checkout has it beside the package.
    for root in (_PACKAGE / "_models", _PACKAGE.parent / "models"):
        path = root / relative
        if path.exists():
            return path
    raise InvalidFileError(
        f"the package ships no model '{relative}'; give the path of a file instead"
    )


def _shipped(folder: str, name: str, own: Sequence[str], of_vendors: Sequence[str]) -> Path | None:
    """Return the YAML file of a robot that the package ships; None for another name."""
    if name not in (*own, *of_vendors):
        return None
    return model_path(f"{folder}/{name if name in own else 'vendors'}/{name}.yaml")


def hand_path(path_or_name: str | Path) -> Path:
    """Return the YAML file of a hand of the package or an installed one, or a file that is there.

    Raises
    ------
    InvalidHandError
        If there is no such hand, or what is registered gives no path.
    InvalidOptionError
        If the module of an installed package's hand cannot be imported.
    PluginError
        If its function raises an error.
    """
    name = str(path_or_name)
    advice = f"`lis-grasp hand new {name}` writes the YAML that describes it"
    file = _shipped("hands", name, HAND_NAMES, VENDOR_HANDS) or find_yaml_file(
        name, "hand", example=HAND_NAMES[0], advice=advice, error=InvalidHandError
    )
    if file is not None:
        return file
    names = HAND_REGISTRY.names
    if name not in names:
        raise InvalidHandError(
            f"a hand must be one of {', '.join(names)}, or a hand's YAML file; '{name}' is"
            f" {_neither(name, names)}"
        )
    registered = HAND_REGISTRY.find(name)
    with errors_of(name, registered):
        path = registered() if callable(registered) else registered
    if not isinstance(path, str | Path):
        raise InvalidHandError(
            f"hand '{name}' must be the path of a YAML file, or a function that returns it; it is"
            f" of type {type(path).__name__}"
        )
    return Path(path)


def arm_path(path_or_name: str | Path) -> Path:
    """Return the YAML file of an arm of the package, or the path of a file that is there.

    Raises `InvalidArmError` if there is no such arm.
    """
    name = str(path_or_name)
    path = _shipped("arms", name, ARM_NAMES, VENDOR_ARMS) or find_yaml_file(
        name, "arm", example=ARM_NAMES[0], advice=_ARM_FILE, error=InvalidArmError
    )
    if path is not None:
        return path
    raise InvalidArmError(
        f"an arm must be one of {', '.join(READY_ARMS)}, or an arm's YAML file; '{name}' is"
        f" {_neither(name, READY_ARMS)}"
    )


def _neither(name: str, names: Iterable[str]) -> str:
    """Return the end of a message on what is neither a known name nor a file."""
    if os.path.isdir(name):  # unlike a path, it takes names of any length
        return "a folder: name the file in it"
    return f"neither{nearest_of(name, names)}"
