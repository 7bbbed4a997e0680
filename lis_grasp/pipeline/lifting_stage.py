"""Lift stage: the lift of the true object in one of the simulators."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.setup import LiftSetup, plan_arm_lift
from lis_grasp.lifting.trial import AcceptGrasp
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
    arguments are those of `LiftSetup` and of `lis_grasp.simulation.drake.lift.simulate_lift`.
    """
    setup = LiftSetup(
        shape.mesh,
        hand,
        grasp,
        support_height(shape),
        mass,
        friction,
        options or LiftOptions(),
        np.eye(4) if X_WO is None else X_WO,
    )
    return _simulate(simulator, station, estimate, setup, accept_grasp)


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
        lift,
        shape,
        hand,
        mass=mass,
        friction=friction,
        simulator=simulator,
        X_WO=X_WO,
        options=options,
        station=station,
        estimate=estimate,
    )
    if jobs == 1 or len(grasps) < 2:
        yield from map(simulate, grasps)
        return
    with worker_pool(min(jobs, len(grasps))) as pool:
        yield from pool.map(simulate, grasps)


def _simulate(
    simulator: str,
    station: Station | None,
    estimate: trimesh.Trimesh | None,
    setup: LiftSetup,
    accept_grasp: AcceptGrasp | None,
) -> LiftOutcome:
    """Simulate a lift; an arm's motion to the grasp is planned on the estimate."""
    if station is None and simulator == "mujoco":
        from lis_grasp.simulation.mujoco import lift as in_mujoco

        return in_mujoco.simulate_lift(setup, accept_grasp)
    from lis_grasp.simulation.drake.lift import simulate_lift

    if station is not None:
        step = setup.options.time_step
        arm = plan_arm_lift(station, setup.grasp, estimate, time_step=step)
        if isinstance(arm, str):
            return LiftOutcome.not_begun(arm, setup.X_WO)
        setup = replace(setup, arm=arm)
    return simulate_lift(setup, accept_grasp)
