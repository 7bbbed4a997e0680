"""Motion of a free object during an exploration: true against tracked, for reports."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh

from lis_grasp.exploration import Exploration
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh

# Points of the true surface that measure the tracking error.
_SAMPLES = 2000


def motion_facts(shape: Shape, exploration: Exploration) -> dict[str, Any] | None:
    """Return how far touches moved a free object, and how well that was tracked, as plain values.

    `displacement` [m] is that of the centre of its box in all, `largest_motion` [m] that of any
    point by one touch. `tracking_error` [m] is the mean distance of the true surface from the same
    surface where the object is believed to be: 0 for motions that leave the surface in place. It is
    None after a loss, which begins another frame. `contact_error` [m] is the root mean square
    distance of the contacts from the true surface where it is now. None for a fixed object.
    """
    X_EO = exploration.simulated_pose
    if X_EO is None:
        return None
    beliefs = [outcome.tracked for outcome in exploration.outcomes if outcome.tracked is not None]
    X_WE = beliefs[-1].X_WE if beliefs else np.eye(4)
    center = shape.mesh.bounds.mean(axis=0)
    moved = trimesh.transform_points(center[None], X_WE @ X_EO)[0] - center
    points, _ = trimesh.sample.sample_surface(shape.mesh, _SAMPLES, seed=0)
    off, _ = distances_to_mesh(apply_pose(X_EO, points), shape.mesh)
    now = apply_pose(inverse_pose(X_EO), exploration.contacts.points)
    misplaced = distances_to_mesh(now, shape.mesh)[0] if len(now) else None
    losses = sum(belief.trust == "lost" for belief in beliefs)
    return {
        "displacement": float(np.linalg.norm(moved)),
        "largest_motion": max(outcome.moved for outcome in exploration.outcomes),
        "tracked": bool(beliefs),
        "tracking_error": None if losses else float(off.mean()),
        "contact_error": None if misplaced is None else float(np.sqrt(np.mean(misplaced**2))),
        "repeated_probes": sum(belief.repeated for belief in beliefs),
        "losses": losses,
    }


def motion_line(facts: dict[str, Any]) -> str:
    """Return the sentence about `motion_facts`."""
    line = (
        f"moved     ended {1e3 * facts['displacement']:.1f} mm from where it was; one touch moved"
        f" it by {1e3 * facts['largest_motion']:.1f} mm"
    )
    if facts["tracking_error"] is not None:
        tracked = "tracked to" if facts["tracked"] else "not tracked, off by"
        line += f"; {tracked} {1e3 * facts['tracking_error']:.2f} mm"
    if facts["contact_error"] is not None:
        line += f"; contacts are {1e3 * facts['contact_error']:.2f} mm off its surface"
    repeated, losses = facts["repeated_probes"], facts["losses"]
    if repeated:
        line += f"; {repeated} probe{'s' * (repeated > 1)} repeated to track it"
    if losses:
        line += f"; lost {losses} time{'s' * (losses > 1)}, earlier contacts dropped"
    return line
