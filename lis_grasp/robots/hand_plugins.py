"""YAML files of hands by name: the package's own, and those that installed packages register."""

from __future__ import annotations

from pathlib import Path

from lis_grasp.exceptions import InvalidHandError, nearest_of
from lis_grasp.plugins import Registry
from lis_grasp.robots.shipped_models import HAND_NAMES, READY_HANDS, VENDOR_HANDS, model_path

HAND_REGISTRY = Registry("hand", dict.fromkeys(READY_HANDS))
"""Names of hands; a plug-in is the path of a YAML file, or a function that returns it."""


def hand_path(name: str) -> Path:
    """Return the YAML file of a hand of the package, or of an installed package.

    Raises
    ------
    InvalidHandError
        If there is no such hand, or what is registered gives no path.
    InvalidOptionError
        If the module of an installed package's hand cannot be imported.
    """
    if name in HAND_NAMES:
        return model_path(f"hands/{name}/{name}.yaml")
    if name in VENDOR_HANDS:
        return model_path(f"hands/vendors/{name}.yaml")
    known = HAND_REGISTRY.names
    if name not in known:
        raise InvalidHandError(
            f"a hand must be one of {', '.join(known)}, or a hand's YAML file; '{name}' is"
            f" neither{nearest_of(name, known)}"
        )
    found = HAND_REGISTRY.find(name)
    path = found() if callable(found) else found
    if not isinstance(path, str | Path):
        raise InvalidHandError(
            f"hand '{name}' must be the path of a YAML file, or a function that returns it; it is"
            f" of type {type(path).__name__}"
        )
    return Path(path)
