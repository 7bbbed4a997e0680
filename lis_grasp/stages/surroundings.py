"""The bodies of a task beside the object, and where the robot believes them to be."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import make_pose
from lis_grasp.shapes import Shape
from lis_grasp.shapes.loading import FORMATS as MESH_FORMATS
from lis_grasp.stages.random_streams import Stream
from lis_grasp.task.task import Task
from lis_grasp.world import ALONE, Surroundings
from lis_grasp.world.files import file_of
from lis_grasp.world.touching import bodies_touching


def load_world(path: str | Path, at: str | None = None) -> Surroundings:
    """Return the bodies of a file in the frame of a table, on whose plane z = 0 the object stands.

    The file has Drake's model directives, scenarios of a HardwareStation (``FILE#NAME`` is one of
    several), one of their models, or a mesh [m]. A warning names what is left out.

    `at` is the place of the table's frame in the file's world: the name of a body or frame, or
    three numbers [m]; None for its origin.

    Raises `InvalidFileError` and `InvalidMeshError` if the file cannot be used, and
    `InvalidOptionError` if it has too many bodies, or no upright frame `at`.

    Examples
    --------
    >>> mesh_bytes = shapes.find("box").mesh.export("block.stl")
    >>> [body.name for body in load_world("block.stl", at="0.3 0 0")]
    ['block']
    """
    from lis_grasp.simulation.drake.world_reader import load_surroundings

    return load_surroundings(path, at)


def find_surroundings(task: Task, height: float) -> Surroundings:
    """Return the bodies beside the object of a task, in the frame W of its touches.

    The table of a file of models is at a height [m] in W; a mesh is in W. For errors see
    `load_world`.
    """
    world = task.known.world
    if world is None or isinstance(world, Surroundings):
        return world or ALONE
    surroundings = load_world(world, task.known.at)
    if file_of(world).suffix.lower() in MESH_FORMATS:
        return surroundings
    return surroundings.in_frame(make_pose(np.eye(3), np.array([0.0, 0.0, -height])))


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


def require_apart(surroundings: Surroundings, shape: Shape) -> None:
    """Raise `InvalidOptionError` if an object, as it begins, touches or is in another body."""
    for name in bodies_touching(surroundings, shape.mesh):
        raise InvalidOptionError(
            f"the object must begin apart from the bodies of its `world`; {shape.name} touches"
            f" {name} or is inside of it: move one of them, or begin at another `pose` or `at`",
            option="world",
            value=name,
        )
