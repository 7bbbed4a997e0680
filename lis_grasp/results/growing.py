"""Intermediate estimates of an exploration, which its page shows growing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from lis_grasp.exceptions import EstimationError, InvalidMeshError
from lis_grasp.exploration import (
    Exploration,
    ExplorationState,
    TouchLog,
)
from lis_grasp.exploration.disturbance import Disturbance
from lis_grasp.io.surface_files import save_growth
from lis_grasp.meshing import extract_mesh
from lis_grasp.results.progress import StageProgress
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.estimate import SurfaceEstimate
from lis_grasp.typing import FloatArray

# Number of intermediate estimates to keep, and the cells along the bounds of their meshes.
_STEPS, _CELLS = 7, 26


# Contacts of the first one; with fewer, the surface is very uncertain.
_FIRST = 3


def growth_counts(contacts: int) -> list[int]:
    """Return the numbers of contacts at which estimates are kept, all below `contacts`.

    Their ratios are about equal: the first contacts change the surface most.
    """
    if contacts <= 2:
        return []
    first = min(_FIRST, contacts - 1)
    counts = {round(first * (contacts / first) ** (k / _STEPS)) for k in range(_STEPS)}
    return sorted(count for count in counts if count < contacts)


def watched_steps(
    steps: Iterator[tuple[ExplorationState, FloatArray | None, Disturbance | None]],
    log: TouchLog,
    agent: Agent,
    header: str,
    stage: StageProgress,
) -> tuple[ExplorationState, FloatArray | None, Disturbance | None]:
    """Write the log and some intermediate estimates, report the progress, and return the end.

    Each step is a state with the true pose of a free object, and what touches did so far to the
    bodies beside it.
    """
    state, X_EO, disturbance = next(
        steps
    )  # after the recorded probes; the last may lack its estimate
    kept = Exploration.replay(state.observations[:-1], touches=agent.decide.touches).made
    counts = growth_counts(agent.decide.touches)
    while not state.ended:
        made = state.made
        last = state.observations[-1] if state.observations else None
        if last is not None and (last.is_lost or last.is_joined):
            stage.note(last.outcome.reason)
        stage.count(made, agent.decide.touches)
        if state.surface is not None and state.is_new:
            # One touch can make several contacts and so pass a count.
            if made < agent.decide.touches and any(kept < count <= made for count in counts):
                with suppress(EstimationError, InvalidMeshError):  # too few for a surface
                    surface = SurfaceEstimate(state.touched, agent.perception).surface
                    cell = float(np.ptp(surface.bounds, axis=0).max()) / _CELLS
                    mesh = extract_mesh(surface, resolution=cell)
                    save_growth(log.path.parent, len(state.contacts), mesh, header)
            kept = made
        before = disturbance
        state, X_EO, disturbance = next(steps)
        if not state.ended:
            same = disturbance is None or disturbance.equals(before)
            log.append(state.observations[-1], X_EO, None if same else disturbance)
    return state, X_EO, disturbance
