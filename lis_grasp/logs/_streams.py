"""Streams of a robot's log: series of poses, forces and joint positions, and transforms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import networkx as nx
import numpy as np
from scipy.spatial.transform import Rotation, Slerp
from typing_extensions import Self

from lis_grasp.contacts import FARTHEST
from lis_grasp.exceptions import InvalidInputError, note
from lis_grasp.geometry import inverse_pose, make_pose, unit
from lis_grasp.typing import FloatArray

Content = Literal["force", "pose", "transforms", "joints", "image", "camera", "other"]


# A pose between two samples farther apart than this is unknown [s].
LONGEST_GAP = 0.25
_UNIT_TOLERANCE = 0.1


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a log: its name, type, number of messages, and what it contains."""

    name: str
    type: str
    messages: int
    content: Content


@dataclass(frozen=True, slots=True, eq=False)
class TimedForces:
    """Forces over time.

    Attributes
    ----------
    times
        Shape (T,) [s], not decreasing.
    forces
        Shape (T, 3) [N], or (T, 1) where only the magnitude is known.
    frame
        Name of the frame in which vectors are given; empty if unknown.
    """

    times: FloatArray
    forces: FloatArray
    frame: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class TimedPoses:
    """Poses X_PC of a child frame C in a parent frame P over time.

    Attributes
    ----------
    times
        Shape (T,) [s], strictly increasing.
    positions
        Shape (T, 3) [m].
    quaternions
        Shape (T, 4), unit, in the order x, y, z, w.
    parent, child
        Names of the frames; empty if unknown.
    """

    times: FloatArray
    positions: FloatArray
    quaternions: FloatArray
    parent: str = ""
    child: str = ""

    @classmethod
    def collect(
        cls,
        times: FloatArray,
        values: FloatArray,
        parent: str = "",
        child: str = "",
        name: str = "",
    ) -> TimedPoses:
        """Sort samples by time and drop repeated times; values (T, 7) are x y z qx qy qz qw.

        Samples that are not finite or farther than 10,000 km, or whose quaternion is not of unit
        length, are dropped; a note counts them by the name of the stream.
        """
        count = len(times)
        valid = np.isfinite(times) & np.all(np.abs(values) < FARTHEST, axis=1)
        times, values = times[valid], values[valid]
        lengths = np.linalg.norm(values[:, 3:], axis=1)
        valid = np.abs(lengths - 1.0) < _UNIT_TOLERANCE
        lost = count - int(valid.sum())
        if lost:
            note(
                f"{name}: {lost} of {count} poses are left out: nan, far away, or with a quaternion"
                " that is not of length 1, such as 0 0 0 0"
            )
        _, order = np.unique(times[valid], return_index=True)
        rows = values[valid][order]
        return cls(
            times[valid][order],
            rows[:, :3],
            unit(rows[:, 3:]),
            parent.lstrip("/"),
            child.lstrip("/"),
        )

    def at(self, times: FloatArray) -> FloatArray:
        """Return the interpolated poses at times (N,), shape (N, 4, 4); NaN where unknown.

        Positions are interpolated linearly, orientations along great circles (Slerp). A single
        sample is a static transform. Times outside of the samples, or in a gap of more than 0.25 s,
        are unknown.
        """
        if not len(self.times):
            return np.full((len(times), 4, 4), np.nan)
        if len(self.times) == 1:
            rotation = Rotation.from_quat(self.quaternions[0]).as_matrix()
            return np.tile(make_pose(rotation, self.positions[0]), (len(times), 1, 1))
        within = np.clip(times, self.times[0], self.times[-1])
        slerp = Slerp(self.times, Rotation.from_quat(self.quaternions))
        places = [np.interp(within, self.times, column) for column in self.positions.T]
        poses = make_pose(slerp(within).as_matrix(), np.stack(places, axis=1))
        after = np.clip(np.searchsorted(self.times, within), 1, len(self.times) - 1)
        gap = self.times[after] - self.times[after - 1]
        exact = (self.times[after] == within) | (self.times[after - 1] == within)
        poses[(times != within) | ((gap > LONGEST_GAP) & ~exact)] = np.nan
        return poses


