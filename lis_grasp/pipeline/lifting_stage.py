"""Lift stage: the lift of the true object in one of the simulators."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.arm_lift import plan_arm_lift
from lis_grasp.lifting.lift_outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.lift_trial import AcceptGrasp
from lis_grasp.pipeline.object_setup import support_height
from lis_grasp.pipeline.worker_pool import worker_pool
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray


def require_simulator(simulator: str, shape: Shape) -> None:
    """Raise `InvalidOptionError` if a package is missing that lifts in a simulator need."""
    if simulator == "mujoco":
        from lis_grasp.simulation.mujoco.convex_pieces import require_mujoco

        require_mujoco(shape.mesh)


def lift(
    shape: Shape,
    hand: Hand,
    grasp: Grasp,
    *,
    mass: float,
    friction: float,
    simulator: str = "drake",
    accept_grasp: AcceptGrasp | None = None,
    X_WO: FloatArray | None = None,
    options: LiftOptions | None = None,
    station: Station | None = None,
    estimate: trimesh.Trimesh | None = None,
) -> LiftOutcome:
    """Simulate the lift of the true object in one of `SIMULATORS`.

    With a `station`, its arm carries the hand, and avoids the `estimate` of the object. The other
    arguments are those of `lis_grasp.simulation.drake.simulate_lift.simulate_lift`.
    """
    return _simulation_in(simulator, station, estimate)(
        shape.mesh,
        hand,
        grasp,
        support_height=support_height(shape),
        mass=mass,
        friction=friction,
        accept_grasp=accept_grasp,
        X_WO=X_WO,
        options=options,
    )


def lift_each(
    shape: Shape,
    hand: Hand,
    grasps: Sequence[Grasp],
    *,
    mass: float,
    friction: float,
    jobs: int,
    simulator: str = "drake",
    X_WO: FloatArray | None = None,
    options: LiftOptions | None = None,
    station: Station | None = None,
    estimate: trimesh.Trimesh | None = None,
) -> Iterator[LiftOutcome]:
    """Simulate the lift of each grasp on an object at the same pose X_WO, in `jobs` processes.

    Outcomes are in the order of the grasps, and the same for any number of processes.
    """
    simulate = partial(
        _simulation_in(simulator, station, estimate),
        shape.mesh,
        hand,
        support_height=support_height(shape),
        mass=mass,
        friction=friction,
        X_WO=X_WO,
        options=options,
    )
    if jobs == 1 or len(grasps) < 2:
        yield from map(simulate, grasps)
        return
    with worker_pool(min(jobs, len(grasps))) as pool:
        yield from pool.map(simulate, grasps)


def _simulation_in(
    simulator: str, station: Station | None, estimate: trimesh.Trimesh | None
) -> Callable[..., LiftOutcome]:
    """Return the function that simulates lifts."""
    if station is not None:
        return partial(_lift_with_arm, station, estimate)
    if simulator == "mujoco":
        from lis_grasp.simulation.mujoco.simulate_in_mujoco import simulate_in_mujoco

        return simulate_in_mujoco
    from lis_grasp.simulation.drake.simulate_lift import simulate_lift

    return simulate_lift


def _lift_with_arm(
    station: Station,
    estimate: trimesh.Trimesh | None,
    mesh: trimesh.Trimesh,
    hand: Hand,
    grasp: Grasp,
    *,
    X_WO: FloatArray | None = None,
    options: LiftOptions | None = None,
    **arguments: Any,
) -> LiftOutcome:
    """Plan the arm's motion to a grasp on the estimate, and simulate the lift in Drake."""
    from lis_grasp.simulation.drake.simulate_lift import simulate_lift

    options = options or LiftOptions()
    arm = plan_arm_lift(station, grasp, estimate, time_step=options.time_step)
    if isinstance(arm, str):
        return LiftOutcome.not_begun(arm, np.eye(4) if X_WO is None else X_WO)
    return simulate_lift(mesh, hand, grasp, X_WO=X_WO, options=options, arm=arm, **arguments)
