"""Placement of a true object on a table: a stable pose, a yaw and a place inside a region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.geometry import apply_pose, make_pose, require_pose
from lis_grasp.io.limits import MEBIBYTE, ReadError, reading
from lis_grasp.shapes.resting import roll_to_rest
from lis_grasp.shapes.shape import Shape
from lis_grasp.typing import FloatArray, Seed

UPRIGHT, STABLE = "upright", "stable"
"""Poses by name: the pose of the mesh, and any stable one. Any other name is a file."""

# Yaws drawn until the object fits into the region.
_YAWS = 100
# Largest error of a rotation read from a file.
_ROTATION_ERROR = 1e-3


def draw_pose(shape: Shape, pose: str, region: Sequence[float], *, rng: Seed = 0) -> FloatArray:
    """Draw the pose X_WO (4, 4) of an object on the table z = 0 of the world frame W.

    Parameters
    ----------
    shape
        The object, in O.
    pose
        ``"upright"``: z of O is up; ``"stable"``: a pose in which the object rests (see
        `roll_to_rest`). Both get a random yaw and place inside the region. Otherwise the path of
        a text file with X_WO as four rows of four numbers, in metres; its height is replaced, so
        that the object rests on the table.
    region
        Lengths of the region along x, y and z [m]: x and y are centred, z begins at the table.
    rng
        Seed or generator, for every draw.

    Raises
    ------
    InvalidOptionError
        If the object does not fit into the region.
    InvalidFileError
        If the file has no pose.
    """
    rng = np.random.default_rng(rng)
    if pose not in (UPRIGHT, STABLE):
        X_WO = _load_pose(Path(pose))
        X_WO[2, 3] -= _bounds(shape, X_WO)[0, 2]
        _require_inside(shape, X_WO, region)
        return X_WO
    rotation = np.eye(3) if pose == UPRIGHT else roll_to_rest(shape.mesh, rng=rng)
    for _ in range(_YAWS):
        yaw = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
        X_WO = make_pose(yaw @ rotation)
        low, high = _bounds(shape, X_WO)
        room = np.array(region) - (high - low)
        if np.all(room >= 0.0):
            corner = np.append(room[:2] * rng.random(2) - 0.5 * np.array(region[:2]), 0.0)
            X_WO[:3, 3] = corner - low
            return X_WO
    raise _too_large(shape, high - low, region)


def placed(shape: Shape, X_WO: npt.ArrayLike) -> Shape:
    """Return an object at a pose (4, 4): its mesh and edges are in W.

    Raises `InvalidOptionError` if the pose is not a rigid transform.
    """
    pose = require_pose("X_WO", X_WO)
    mesh = trimesh.Trimesh(apply_pose(pose, shape.mesh.vertices), shape.mesh.faces, process=False)
    edges = apply_pose(pose, shape.edges.reshape(-1, 3)).reshape(-1, 2, 3)
    return replace(shape, mesh=mesh, edges=edges)


def _bounds(shape: Shape, X_WO: FloatArray) -> FloatArray:
    points = apply_pose(X_WO, shape.mesh.vertices)
    return np.array([points.min(axis=0), points.max(axis=0)])


def _require_inside(shape: Shape, X_WO: FloatArray, region: Sequence[float]) -> None:
    low, high = _bounds(shape, X_WO)
    half = 0.5 * np.array(region[:2])
    if np.any(low[:2] < -half) or np.any(high[:2] > half) or high[2] > region[2]:
        raise _too_large(shape, high - low, region)


def _too_large(shape: Shape, extents: FloatArray, region: Sequence[float]) -> InvalidOptionError:
    def text(lengths: Sequence[float] | FloatArray) -> str:
        return " x ".join(f"{1e3 * length:.0f}" for length in lengths) + " mm"

    return InvalidOptionError(
        f"the region must contain the object; {shape.name} at its pose is {text(extents)} and does"
        f" not fit into the region of {text(region)}: give a larger one by `region`, or check"
        " `units` and `pose`",
        option="region",
        value=list(region),
    )


def _load_pose(path: Path) -> FloatArray:
    if not path.exists():
        raise InvalidFileError(
            f"a pose is {UPRIGHT}, {STABLE}, or a file of four rows of four"
            f" numbers; {path} is none",
            path=path,
        )
    advice = "write four rows of four finite numbers, a rotation and a place [m]"
    with reading(path, "a pose", most=MEBIBYTE, advice=advice):
        pose = np.loadtxt(path, ndmin=2)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise ReadError(f"its numbers of shape {pose.shape} are no 4 x 4 finite ones")
        rotation = pose[:3, :3]
        off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if off > _ROTATION_ERROR or np.linalg.det(rotation) < 0.0:
            raise ReadError("its rotation is not orthonormal and right-handed")
        if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 0.0:
            raise ReadError("its last row is not 0 0 0 1")
    pose[:3, :3] = Rotation.from_matrix(rotation).as_matrix()  # the nearest rotation
    return np.asarray(pose)


def placed_as_recorded(shape: Shape, facts: Mapping[str, Any]) -> Shape:
    """Return a true object at the pose in the header of a results file.

    It was placed at X_WO (4, 4), and touches moved it to X_EO (4, 4) in the frame of the contacts;
    either may be absent. For errors see `placed`.
    """
    for pose in ("X_WO", "X_EO"):
        if facts.get(pose) is not None:
            shape = placed(shape, facts[pose])
    return shape
