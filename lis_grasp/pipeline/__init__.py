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

from lis_grasp._moved import module_names
from lis_grasp.pipeline.contact_sources import ContactSource
from lis_grasp.pipeline.exploring import explore_object
from lis_grasp.pipeline.file_stages import estimate_file, grasp_file, lift_file
from lis_grasp.pipeline.known import Known, Perception
from lis_grasp.pipeline.labels import label_file
from lis_grasp.pipeline.lifting_stage import lift, lift_each
from lis_grasp.pipeline.progress import SILENT, Progress
from lis_grasp.pipeline.run import Run, run
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.run_scene import Watched
from lis_grasp.pipeline.scenario import Scenario, Truth
from lis_grasp.pipeline.stages import (
    estimate,
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
    "Truth",
    "Watched",
    "estimate",
    "estimate_file",
    "explore_object",
    "grasp_file",
    "label_file",
    "lift",
    "lift_each",
    "lift_file",
    "plan",
    "run",
    "touch",
]

__getattr__, __dir__ = module_names(__name__, __all__)
