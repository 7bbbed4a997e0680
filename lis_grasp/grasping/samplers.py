"""The grasp sampler of a hand: of suction for a cup, of force closure for fingers, or yours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol, cast

import trimesh

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.grasps import GraspSearch, LoadPrior, Reach
from lis_grasp.grasping.lift_path import STRAIGHT_LIFTS, LiftPath
from lis_grasp.grasping.sampler import CANDIDATES, ForceClosureSampler
from lis_grasp.grasping.suction import SuctionSampler
from lis_grasp.plugins import Guarded, Registry, errors_of
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import Seed
from lis_grasp.world import ALONE, Surroundings


class GraspSampler(Protocol):
    """A planner of grasps of one hand on a mesh; for arguments see `ForceClosureSampler`.

    One of your own is a class that is made of a `Hand`.
    """

    def sample(
        self,
        mesh: trimesh.Trimesh,
        *,
        rng: Seed = 0,
        support_height: float | None = None,
        count: int = 10,
    ) -> GraspSearch:
        """Return up to `count` ranked grasps."""
        ...


def sampler_of(
    hand: Hand,
    prior: LoadPrior | None = None,
    *,
    candidates: int = CANDIDATES,
    station: Reach | None = None,
    surroundings: Surroundings = ALONE,
    lifts: Sequence[LiftPath] = STRAIGHT_LIFTS,
    margin: float = 0.0,
) -> GraspSampler:
    """Return the sampler for what a hand holds with; for arguments see `ForceClosureSampler`.

    Examples
    --------
    >>> sampler_of(Hand.load("cup")).sample(shapes.find("box").mesh, count=1).best.family
    'suction'
    """
    sampler = ForceClosureSampler if hand.cup is None else SuctionSampler
    return sampler(
        hand,
        prior,
        candidates=candidates,
        station=station,
        surroundings=surroundings,
        lifts=lifts,
        margin=margin,
    )


PLANNERS: Mapping[str, Callable[[Hand], GraspSampler]] = MappingProxyType(
    {"force_closure": sampler_of}
)
"""The package's planners by name."""

PLANNER_NAMES = Registry("planner", PLANNERS)


def make_planner(name: str, hand: Hand) -> GraspSampler:
    """Return a planner of a hand by its name, or by ``my.module:Class``.

    Raises
    ------
    InvalidOptionError
        If there is no such planner, or what it makes of a hand has no `sample`.
    PluginError
        If its code raises an error.
    """
    make = PLANNER_NAMES.find(name)
    with errors_of(name, make):
        planner = make(hand)
    if not hasattr(planner, "sample"):
        raise InvalidOptionError(
            f"a planner must have sample(mesh, rng=, support_height=, count=); '{name}' makes a"
            f" {type(planner).__name__}, which has not",
            option="planner",
            value=name,
        )
    return cast(GraspSampler, Guarded(name, planner, {"sample": (Sequence,)}))
