"""The bodies of a task beside the object."""

from __future__ import annotations

from lis_grasp.task.task import Task
from lis_grasp.world import ALONE, Surroundings


def find_surroundings(task: Task) -> Surroundings:
    """Return the bodies beside the object of a task, in the frame of its table.

    For errors see `load_surroundings`.
    """
    path = task.known.world
    if path is None:
        return ALONE
    from lis_grasp.simulation.drake.world_reader import load_surroundings

    return load_surroundings(path)
