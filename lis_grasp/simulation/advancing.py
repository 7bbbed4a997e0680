"""Advance a simulation, and name its failure."""

from __future__ import annotations

from pydrake.systems.analysis import Simulator

from lis_grasp.exceptions import SimulationError


def advance(simulator: Simulator, time: float, *, of: str) -> None:
    """Simulate until a time [s].

    Raises
    ------
    SimulationError
        If Drake cannot; it says what the simulation was `of`.
    """
    try:
        simulator.AdvanceTo(time)
    except (RuntimeError, SystemExit) as error:  # the latter where an assertion of Drake's fails
        reason = str(error).splitlines()[0]
        raise SimulationError(f"the simulation of {of} failed at {time:.3f} s: {reason}") from None