@dataclass(frozen=True, slots=True, eq=False)
class FrameTree:
    """Transforms between named frames, by (parent, child).

    Attributes
    ----------
    transforms
        Poses of the child in the parent.
    unknown
        Why a needed transform is missing, in words.
    sources
        Topics or columns of the transforms.
    """

    transforms: Mapping[tuple[str, str], TimedPoses]
    unknown: Mapping[tuple[str, str], str] = field(default_factory=dict)
    sources: tuple[str, ...] = ()

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        return sorted({name for pair in (*self.transforms, *self.unknown) for name in pair})

    def pose(self, base: str, frame: str, times: FloatArray) -> FloatArray:
        """Return poses of a frame in a base frame at times (N,), shape (N, 4, 4); NaN if unknown.

        Raises `InvalidInputError` if no chain of transforms connects the two frames, or one of them
        is unknown.
        """
        poses = np.tile(np.eye(4), (len(times), 1, 1))
        if base == frame:
            return poses
        graph = nx.Graph()
        graph.add_edges_from((*self.transforms, *self.unknown))
        if base not in graph or frame not in graph or not nx.has_path(graph, base, frame):
            names = ", ".join(self.frames) or "none"
            raise InvalidInputError(
                f"no chain of transforms connects the frames '{base}' and '{frame}'; the log has"
                f" transforms of {names}"
            )
        path = list(pairwise(nx.shortest_path(graph, base, frame)))
        for reason in (self.unknown.get(pair) for step in path for pair in (step, step[::-1])):
            if reason:
                raise InvalidInputError(reason)
        for before, after in path:
            if (before, after) in self.transforms:
                poses = poses @ self.transforms[before, after].at(times)
            else:
                poses = poses @ inverse_pose(self.transforms[after, before].at(times))
        return poses


@dataclass(frozen=True, slots=True, eq=False)
class JointSeries:
    """Positions of a joint over time from one source.

    Attributes
    ----------
    source
        Topic, or column of a table.
    times, positions
        Shapes (T,) [s] and (T,) [rad or m], in the order of time.
    is_left_out
        Whether it is of a topic that the user left out.
    """

    source: str
    times: FloatArray
    positions: FloatArray
    is_left_out: bool = False

    def __post_init__(self) -> None:
        order = np.argsort(self.times, kind="stable")
        object.__setattr__(self, "positions", self.positions[order])
        object.__setattr__(self, "times", self.times[order])


class RobotLog(ABC):
    """Forces and poses of a log, by topic.

    Attributes
    ----------
    topics
        The topics.
    unused
        Content without a topic: columns that are not understood.
    unit_advice
        What to do if positions are not in metres.
    base
        Frame of poses whose frame is not known: that of the robot's base; empty if it is unknown.
    reach
        Largest distance of a link from the robot's base [m]; infinite if it is not known.
    """

    topics: tuple[Topic, ...]
    unused: tuple[str, ...] = ()
    unit_advice: str
    base: str = ""
    reach: float = np.inf
    _frames: FrameTree | None = None

    def with_links(self, frames: FrameTree, base: str, reach: float) -> Self:
        """Return the log with the frames of a robot's links; see the attributes."""
        log = copy(self)
        log._frames, log.base, log.reach = frames, base, reach
        return log

    @abstractmethod
    def forces(self, topic: str) -> TimedForces:
        """Return the forces of a topic."""

    @abstractmethod
    def poses(self, topic: str) -> TimedPoses:
        """Return the poses of a topic."""

    def frames(self) -> FrameTree:
        """Return the transforms between frames, read once."""
        if self._frames is None:
            self._frames = self._read_frames()
        return self._frames

    def _read_frames(self) -> FrameTree:
        return FrameTree({})

    @abstractmethod
    def joints(self, names: tuple[str, ...]) -> Mapping[str, list[JointSeries]]:
        """Return the positions of the logged joints, from each of their sources."""

    @abstractmethod
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of joints, or what may be joints."""

    def other_readings(self) -> Mapping[str, Self]:
        """Return the log with other meanings of the tip's topic, by the advice to take it so."""
        return {}
