"""Shapes touched at a known place with a noisy sensor, and the mesh of each estimator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import trimesh

from lis_grasp import Contacts, Hand, pipeline
from lis_grasp.exploration import Exploration
from lis_grasp.shapes import Shape
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.stages.scenario import Scenario
from lis_grasp.task.task import Task

HULL, TRUTH = "hull", "truth"
"""In place of an estimator: the convex hull of the contacts, the true mesh."""

COUNTS = (20, 40)
"""Numbers of contacts."""

NOISE: Mapping[str, float] = {"position_noise": 0.0005, "normal_noise": float(np.radians(3.0))}
"""Of the sensor: options of `Task.of`."""

_HAND = "allegro"


def scenario_of(shape: Shape, seed: int, **options: Any) -> Scenario:
    """Return the scenario of a shape that is fixed at its place, which is known.

    `options` are those of `Task.of` in place of the usual ones.
    """
    entropy = [seed, *shape.name.encode()]
    usual: dict[str, Any] = {
        "hand": _HAND,
        "prober": "kinematic",
        "known": True,
        "touches": max(COUNTS),
        "seed": int(np.random.SeedSequence(entropy).generate_state(1)[0]),
        **NOISE,
    }
    task = Task.of(**(usual | options))
    return Scenario.from_config(task, shape, Hand.load(task.robot.hand))


def touched(shape: Shape, seed: int, **options: Any) -> Contacts:
    """Return the contacts of a shape; see `scenario_of`."""
    found: Exploration = pipeline.touch(scenario_of(shape, seed, **options))
    return found.contacts


def estimated_mesh(estimator: str, shape: Shape, contacts: Contacts) -> trimesh.Trimesh:
    """Return the mesh of an estimator, of the hull, or the true one."""
    if estimator == TRUTH:
        return shape.mesh
    if estimator == HULL:
        return trimesh.convex.convex_hull(contacts.points)
    task = Task.of(estimator=estimator, known=True, **NOISE)
    settings = Perception.of(task.robot, task.decide, None)
    return SurfaceEstimate(contacts, settings).mesh
