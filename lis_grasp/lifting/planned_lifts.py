"""Lifts that fit between bodies: their heights, and the way of the palm with its shakes."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import trimesh

from lis_grasp.grasping.body_clearance import BodyClearance, Hit
from lis_grasp.grasping.grasps import LIFT, Grasp
from lis_grasp.grasping.lift_path import LiftPath
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.wrist_path import displaced, shake_about
from lis_grasp.robots.hand import Hand
from lis_grasp.world import Surroundings

LIFT_HEIGHTS = (LIFT, 0.15, 0.2, 0.25, 0.3, 0.05, 0.03)
"""Rises of the wrist that are tried in this order where bodies are beside the object [m]."""

_SAMPLES = 400  # of a shake, in which its largest displacement is found


def permitted_lifts(options: LiftOptions, *, highest: float = np.inf) -> tuple[LiftPath, ...]:
    """Return the lifts that are tried where bodies are beside the object, up to a height [m]."""
    return tuple(
        lift_path(replace(options, lift_height=height))
        for height in LIFT_HEIGHTS
        if height <= highest
    )


@lru_cache
def lift_path(options: LiftOptions) -> LiftPath:
    """Return the way of the palm in a lift: straight up, then to the extremes of the shakes."""
    straight = LiftPath.straight(options.lift_height)
    top = np.array([0.0, 0.0, options.lift_height, 0.0, 0.0, 0.0])
    acceleration = max(options.shake_accelerations, default=0.0)
    times = np.linspace(0.0, options.shake_time, _SAMPLES)
    extremes = []
    for direction in options.shake_directions:
        path = shake_about(
            np.zeros(6),
            direction,
            acceleration,
            frequency=options.shake_frequency,
            cycles=options.shake_cycles,
        )
        ways = np.array([path(time)[0] for time in times])
        largest = ways[np.abs(ways).sum(axis=1).argmax()]
        extremes += [displaced(np.eye(4), top + sign * largest) for sign in (1.0, -1.0)]
    return LiftPath(options.lift_height, np.concatenate([straight.displacements, extremes]))


def choose_lift(
    options: LiftOptions,
    hand: Hand,
    grasp: Grasp,
    mesh: trimesh.Trimesh,
    surroundings: Surroundings,
    *,
    support_height: float,
    highest: float = np.inf,
    margin: float = 0.0,
) -> LiftOptions:
    """Return the options with the first permitted height at which nothing hits a body.

    The object is as known, and all is in its frame O. The usual height, where none is free.
    """
    clearance = BodyClearance(
        hand, mesh, surroundings, support_height=support_height, margin=margin
    )
    standoff = options.standoff
    lift = clearance.first_free_lift(
        permitted_lifts(options, highest=highest),
        np.asarray(grasp.X_OH),
        q=np.asarray(grasp.joint_positions),
        opened=np.asarray(grasp.pregrasp_positions),
        back=-standoff * np.asarray(grasp.approach_O),
    )
    return options if isinstance(lift, Hit) else replace(options, lift_height=lift.height)
