"""Lift stage: the lift of the true object in a simulator."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import trimesh

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.setup import LiftSetup, plan_arm_lift
from lis_grasp.shapes import Shape
from lis_grasp.stages.agent import Known, require_record
from lis_grasp.stages.scenario import Scenario, support_height
from lis_grasp.worker_pool import worker_pool


def require_simulator(simulator: str, shape: Shape) -> None:
    """Raise `InvalidOptionError` if a package is missing that lifts in a simulator need."""
    if simulator == "mujoco":
        from lis_grasp.simulation.mujoco.convex_pieces import require_mujoco

        require_mujoco(shape.mesh)


def lift(
    scenario: Scenario,
    grasp: Grasp,
    *,
    accept_grasp: AcceptGrasp | None = None,
    estimate: trimesh.Trimesh | None = None,
    options: LiftOptions | None = None,
) -> LiftOutcome:
    """Simulate the lift of the true object in the configured simulator.

    Parameters
    ----------
    scenario
        Its true object is lifted.
    grasp
        The grasp, in the frame of the contacts.
    accept_grasp
        Tactile check before the fingers squeeze, as of `simulate_lift`; None for none.
    estimate
        The object as known, which an arm avoids; None if nothing is known.
    options
        Options of the trial; None for `lift_options`.

    Examples
    --------
    >>> scenario = pipeline.Scenario.from_config(RunConfig("box", hand="wsg50", grasps=1))
    >>> search = pipeline.plan(scenario.known, scenario.truth.shape.mesh)
    >>> pipeline.lift(scenario, search.best).held
    True
    """
    require_record("lift", scenario, Scenario)
    truth, known = scenario.truth, scenario.known
    setup = LiftSetup(
        truth.shape.mesh,
        known.hand,
        grasp,
        support_height(truth.shape),
        truth.mass,
        truth.friction,
        options or lift_options(known) or LiftOptions(),
        truth.X_EO,
    )
    if known.station is None and scenario.config.simulator == "mujoco":
        from lis_grasp.simulation.mujoco.lift import simulate_in_mujoco

        return simulate_in_mujoco(setup, accept_grasp)
    from lis_grasp.simulation.drake.lift import simulate_lift

    if known.station is not None:
        step = setup.options.time_step
        arm = plan_arm_lift(known.station, grasp, estimate, time_step=step)
        if isinstance(arm, str):
            return LiftOutcome.not_begun(arm, truth.X_EO)
        setup = replace(setup, arm=arm)
    return simulate_lift(setup, accept_grasp)


def lift_each(
    scenario: Scenario,
    grasps: Sequence[Grasp],
    *,
    jobs: int,
    estimate: trimesh.Trimesh | None = None,
    options: LiftOptions | None = None,
) -> Iterator[LiftOutcome]:
    """Simulate the lift of each grasp on an object at the same pose, in `jobs` processes.

    Outcomes are in the order of the grasps, and the same for any number of processes. The other
    arguments are those of `lift`.

    Examples
    --------
    >>> scenario = pipeline.Scenario.from_config(RunConfig("box", hand="wsg50", grasps=1))
    >>> search = pipeline.plan(scenario.known, scenario.truth.shape.mesh)
    >>> [outcome.held for outcome in pipeline.lift_each(scenario, search, jobs=1)]
    [True]
    """
    simulate = partial(lift, scenario, estimate=estimate, options=options)
    if jobs == 1 or len(grasps) < 2:
        yield from map(simulate, grasps)
        return
    with worker_pool(min(jobs, len(grasps))) as pool:
        yield from pool.map(simulate, grasps)


def lift_options(known: Known) -> LiftOptions | None:
    """Return the options of a lift whose load is known as a prior says; None for the defaults."""
    if known.load.is_known:
        return None
    return LiftOptions(assumed_friction=known.load.friction, assumed_mass=known.load.mass)
