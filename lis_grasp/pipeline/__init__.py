"""The pipeline from touch to lift: each stage as one function, and its configuration."""

from lis_grasp.pipeline.contact_sources import ContactSource, join_sources, load_source
from lis_grasp.pipeline.lifting_stage import lift, lift_each, require_simulator
from lis_grasp.pipeline.run_config import RunConfig, StopLimits
from lis_grasp.pipeline.scenario import (
    Known,
    Perception,
    Scenario,
    Truth,
    make_station,
    place_object,
    support_height,
    workspace,
)
from lis_grasp.pipeline.stages import Stopwatch, estimate, make_estimator, plan
from lis_grasp.pipeline.touching import make_policy, make_prober, touch

__all__ = [
    "ContactSource",
    "Known",
    "Perception",
    "RunConfig",
    "Scenario",
    "StopLimits",
    "Stopwatch",
    "Truth",
    "estimate",
    "join_sources",
    "lift",
    "lift_each",
    "load_source",
    "make_estimator",
    "make_policy",
    "make_prober",
    "make_station",
    "place_object",
    "plan",
    "require_simulator",
    "support_height",
    "touch",
    "workspace",
]
