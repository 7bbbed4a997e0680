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

from typing import TYPE_CHECKING

from lis_grasp._moved import module_names

if TYPE_CHECKING:
    from lis_grasp.pipeline._run import Run as Run
    from lis_grasp.pipeline._run import run as run
    from lis_grasp.pipeline.contact_sources import ContactSource as ContactSource
    from lis_grasp.pipeline.exploring import explore_object as explore_object
    from lis_grasp.pipeline.file_stages import estimate_file as estimate_file
    from lis_grasp.pipeline.file_stages import grasp_file as grasp_file
    from lis_grasp.pipeline.file_stages import lift_file as lift_file
    from lis_grasp.pipeline.known import Known as Known
    from lis_grasp.pipeline.known import Perception as Perception
    from lis_grasp.pipeline.labels import label_file as label_file
    from lis_grasp.pipeline.lifting_stage import lift as lift
    from lis_grasp.pipeline.lifting_stage import lift_each as lift_each
    from lis_grasp.pipeline.progress import SILENT as SILENT
    from lis_grasp.pipeline.progress import Progress as Progress
    from lis_grasp.pipeline.run_config import RunConfig as RunConfig
    from lis_grasp.pipeline.run_scene import Watched as Watched
    from lis_grasp.pipeline.scenario import Scenario as Scenario
    from lis_grasp.pipeline.scenario import Truth as Truth
    from lis_grasp.pipeline.stages import estimate as estimate
    from lis_grasp.pipeline.stages import plan as plan
    from lis_grasp.pipeline.stages import touch as touch

_HOMES = {
    "_run": "Run run",
    "contact_sources": "ContactSource",
    "exploring": "explore_object",
    "file_stages": "estimate_file grasp_file lift_file",
    "known": "Known Perception",
    "labels": "label_file",
    "lifting_stage": "lift lift_each",
    "progress": "SILENT Progress",
    "run_config": "RunConfig",
    "run_scene": "Watched",
    "scenario": "Scenario Truth",
    "stages": "estimate plan touch",
}

__all__ = " ".join(_HOMES.values()).split()
__getattr__, __dir__ = module_names(__name__, __all__, _HOMES)
