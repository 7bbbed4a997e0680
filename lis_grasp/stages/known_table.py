"""The table under contacts in files: as given, else as recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from lis_grasp.io.option import checked_value
from lis_grasp.stages.estimate import Perception
from lis_grasp.stages.next_touch import ObjectPlace
from lis_grasp.task.task import HEIGHT, Task


def known_table(
    support: float | Literal["none"] | None, task: Task, recorded: Mapping[str, Any]
) -> tuple[ObjectPlace, Perception]:
    """Return the object's place on the given or else recorded table, and the settings."""
    held = support == "none"
    if support is None:
        height = recorded.get("support_height")
        closes = height if task.on_table else None
    else:
        height = None if held else checked_value("support", support, float, HEIGHT)
        closes = height
    known = Perception.of(task.robot, task.decide, closes)
    return ObjectPlace(support=height, held=held), known
