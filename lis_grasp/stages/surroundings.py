"""The bodies of a task beside the object, and where the robot believes them to be."""

from __future__ import annotations

import numpy as np

from lis_grasp.stages.random_streams import Stream
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


def believed(surroundings: Surroundings, error: float, seed: int) -> Surroundings:
    """Return bodies at believed places, off by at most an error [m] in level directions.

    The displacements are uniform on a disc; a seed's are the same in all stages.
    """
    if error == 0.0:
        return surroundings
    rng, poses = Stream.BODIES.rng(seed), {}
    for body in surroundings:
        angle, distance = rng.uniform(0.0, 2.0 * np.pi), error * np.sqrt(rng.uniform())
        poses[body.name] = body.X_EB.copy()
        poses[body.name][:2, 3] += distance * np.array([np.cos(angle), np.sin(angle)])
    return surroundings.placed(poses)
