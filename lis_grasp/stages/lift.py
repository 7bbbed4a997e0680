"""Lift stage: the lift of the true object in a simulator."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import trimesh

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.place_plan import PlaceOutcome
from lis_grasp.lifting.planned_lifts import choose_lift
from lis_grasp.lifting.setup import LiftSetup, plan_arm_lift
from lis_grasp.shapes import Shape
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.place import plan_place
from lis_grasp.stages.plan import highest_lift
from lis_grasp.stages.scenario import Scenario, lowest_point
from lis_grasp.stages.worker_pool import worker_pool
from lis_grasp.world import ALONE, Surroundings


def require_simulator(simulator: str, shape: Shape, surroundings: Surroundings = ALONE) -> None:
    """Raise `InvalidOptionError` if a package that the simulator needs is missing.

    Or if a body beside the object is an open mesh, which MuJoCo cannot collide.
    """
    if simulator != "mujoco":
        return
    from lis_grasp.simulation.mujoco.convex_pieces import require_mujoco

    require_mujoco(shape.mesh)
    for body in surroundings:
        for geometry in body.geometries:
            if geometry.kind != "mesh":
                continue
            if not geometry.mesh.is_watertight:
                raise InvalidOptionError(
                    f"the simulator mujoco needs closed meshes; body {body.name} of the world is an"
                    " open one: close it, or take the simulator drake",
                    option="simulator",
                    value=simulator,
                )
            require_mujoco(geometry.mesh)


def lift_object(
    scenario: Scenario,
    grasp: Grasp,
    *,
    accept_grasp: AcceptGrasp | None = None,
    estimate: trimesh.Trimesh | None = None,
    options: LiftOptions | None = None,
) -> LiftOutcome:
    """Simulate the lift of the true object in the simulator of its world, and place it if asked.

    Parameters
    ----------
    scenario
        Its true object is lifted.
    grasp
        The grasp, in the frame of the contacts.
    accept_grasp
        Tactile check before the fingers squeeze, as in `simulate_lift`; None for none.
    estimate
        The object as known, which an arm avoids, which is kept off bodies beside it, and which is
        placed (`plan_place`); None if nothing is known.
    options
        Options of the trial; None for those of `lift_options`, with a height that fits between the
        bodies beside the object.

    Examples
    --------
    >>> scenario = pipeline.Scenario.from_config(Task.of("box", hand="wsg50", grasps=1))
    >>> search = pipeline.plan(scenario.agent, scenario.truth.shape.mesh)
    >>> pipeline.lift(scenario, search.best).held
    True
    """
    truth, agent = scenario.truth, scenario.agent
    if options is None:
        options = fitting_lift(agent, grasp, estimate, lift_options(agent) or LiftOptions())
    setup = LiftSetup(
        truth.shape.mesh,
        agent.hand,
        grasp,
        lowest_point(truth.shape),
        truth.mass,
        truth.friction,
        options,
        truth.X_EO,
        surroundings=truth.surroundings,
        estimate=estimate,
    )
    if agent.station is not None:
        arm = plan_arm_lift(agent.station, grasp, estimate, time_step=options.time_step)
        if isinstance(arm, str):
            return LiftOutcome.not_begun(arm, truth.X_EO)
        setup = replace(setup, arm=arm)
    if agent.decide.place is None or estimate is None:
        return _simulated(scenario, setup, accept_grasp)
    setup = replace(setup, place=plan_place(agent, grasp, estimate, options, setup.arm))
    outcome = _simulated(scenario, setup, accept_grasp)
    if outcome.place is None:
        why = PlaceOutcome("no_place" if outcome.held else "not_held", setup.place)
        outcome = replace(outcome, place=why)
    return outcome


def _simulated(
    scenario: Scenario, setup: LiftSetup, accept_grasp: AcceptGrasp | None
) -> LiftOutcome:
    """Simulate a lift in the simulator of the world."""
    simulator = scenario.task.world.simulator
    if simulator == "mujoco":
        from lis_grasp.simulation.mujoco.lift import simulate_in_mujoco

        return simulate_in_mujoco(setup, accept_grasp)
    from lis_grasp.simulation.drake.lift import simulate_lift

    return simulate_lift(
        setup, accept_grasp, scheme="cenic" if simulator == "cenic" else "discrete"
    )


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
    arguments are as in `lift`.

    Examples
    --------
    >>> scenario = pipeline.Scenario.from_config(Task.of("box", hand="wsg50", grasps=1))
    >>> search = pipeline.plan(scenario.agent, scenario.truth.shape.mesh)
    >>> [outcome.held for outcome in pipeline.lift_each(scenario, search, jobs=1)]
    [True]
    """
    simulate = partial(lift_object, scenario, estimate=estimate, options=options)
    if jobs == 1 or len(grasps) < 2:
        yield from map(simulate, grasps)
        return
    with worker_pool(min(jobs, len(grasps))) as pool:
        yield from pool.map(simulate, grasps)


def fitting_lift(
    agent: Agent, grasp: Grasp, estimate: trimesh.Trimesh | None, options: LiftOptions
) -> LiftOptions:
    """Return options with the first height at which nothing hits a body beside the object."""
    if estimate is None or not len(agent.surroundings):
        return options
    return choose_lift(
        options,
        agent.hand,
        grasp,
        estimate,
        agent.surroundings,
        support_height=agent.support_height,
        highest=highest_lift(agent),
        margin=agent.robot.body_error,
    )


def lift_options(agent: Agent) -> LiftOptions | None:
    """Return the options of a lift by the prior of its load; None for the defaults."""
    load = agent.load.prior
    if load.is_known:
        return None
    return LiftOptions(assumed_friction=load.friction, assumed_mass=load.mass)
