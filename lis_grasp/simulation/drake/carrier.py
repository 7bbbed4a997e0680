"""Carrier protocol: what carries the hand of a simulated lift, a free wrist or an arm."""

from __future__ import annotations

from typing import Protocol

from pydrake.geometry import CollisionFilterManager, GeometryId
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context

from lis_grasp.lifting.lifting_scene import CarrierMotion
from lis_grasp.lifting.wrist_trajectory import WristPath
from lis_grasp.typing import FloatArray


class Carrier(Protocol):
    """Carries the hand's base link along paths that are relative to the palm pose of the grasp."""

    def connect(
        self,
        plant_context: Context,
        filters: CollisionFilterManager,
        carried: RigidBody,
        table: GeometryId,
    ) -> None:
        """Take the context of the finalized plant, its collision filters, object and table."""
        ...

    def place(self, displacement: FloatArray) -> None:
        """Set the palm to a displacement (6,) from the grasp, see `WristPath`, at rest.

        An arm starts at its home instead.
        """
        ...

    def follow(self, path: WristPath, duration: float) -> CarrierMotion:
        """Return the motion along a path of a duration [s]; a carrier may take longer."""
        ...

    def poses(self) -> dict[str, FloatArray]:
        """Return the poses (4, 4) of the carrier's links that can be seen."""
        ...
