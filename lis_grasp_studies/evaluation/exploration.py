"""Experiment: what is known after so many touches of an unknown object, by policy and with slides.

Touches are made by geometry alone, of fixed objects of which nothing is known: in a stable pose in
a region of a table, with a realistic sensor.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
import trimesh

from lis_grasp import Hand, pipeline
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.evaluation.touch_coverage import reachable_coverage, touch_radius
from lis_grasp.exploration import begin
from lis_grasp.exploration.strategy import end
from lis_grasp.io.json_lines import Row
from lis_grasp.stages.scenario import place_object
from lis_grasp.stages.touch import make_perception, make_strategy
from lis_grasp.task.task import Task
from lis_grasp.typing import FloatArray
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.study.trial import Setup, find_object

HAND, TIP_RADIUS = "allegro", 0.012
SLIDES, SLIDE = ", slides", 0.03
"""After the name of a policy: a slide so long [m] follows each touch."""
FAR_OFF = 0.02
"""Error from which an end of the object counts as missed [m]."""


@dataclass(frozen=True, slots=True)
class ExplorationTrial:
    """One exploration, measured after each of some numbers of touches."""

    object: str
    """Name of a built-in shape or test object."""
    seed: int
    touches: str
    """Numbers of touches, joined by spaces."""


def measure_exploration(trial: ExplorationTrial, policy: str) -> list[Row]:
    """Return a row for each number of touches of one exploration."""
    counts = [int(word) for word in trial.touches.split()]
    entropy = [trial.seed, *trial.object.encode()]
    task = Task.of(
        hand=HAND,
        prober="kinematic",
        policy=policy.removesuffix(SLIDES),
        slide=SLIDE if policy.endswith(SLIDES) else 0.0,
        touches=max(counts),
        seed=int(np.random.SeedSequence(entropy).generate_state(1)[0]),
    )
    shape, _ = place_object(find_object(trial.object, Setup()), task)
    scenario = pipeline.Scenario.from_config(task, shape, Hand.load(HAND), recorded={"X_EO": None})
    observations, rows = pipeline.touch(scenario).observations, []
    perception, strategy = make_perception(scenario.agent.perception), make_strategy(scenario.agent)
    for count in counts:
        part_of = replace(strategy, touches=count)
        part = end(part_of, begin(perception, part_of, observations), "").result
        _, mesh = pipeline.estimate(scenario.agent, part.contacts)
        error, ends = surface_error(mesh, shape, samples=2000), end_errors(mesh, shape.mesh)
        coverage = reachable_coverage(
            shape.mesh,
            part.contacts,
            tip_radius=TIP_RADIUS,
            radius=touch_radius(shape.mesh),
            support_height=0.0,
        )
        rows.append(
            {
                "count": count,
                "coverage": coverage,
                "end": float(ends.max()),
                "far_off": float(np.mean(ends > FAR_OFF)),
                "rmsd": error.rmsd,
                "rmsd_truth_to_estimate": error.rmsd_truth_to_estimate,
                "contacts": len(part.contacts),
                "probes": len(part.outcomes),
                "seconds": part.duration,
            }
        )
    return rows


def end_errors(estimate: trimesh.Trimesh, truth: trimesh.Trimesh) -> FloatArray:
    """Return the errors of both ends along the truth's longest axis, shape (2,) [m]."""
    X, extents = trimesh.bounds.oriented_bounds(truth)
    axis = X[int(np.argmax(extents)), :3]
    of_estimate, of_truth = estimate.vertices @ axis, truth.vertices @ axis
    errors = [of_estimate.min() - of_truth.min(), of_estimate.max() - of_truth.max()]
    return np.abs(errors)


EXPLORATION = Experiment("exploration", measure_exploration, asdict, variant="policy")
"""The experiment; its variants are policies."""
