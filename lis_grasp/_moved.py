"""Old names: modules of 2.0 that resolve until 4.0, and sentences for those of 1.x."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pkgutil import resolve_name
from types import MappingProxyType, ModuleType
from typing import Any

# Modules of 2.0, and names of its packages, with their places now. They resolve until 4.0.
MOVED = {
    "lis_grasp.logs.detection": "lis_grasp.exploration.touch_detection",
    "lis_grasp.pipeline.conditions": "lis_grasp.pipeline.names_of_2",
    "lis_grasp.pipeline.contact_sources": "lis_grasp.stages.contact_sources",
    "lis_grasp.pipeline.dexgraspbench": "lis_grasp.exports.dexgraspbench",
    "lis_grasp.pipeline.exploring": "lis_grasp.results.exploring",
    "lis_grasp.pipeline.known": "lis_grasp.stages.agent",
    "lis_grasp.pipeline.labels": "lis_grasp.results.labels",
    "lis_grasp.pipeline.lifting_stage": "lis_grasp.stages.lift",
    "lis_grasp.pipeline.next_touch": "lis_grasp.stages.next_touch",
    "lis_grasp.pipeline.object_models": "lis_grasp.exports.object_models",
    "lis_grasp.pipeline.option": "lis_grasp.io.option",
    "lis_grasp.pipeline.progress": "lis_grasp.results.progress",
    "lis_grasp.pipeline.regrasp": "lis_grasp.stages.regrasp",
    "lis_grasp.pipeline.report_json": "lis_grasp.results.report",
    "lis_grasp.pipeline.results": "lis_grasp.results.run_results",
    "lis_grasp.pipeline.results_folder": "lis_grasp.results.folder",
    "lis_grasp.pipeline.run_config": "lis_grasp.pipeline.names_of_2",
    "lis_grasp.pipeline.run_scene": "lis_grasp.results.page",
    "lis_grasp.pipeline.scenario": "lis_grasp.stages.scenario",
    "lis_grasp.pipeline.stages": "lis_grasp.stages.touch",
    "lis_grasp.pipeline.summary": "lis_grasp.results.summary",
    "lis_grasp.pipeline.touch_service": "lis_grasp.service.touch_service",
    "lis_grasp.robots.joint_frames": "lis_grasp.logs.joint_frames",
    "lis_grasp.surfaces.CarvedImplicitSurface": (
        "lis_grasp.surfaces.carved_implicit_surface.Remainder"
    ),
}

# Names of 1.x, without the name of the package, and where they are now.
_PLACES = {
    "arms.arm": "lis_grasp.robots.arm",
    "arms.arm_check": "lis_grasp.arms.check",
    "arms.arm_ik": "lis_grasp.robots.pose_ik",
    "arms.arm_kinematics": "lis_grasp.robots.kinematics",
    "arms.arm_mount": "lis_grasp.arms.mounted_hand",
    "arms.grasp_motion": "lis_grasp.arms.transit",
    "arms.base_search": "lis_grasp.arms.placement",
    "arms.joint_trajectory": "lis_grasp.arms.trajectory",
    "arms.probe_reach": "lis_grasp.arms.reach",
    "arms.reach_filter": "lis_grasp.arms.reach",
    "arms.station_collision": "lis_grasp.arms.collision",
    "arms.time_scaling": "lis_grasp.arms.trajectory",
    "evaluation.calibration": "lis_grasp_studies.harness.calibration",
    "experiments": (
        "the package lis_grasp_studies, in which runner, statistics, trial_results and report_page"
        " are in lis_grasp_studies.harness, study_trial is lis_grasp_studies.study.run, and files"
        " do not repeat the names of their folders"
    ),
    "exploration.ExplorationSetup": (
        "lis_grasp.exploration.TactilePerception and ExplorationStrategy"
    ),
    "exploration.Finger": "lis_grasp.logs.Finger",
    "exploration.LogFrames": "lis_grasp.logs.LogFrames",
    "exploration.TouchDetection": "lis_grasp.logs.TouchDetection",
    "exploration.contacts_from_log": "lis_grasp.logs.contacts_from_log",
    "exploration.open_log": "lis_grasp.logs.open_log",
    "grasping.isaac_grasps": "lis_grasp.grasping.export",
    "grasping.grasp_ranking": "lis_grasp.grasping.grasp_quality",
    "hands": (
        "lis_grasp.robots, in which hand_mjcf is mjcf and hand_schema is schema; Hand itself is"
        " lis_grasp.Hand, and the names are lis_grasp.robots.shipped_models.HAND_NAMES"
    ),
    "lifting.lift_outcome": "lis_grasp.lifting.outcome",
    "mujoco_simulation": "lis_grasp.simulation.mujoco.lift",
    "pipeline.Stopwatch": "lis_grasp.results.progress.Stopwatch",
    "pipeline.join_sources": "lis_grasp.stages.contact_sources.join_sources",
    "pipeline.load_source": "lis_grasp.stages.contact_sources.load_source",
    "pipeline.make_estimator": "lis_grasp.stages.estimate.Perception.make",
    "pipeline.make_policy": "lis_grasp.stages.touch.make_policy",
    "pipeline.require_simulator": "lis_grasp.stages.lift.require_simulator",
    "pipeline.workspace": "lis_grasp.stages.scenario.known_place",
    "pipeline.make_station": "Scenario.agent.station of lis_grasp.pipeline",
    "pipeline.support_height": "Scenario.agent.support_height of lis_grasp.pipeline",
    "pipeline.object_setup": "lis_grasp.stages.scenario",
    "pipeline.plugged_in": "lis_grasp.surfaces.estimators and lis_grasp.exploration.policy",
    "pipeline.pose_of": "Scenario.truth.X_WO of lis_grasp.pipeline",
    "pipeline.prior_knowledge": "Scenario.agent.space of lis_grasp.pipeline",
    "pipeline.table_of": "Scenario.agent.perception.support_height of lis_grasp.pipeline",
    "pipeline.touching": "lis_grasp.stages.touch",
    "shapes.convex_parts": "lis_grasp.shapes.solids",
    "simulation.dynamic_prober": "lis_grasp.simulation.drake.dynamic_prober",
    "simulation.probing_scene": "lis_grasp.simulation.drake.object_plant",
    "simulation.simulate_lift": "lis_grasp.simulation.drake.lift",
    "surfaces.contact_thinning": "lis_grasp.surfaces.contact_preparation",
    "surfaces.gaussian_process": "lis_grasp.surfaces.gaussian_process_implicit_surface",
    "surfaces.noise_estimation": "lis_grasp.surfaces.contact_preparation",
    "visualization.run_scene": "lis_grasp.results.page",
}


def new_place(name: str) -> str | None:
    """Return a sentence that says where a name of 1.x is now; None if it is no such name."""
    place = _PLACES.get(name.removeprefix("lis_grasp."))
    return None if place is None else f"{name} is now {place}"


def module_names(
    module: str, names: Sequence[str], homes: Mapping[str, str] = MappingProxyType({})
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package, whose old names resolve.

    `homes` are modules of `lis_grasp`, each with the names that are loaded from it on first use.
    A name of 1.x raises `AttributeError` with its new place.
    """

    def get(name: str) -> Any:
        full = f"{module}.{name}"
        if full in MOVED:
            return resolve_name(MOVED[full])
        for home in homes:
            if name in (home, *homes[home].split()):
                loaded = import_module(f"lis_grasp.{home}")
                return loaded if name == home else getattr(loaded, name)
        if not name.startswith("_") and new_place(full) is None and find_spec(full):
            return import_module(full)  # a folder that no one has imported yet
        raise AttributeError(
            new_place(full) or _unknown(module, name, names), name=name, obj=sys.modules[module]
        )

    return get, lambda: sorted(names)


def _unknown(module: str, name: str, names: Sequence[str]) -> str:
    """Return the sentence of a name that a module has not, with what it has in its place."""
    from lis_grasp.guesses import advice_or_all  # its imports take a third of the package's

    # Programs ask for special names, such as __wrapped__.
    end = "" if name.startswith("_") else advice_or_all((module,), name, names)
    return f"module '{module}' has no attribute '{name}'{end}"


class OldModules:
    """Finder and loader of modules by their old names.

    A module of 2.0 is loaded from its place of today, and is the same module under both names. One
    of 1.x raises `ModuleNotFoundError` with its new place.
    """

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a module of 2.0 that moved; None for one that did not."""
        if name in MOVED:
            return ModuleSpec(name, cls)  # type: ignore[arg-type]
        if name.startswith("lis_grasp.") and (place := new_place(name)):
            # Without the attribute `name`, the sentence passes through `from package import name`.
            raise ModuleNotFoundError(place)
        return None

    @staticmethod
    def create_module(spec: ModuleSpec) -> None:
        """Leave the making of a module to Python."""

    @staticmethod
    def exec_module(module: ModuleType) -> None:
        """Put the module of today into the place of an old name."""
        sys.modules[module.__name__] = import_module(MOVED[module.__name__])
