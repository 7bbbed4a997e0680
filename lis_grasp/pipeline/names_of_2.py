"""Names of version 2.0 with other signatures than today's; they resolve until 4.0."""

from __future__ import annotations

from typing import Any

import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.task.robot import REAL_SENSOR as REAL_SENSOR
from lis_grasp.task.task import IDEAL_SENSOR as IDEAL_SENSOR
from lis_grasp.task.task import KNOWN, PARTS, Task, task_options
from lis_grasp.task.world import PROBERS as PROBERS
from lis_grasp.task.world import SIMULATORS as SIMULATORS

UNKNOWN = {name: value for name, value in Task().facts().items() if name in KNOWN}
"""The conditions without ``--known``, by option; today the defaults of `Task`."""

CONDITIONS = {"known": KNOWN, "unknown": UNKNOWN}
"""The conditions with and without ``--known``, by name."""


class RunConfig(Task):
    """A `Task` of options by name whose defaults are those of ``--known``; use `Task.of`.

    Examples
    --------
    >>> RunConfig("mallet", hand="wsg50").touches
    40
    """

    def __init__(self, object: Any = None, **options: Any) -> None:
        given = options if object is None else {"object": object, **options}
        parts = {
            name: given.pop(name)
            for name, part in PARTS.items()
            if isinstance(given.get(name), part)
        }
        start = Task(**parts) if parts else Task.of(**KNOWN)
        task = start.having(**given)
        super().__init__(task.world, task.robot, task.known, task.decide, task.seed)

    def __getattr__(self, name: str) -> Any:
        if name in task_options():
            value = self.facts()[name]
            return tuple(value) if isinstance(value, list) else value
        return super().__getattr__(name)  # type: ignore[misc]


def perception(*, table: float | None = None, **settings: Any) -> Perception:
    """Return the settings of an estimate, with the table's height by its name in 2.0.

    Examples
    --------
    >>> pipeline.Perception(estimator="gpis").free_space
    True
    """
    return Perception(**{"support_height": table, **settings})


def estimate_and_mesh(
    known: Perception | Agent, contacts: Contacts
) -> tuple[ImplicitSurface, trimesh.Trimesh]:
    """Return the surface of contacts and its mesh, as `SurfaceEstimate` has them.

    Examples
    --------
    >>> surface, mesh = pipeline.estimate(pipeline.Perception(estimator="gpis"), contacts)
    >>> mesh.is_watertight
    True
    """
    made = SurfaceEstimate(contacts, known.perception if isinstance(known, Agent) else known)
    return made.surface, made.mesh
