"""Lift stage: the lift of the true object in a simulator, and worker processes."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from multiprocessing import active_children, parent_process
from multiprocessing.context import SpawnContext, SpawnProcess

import trimesh

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.setup import LiftSetup, plan_arm_lift
from lis_grasp.shapes import Shape
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.scenario import Scenario, lowest_point


def require_simulator(simulator: str, shape: Shape) -> None:
    """Raise `InvalidOptionError` if a package is missing that lifts in a simulator need."""
    if simulator == "mujoco":
        from lis_grasp.simulation.mujoco.convex_pieces import require_mujoco

        require_mujoco(shape.mesh)


def lift_object(
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
    >>> scenario = pipeline.Scenario.from_config(Task.of("box", hand="wsg50", grasps=1))
    >>> search = pipeline.plan(scenario.agent, scenario.truth.shape.mesh)
    >>> pipeline.lift(scenario, search.best).held
    True
    """
    truth, agent = scenario.truth, scenario.agent
    setup = LiftSetup(
        truth.shape.mesh,
        agent.hand,
        grasp,
        lowest_point(truth.shape),
        truth.mass,
        truth.friction,
        options or lift_options(agent) or LiftOptions(),
        truth.X_EO,
    )
    if agent.station is None and scenario.task.world.simulator == "mujoco":
        from lis_grasp.simulation.mujoco import lift as in_mujoco

        return in_mujoco.simulate_lift(setup, accept_grasp)
    from lis_grasp.simulation.drake.lift import simulate_lift

    if agent.station is not None:
        step = setup.options.time_step
        arm = plan_arm_lift(agent.station, grasp, estimate, time_step=step)
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


def lift_options(agent: Agent) -> LiftOptions | None:
    """Return the options of a lift whose load is known as a prior says; None for the defaults."""
    load = agent.load_prior
    if load.is_known:
        return None
    return LiftOptions(assumed_friction=load.friction, assumed_mass=load.mass)


@contextmanager
def worker_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Open a pool of processes that end with this one, even if it is killed.

    On exit, work that has not started is cancelled, and work that has is awaited; after Ctrl-C, or
    if an iterator over results is dropped, it is killed. Ctrl-C does not reach the processes.
    """
    pool = ProcessPoolExecutor(processes, mp_context=_Context(), initializer=_end_with_parent)
    try:
        yield pool
    except (KeyboardInterrupt, GeneratorExit):
        for process in active_children():
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def process_count(jobs: int | None) -> int:
    """Return the number of processes: `jobs`, or the number of cores for None."""
    if jobs is None:
        return os.cpu_count() or 1
    if jobs < 1:
        raise InvalidOptionError.out_of_range("jobs", jobs, "at least 1")
    return jobs


class _Process(SpawnProcess):
    """A process that Ctrl-C does not reach, not even while it starts."""

    def start(self) -> None:
        """Start with SIGINT blocked, which the process inherits."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Context(SpawnContext):
    Process = _Process  # type: ignore[assignment]


def _end_with_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
