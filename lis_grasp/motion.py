"""Motion: poses of all bodies of a lift trial over time, with load and save."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.geometry import are_rigid, inverse_pose
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.io.limits import read_arrays
from lis_grasp.records import Record, read_only, short_repr
from lis_grasp.typing import FloatArray

OBJECT = "object"
"""Name of the object in `Motion.poses`."""


def arm_body(link: str) -> str:
    """Return the name of an arm's link in `Motion.poses`: hands have links of the same names."""
    return f"arm/{link}"


def beside_body(name: str) -> str:
    """Return the name of a free body beside the object in `Motion.poses`."""
    return f"beside/{name}"


@dataclass(frozen=True, slots=True, eq=False)
class Motion(Record):
    """Poses of the bodies of a trial over time, in the world frame W.

    W is the frame in which the grasp was planned, so a motion fits into the scene of contacts,
    estimate and grasps. The object's first pose `X_WO` is the identity, unless it had moved before.

    Parameters
    ----------
    times
        Shape (T,) [s], strictly increasing.
    poses
        Body name -> shape (T, 4, 4), its pose `X_WB` [m] at each time: every hand link by its
        name, the object as ``"object"``, links of an arm as `arm_body`, and free bodies as
        `beside_body`.

    Raises
    ------
    InvalidOptionError
        If shapes disagree, times do not increase, or a pose is not a rigid transform.
    """

    times: FloatArray
    poses: Mapping[str, FloatArray]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=np.float64)
        if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times) <= 0.0):
            raise InvalidOptionError(
                "a motion's times must be finite numbers that strictly increase",
                option="times",
                value=self.times,
            )
        poses = {name: _rigid_transforms(name, X, len(times)) for name, X in self.poses.items()}
        object.__setattr__(self, "times", read_only(times))
        object.__setattr__(self, "poses", poses)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def duration(self) -> float:
        """Time from the first to the last pose [s]; 0 for an empty motion."""
        return float(self.times[-1] - self.times[0]) if len(self) else 0.0

    def relative(self, body: str, base: str) -> FloatArray:
        """Return the poses of `body` in the frame of `base`, shape (T, 4, 4).

        Formula: ``X_BA = inv(X_WB) X_WA``, for example the object's pose in the palm's frame.
        """
        for option, name in (("body", body), ("base", base)):
            if name not in self.poses:
                raise InvalidOptionError.not_one_of(option, name, self.poses)
        return inverse_pose(self.poses[base]) @ self.poses[body]

    def save(self, path: Path | str, *, header: str = "") -> None:
        """Write an .npz file of plain arrays (no pickle); `header` is kept as text in it."""
        names = list(self.poses)
        arrays = {
            "times": self.times,
            "names": np.array(names, dtype=np.str_),
            "poses": np.array([self.poses[n] for n in names]).reshape(len(names), len(self), 4, 4),
            "header": np.array(header),
        }
        with whole_file(Path(path)) as whole, whole.open("wb") as stream:
            # Into a stream: savez would add ".npz" to a path.
            np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path | str) -> Motion:
        """Read a motion that `save` has written.

        Raises `InvalidFileError` if the file is missing or has no motion.
        """
        path = Path(path)
        times, names, poses = read_arrays(path, ("times", "names", "poses")).values()
        try:
            return cls(times, dict(zip(map(str, names), poses, strict=True)))
        except (TypeError, ValueError, InvalidOptionError) as error:
            message = f"{path} has no valid motion: {error}"
            raise InvalidFileError(message, path=path) from None


def _rigid_transforms(name: str, X: npt.ArrayLike, count: int) -> FloatArray:
    poses = np.array(X, dtype=np.float64)
    if poses.shape != (count, 4, 4):
        message = f"poses of '{name}' must have shape ({count}, 4, 4); got {poses.shape}"
        raise InvalidOptionError(message, option="poses", value=X)
    if not are_rigid(poses):
        message = f"poses of '{name}' must be finite rigid transforms"
        raise InvalidOptionError(message, option="poses", value=X)
    return read_only(poses)
