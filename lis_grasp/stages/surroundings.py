"""The bodies of a task beside the object."""

from __future__ import annotations

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.shapes import Shape
from lis_grasp.task.task import Task
from lis_grasp.world import ALONE, Surroundings
from lis_grasp.world.touching import bodies_touching


def find_surroundings(task: Task) -> Surroundings:
    """Return the bodies beside the object of a task, in the frame of its table.

    For errors see `load_surroundings`.
    """
    world = task.known.world
    if world is None or isinstance(world, Surroundings):
        return world or ALONE
    from lis_grasp.simulation.drake.world_reader import load_surroundings

    return load_surroundings(world, task.known.at)


def require_apart(surroundings: Surroundings, shape: Shape) -> None:
    """Raise `InvalidOptionError` if an object, as it begins, touches or is in another body."""
    for name in bodies_touching(surroundings, shape.mesh):
        raise InvalidOptionError(
            f"the object must begin apart from the bodies of its `world`; {shape.name} touches"
            f" {name} or is inside of it: move one of them, or begin at another `pose` or `at`",
            option="world",
            value=name,
        )
