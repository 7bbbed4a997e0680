"""The face of 2.0: its names of stages and records, which resolve until 4.0.

New code uses `lis_grasp.run`, `explore`, `estimate`, `plan` and `lift`, which take objects, hands
and contacts, and `lis_grasp.Task` and its records.

Examples
--------
>>> scenario = pipeline.Scenario.from_config(Task.of("box", hand="wsg50"))
>>> _, mesh = pipeline.estimate(scenario.agent, contacts)
>>> mesh.is_watertight
True
"""

from importlib import import_module
from pkgutil import resolve_name
from typing import Any

from lis_grasp._moved import MOVED

_HOMES = {
    "Bars": "results.progress_bars",
    "ContactSource": "stages.contact_sources",
    "Known": "stages.agent.Agent",
    "Perception": "pipeline.names_of_2.perception",
    "Progress": "results.progress",
    "Run": "results.run_results",
    "RunConfig": "pipeline.names_of_2",
    "SILENT": "results.progress",
    "Scenario": "stages.scenario",
    "SurfaceEstimate": "stages.estimate",
    "Truth": "stages.scenario",
    "Watched": "results.live_page",
    "estimate": "pipeline.names_of_2.estimate_and_mesh",
    "estimate_file": "results.estimated_file",
    "explore_object": "results.exploring",
    "grasp_file": "results.grasped_file",
    "label_file": "results.labels",
    "lift": "stages.lift.lift_object",
    "lift_each": "stages.lift",
    "lift_file": "results.lifted_file",
    "plan": "stages.plan.plan_grasps",
    "run": "results.whole_run.run_task",
    "touch": "stages.touch",
}

__all__ = sorted(_HOMES)
__dir__ = sorted(_HOMES).copy


def __getattr__(name: str) -> Any:
    """Load a name from its home on first use (PEP 562)."""
    home, full = _HOMES.get(name), f"lis_grasp.pipeline.{name}"
    if full in MOVED:
        return resolve_name(MOVED[full])
    if home is None:
        raise AttributeError(f"module 'lis_grasp.pipeline' has no attribute '{name}'")
    room, _, last = home.rpartition(".")
    renamed = room.count(".") == 1  # the home names the object too
    module, member = (room, last) if renamed else (home, name)
    return getattr(import_module(f"lis_grasp.{module}"), member)
