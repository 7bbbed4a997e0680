"""Preparation of a run: its scenario, or a refusal before work if the run is impossible."""

from __future__ import annotations

from lis_grasp.results.notes import say_object
from lis_grasp.results.progress import Progress
from lis_grasp.robots.inertias import require_possible_inertias
from lis_grasp.stages.lift import require_simulator
from lis_grasp.stages.place import with_place
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.surroundings import require_apart
from lis_grasp.task.task import Task


def require_runnable(task: Task) -> None:
    """Raise `InvalidOptionError` for slides that are not permitted."""
    task.require_slides()


def prepared(task: Task, progress: Progress) -> Scenario:
    """Return the scenario of a run, and report what is odd about its object.

    Raises the errors of `Scenario.from_config`, of a corner where the object is, of a hand that
    Drake cannot simulate and of a simulator that is not installed.
    """
    scenario = Scenario.from_config(task)
    say_object(scenario, progress)
    require_possible_inertias(scenario.agent.hand)
    truth = with_place(scenario).truth
    require_apart(truth.surroundings, truth.shape)
    require_simulator(task.world.simulator, truth.shape, truth.surroundings)
    return scenario
