"""Reach of what carries a hand: a protocol, which the station of an arm fulfils."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import trimesh

from lis_grasp.typing import FloatArray

ReachCheck = Callable[[FloatArray, FloatArray, FloatArray], list[str | None]]
"""Palm poses (N, 4, 4), opened and closed joint positions (N, J) -> N reasons, None in reach."""


class Reach(Protocol):
    """The reach of what carries a hand."""

    def reach_check(self, mesh: trimesh.Trimesh) -> ReachCheck:
        """Return a function that finds the grasps that cannot be carried out, and why.

        Parameters
        ----------
        mesh
            Closed mesh of the object in O [m], which is not to be hit on the way.
        """
        ...
