"""The pipeline from touch to lift: each stage as one function, and its configuration."""

from lis_grasp.pipeline.arm_station import make_station
from lis_grasp.pipeline.contact_sources import join_sources, load_source
from lis_grasp.pipeline.lifting_stage import lift, lift_each, require_simulator
from lis_grasp.pipeline.object_setup import pose_of, support_height, table_of
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.stages import Stopwatch, estimate, make_estimator, plan
from lis_grasp.pipeline.touching import make_policy, prior_knowledge, touch, workspace

__all__ = [
    "RunConfig",
    "Stopwatch",
    "estimate",
    "join_sources",
    "lift",
    "lift_each",
    "load_source",
    "make_estimator",
    "make_policy",
    "make_station",
    "plan",
    "pose_of",
    "prior_knowledge",
    "require_simulator",
    "support_height",
    "table_of",
    "touch",
    "workspace",
]
