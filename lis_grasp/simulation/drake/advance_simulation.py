"""Advance a Drake simulation; a failure of the solver becomes a SimulationError."""

from __future__ import annotations

from pydrake.systems.analysis import Simulator

from lis_grasp.exceptions import SimulationError


def advance(simulator: Simulator, time: float, *, of: str) -> None:
    """Simulate until a time [s].

    Raises
    ------
    SimulationError
        If Drake fails; its message names what the simulation is `of`.
    """
    try:
        simulator.AdvanceTo(time)
    except (RuntimeError, SystemExit) as error:  # SystemExit: an assertion of Drake's failed
        reason = str(error).splitlines()[0]
        raise SimulationError(f"the simulation of {of} failed at {time:.3f} s: {reason}") from None
