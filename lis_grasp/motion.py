"""Motion: where every body of a grasp trial was at each moment, to be played back or measured."""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.typing import FloatArray

OBJECT = "object"  # the name under which `Motion.poses` holds the object

# Products of rotations drift by rounding only; anything beyond this is not a rotation.
_ROTATION_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Poses of the bodies of a trial over time, in the world frame W.

    The world is the frame in which the grasp was planned, so a motion plays in the same scene as
    contacts, estimate and grasps. `X_WO` of the object at the first time is the identity, unless
    it stood elsewhere by then.

    Parameters
    ----------
    times
        Shape (T,) [s], strictly increasing.
    poses
        Body name -> shape (T, 4, 4), its pose `X_WB` [m] at each time. Every hand link by its
        name, and the object as ``"object"``.

    Raises
    ------
    InvalidOptionError
        If shapes disagree, times do not increase, or a pose is no rigid transform.
    """

    times: FloatArray
    poses: Mapping[str, FloatArray]

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=np.float64)
        if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times) <= 0.0):
            raise InvalidOptionError(
                "a motion's times must be finite numbers that strictly increase"
            )
        times.flags.writeable = False
        poses = {name: _rigid_transforms(name, X, len(times)) for name, X in self.poses.items()}
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "poses", poses)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def duration(self) -> float:
        """Time from the first to the last pose [s]; 0 for an empty motion."""
        return float(self.times[-1] - self.times[0]) if len(self) else 0.0

    def relative(self, body: str, base: str) -> FloatArray:
        """Return the poses of `body` in the frame of `base`, shape (T, 4, 4).

        Formula: ``X_BA = inv(X_WB) X_WA``, for example the object as the palm sees it.
        """
        for name in (body, base):
            if name not in self.poses:
                raise InvalidOptionError(
                    f"the motion has no body '{name}'; it has {', '.join(self.poses)}"
                )
        return np.linalg.inv(self.poses[base]) @ self.poses[body]

    def save(self, path: Path | str, *, header: str = "") -> None:
        """Write an .npz file of plain arrays (no pickle); `header` says what made it."""
        names = list(self.poses)
        stack = np.array([self.poses[n] for n in names]).reshape(len(names), len(self), 4, 4)
        with whole_file(Path(path)) as whole, whole.open("wb") as stream:
            np.savez_compressed(  # into a stream: savez would add ".npz" to a path
                stream,
                times=self.times,
                names=np.array(names, dtype=np.str_),
                poses=stack,
                header=np.array(header),
            )

    @classmethod
    def load(cls, path: Path | str) -> Motion:
        """Read a motion that `save` has written.

        Raises
        ------
        InvalidFileError
            If the file is missing or holds something else.
        """
        path = Path(path)
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
                times = archive["times"]
                names = [str(name) for name in archive["names"]]
                poses = archive["poses"]
            return cls(times, dict(zip(names, poses, strict=True)))
        except FileNotFoundError:
            raise InvalidFileError(f"there is no file '{path}'") from None
        except (
            OSError,
            EOFError,
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
            MemoryError,
            RuntimeError,  # an archive that is encrypted, or packed as zipfile does not know
            zipfile.BadZipFile,
            zlib.error,
            tokenize.TokenError,  # NumPy's, of a torn header
            InvalidOptionError,
        ) as error:
            raise InvalidFileError(
                f"'{path}' is not a motion (.npz with times, names and poses): {error}"
            ) from None


def _rigid_transforms(name: str, X: npt.ArrayLike, count: int) -> FloatArray:
    poses = np.array(X, dtype=np.float64)
    if poses.shape != (count, 4, 4):
        raise InvalidOptionError(
            f"poses of '{name}' must have shape ({count}, 4, 4); got {poses.shape}"
        )
    rotations = poses[:, :3, :3]
    error = np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3))
    rigid = np.isfinite(poses).all() and np.all(poses[:, 3] == [0.0, 0.0, 0.0, 1.0])
    if not rigid or np.any(error > _ROTATION_TOLERANCE):
        raise InvalidOptionError(f"poses of '{name}' must be finite rigid transforms")
    poses.flags.writeable = False
    return poses
