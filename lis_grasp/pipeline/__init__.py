"""The pipeline from touch to lift: each stage as one function, and its configuration.

Stages take the records `Scenario` and `Known`, which a configuration makes. The functions
`lis_grasp.estimate`, `explore`, `plan` and `lift` make them from contacts, objects and hands.

Examples
--------
>>> scenario = pipeline.Scenario.from_config(RunConfig("box", hand="wsg50"))
>>> _, mesh = pipeline.estimate(scenario.known, contacts)
>>> mesh.is_watertight
True
"""

from typing import Any

from lis_grasp._moved import new_place
from lis_grasp.pipeline.contact_sources import ContactSource, join_sources, load_source
from lis_grasp.pipeline.exploring import explore_object
from lis_grasp.pipeline.file_stages import estimate_file, grasp_file, lift_file
from lis_grasp.pipeline.following import Watched
from lis_grasp.pipeline.known import Known, Perception
from lis_grasp.pipeline.labels import label_file
from lis_grasp.pipeline.lifting_stage import lift, lift_each, require_simulator
from lis_grasp.pipeline.progress import SILENT, Progress
from lis_grasp.pipeline.run import Run, run
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.scenario import Scenario, Truth, place_object, workspace
from lis_grasp.pipeline.stages import (
    Stopwatch,
    estimate,
    make_estimator,
    make_policy,
    make_prober,
    plan,
    touch,
)

__all__ = [
    "SILENT",
    "ContactSource",
    "Known",
    "Perception",
    "Progress",
    "Run",
    "RunConfig",
    "Scenario",
    "Stopwatch",
    "Truth",
    "Watched",
    "estimate",
    "estimate_file",
    "explore_object",
    "grasp_file",
    "join_sources",
    "label_file",
    "lift",
    "lift_each",
    "lift_file",
    "load_source",
    "make_estimator",
    "make_policy",
    "make_prober",
    "place_object",
    "plan",
    "require_simulator",
    "run",
    "touch",
    "workspace",
]


def __getattr__(name: str) -> Any:
    """Say where a name of version 1.4 is now."""
    place = new_place(f"{__name__}.{name}") or f"module '{__name__}' has no attribute '{name}'"
    raise AttributeError(place)


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
