"""What a scene is gathered on: drawing commands, and the layers that the page offers."""

from __future__ import annotations

from dataclasses import dataclass, field

# Nodes of the viewer's scene tree. Everything in the object's frame hangs below its node, so that
# it moves with the object during a lift.
ROOT = "lis_grasp"
OBJECT_NODE = f"{ROOT}/object"


@dataclass(frozen=True, slots=True)
class Layer:
    """Something that can be shown or hidden.

    Parameters
    ----------
    identity
        Its name in the page's address, for example ``"grasp-1"``.
    label
        Its name on the page, plain text.
    on
        Whether it is visible at first.
    colour
        Its colour, ``#rrggbb``.
    note
        More about it, plain text, or empty.
    detail
        All about it, shown on demand, plain text, or empty.
    """

    identity: str
    label: str
    on: bool
    colour: str
    note: str = ""
    detail: str = ""


@dataclass(slots=True)
class Canvas:
    """Commands and layers gathered while a scene is put together, in order."""

    commands: list[bytes] = field(default_factory=list)
    layers: list[Layer] = field(default_factory=list)
