"""Drawing commands and layers of a scene page, collected in order."""

from __future__ import annotations

from dataclasses import dataclass, field

# Nodes of the viewer's scene tree. What is in the object's frame is below its node, and moves with
# the object during a lift.
ROOT = "lis_grasp"
OBJECT_NODE = f"{ROOT}/object"


@dataclass(frozen=True, slots=True)
class Layer:
    """Part of the page that can be shown or hidden.

    Parameters
    ----------
    identity
        Name in the page's address, for example ``"grasp-1"``.
    label, note, detail
        Plain texts on the page: its name, a line below it, and a tooltip.
    on
        Whether it is visible at first.
    colour
        ``#rrggbb``.
    """

    identity: str
    label: str
    on: bool
    colour: str
    note: str = ""
    detail: str = ""


@dataclass(slots=True)
class Canvas:
    """Commands and layers of a scene in the making."""

    commands: list[bytes] = field(default_factory=list)
    layers: list[Layer] = field(default_factory=list)
