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
    from lis_grasp.results.exploring import explore_object as explore_object
    from lis_grasp.results.file_stages import estimate_file as estimate_file
    from lis_grasp.results.file_stages import grasp_file as grasp_file
    from lis_grasp.results.file_stages import lift_file as lift_file
    from lis_grasp.results.labels import label_file as label_file
    from lis_grasp.results.page import Watched as Watched
    from lis_grasp.results.progress import SILENT as SILENT
    from lis_grasp.results.progress import Progress as Progress
    from lis_grasp.results.run_results import Run as Run
    from lis_grasp.results.whole_run import run as run
    from lis_grasp.stages.agent import Known as Known
    from lis_grasp.stages.agent import Perception as Perception
    from lis_grasp.stages.contact_sources import ContactSource as ContactSource
    from lis_grasp.stages.lift import lift as lift
    from lis_grasp.stages.lift import lift_each as lift_each
    from lis_grasp.stages.scenario import Scenario as Scenario
    from lis_grasp.stages.scenario import Truth as Truth
    from lis_grasp.stages.touch import estimate as estimate
    from lis_grasp.stages.touch import plan as plan
    from lis_grasp.stages.touch import touch as touch
    from lis_grasp.task.run_config import RunConfig as RunConfig

_HOMES = {
    "results.exploring": "explore_object",
    "results.file_stages": "estimate_file grasp_file lift_file",
    "results.labels": "label_file",
    "results.page": "Watched",
    "results.progress": "SILENT Progress",
    "results.run_results": "Run",
    "results.whole_run": "run",
    "stages.agent": "Known Perception",
    "stages.contact_sources": "ContactSource",
    "stages.lift": "lift lift_each",
    "stages.scenario": "Scenario Truth",
    "stages.touch": "estimate plan touch",
    "task.run_config": "RunConfig",
}

__all__ = " ".join(_HOMES.values()).split()
__getattr__, __dir__ = module_names("lis_grasp", __all__, _HOMES)
