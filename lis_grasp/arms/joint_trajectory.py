"""Joint trajectories: positions, speeds and accelerations of an arm's joints over time."""

from __future__ import annotations

from dataclasses import dataclass

from lis_grasp.records import short_repr
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class JointTrajectory:
    """A motion of J joints from rest to rest, at T times."""

    joint_names: tuple[str, ...]
    times: FloatArray  # (T,) [s], from 0, increasing
    positions: FloatArray  # (T, J) [rad or m]
    velocities: FloatArray  # (T, J) [rad/s or m/s]
    accelerations: FloatArray  # (T, J) [rad/s^2 or m/s^2]

    __repr__ = short_repr

    @property
    def duration(self) -> float:
        """Time of the motion [s]."""
        return float(self.times[-1])

    def reversed(self) -> JointTrajectory:
        """Return the same motion backwards."""
        return JointTrajectory(
            self.joint_names,
            self.times,
            self.positions[::-1],
            -self.velocities[::-1],
            self.accelerations[::-1],
        )
