"""Where names of version 1.4 are now, and what guessed names stand for, in sentences."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from types import MappingProxyType, ModuleType
from typing import Any

from lis_grasp.exceptions import nearest_or_all

_PLACES = {
    "arms.arm": "lis_grasp.robots.arm",
    "arms.arm_check": "lis_grasp.arms.check",
    "arms.arm_ik": "lis_grasp.robots.pose_ik",
    "arms.arm_kinematics": "lis_grasp.robots.kinematics",
    "arms.arm_mount": "lis_grasp.arms.station",
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
    "mujoco_simulation": "lis_grasp.simulation.mujoco, in which simulate_in_mujoco is lift",
    "pipeline.Stopwatch": "lis_grasp.stages.touch.Stopwatch",
    "pipeline.join_sources": "lis_grasp.stages.contact_sources.join_sources",
    "pipeline.load_source": "lis_grasp.stages.contact_sources.load_source",
    "pipeline.make_estimator": "lis_grasp.stages.touch.make_estimator",
    "pipeline.make_policy": "lis_grasp.stages.touch.make_policy",
    "pipeline.require_simulator": "lis_grasp.stages.lift.require_simulator",
    "pipeline.workspace": "lis_grasp.stages.scenario.workspace",
    "pipeline.make_station": "Scenario.known.station of lis_grasp.pipeline",
    "pipeline.support_height": "Scenario.known.support of lis_grasp.pipeline",
    "pipeline.object_setup": "lis_grasp.stages.scenario",
    "pipeline.plugged_in": "lis_grasp.surfaces.estimators and lis_grasp.exploration.policy",
    "pipeline.pose_of": "Scenario.truth.X_WO of lis_grasp.pipeline",
    "pipeline.prior_knowledge": "Scenario.known.space of lis_grasp.pipeline",
    "pipeline.table_of": "Scenario.known.table of lis_grasp.pipeline",
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

# What guessed names and members stand for, in lower case, as the end of a message.
ADVICE = {
    name: f": write {call}"
    for names, call in {
        "blend fit gpis lis patch smooth": "estimate(contacts, method), as 'gpis' or 'lis'",
        "draw plot scene() show view visualize": "Scene(estimate=..., contacts=...).save(path)",
        "explore_object explorer sample_contacts touch": "explore(object, hand).contacts",
        "grasp grasp_planner graspplanner plan_grasps planner": "plan(mesh, hand)",
        "hand.list hand.names hand_names hands list_hands load_hand": "Hand.load('allegro')",
        "grasp.lift lift_object simulate simulate_lift": "lift(object, hand, grasp)",
        "load load_mesh load_object load_shape": "load_contacts(path) or shapes.find(name)",
        "arm load_arm load_grasps": "robots.arm.Arm.load(name) or GraspSearch.load(path)",
        "from_folder load_results load_run results": "Run.load(folder)",
        "extract_mesh marching_cubes mesh reconstruct_mesh to_mesh": "extract_mesh(surface)",
        "next_probe next_touch": "exploration.choose(...), or run `lis-grasp next`",
        "contacts.to_csv contacts.to_ply save_contacts": "contacts.save(path)",
        "save_mesh surface.save": "extract_mesh(surface).export(path)",
        "chamfer chamfer_distance compare evaluate": "surface_error(mesh, truth)",
        "ferrari_canny": "epsilon_quality(points, normals, friction=0.5)",
        "shape_names": "shapes.NAMES",
        "estimator estimators register_estimator": "surfaces.ESTIMATORS, or 'my.module:Class'",
        "policies policy": "exploration.POLICIES, or 'my.module:Class'",
        "contacts.concatenate contacts.extend contacts.merge": "append(contacts)",
        "contacts.positions contacts.xyz": "points",
        "grasp.contacts": "contact_points",
        "grasp.score": "epsilon or success_probability",
        "from_arrays from_numpy from_points": (
            "Contacts(points, normals), or surfaces.estimate_normals(points)"
        ),
        "contacts.from_csv contacts.from_file contacts.from_ply": "load_contacts(path)",
        "contacts() pointcloud": "load_contacts(path), or surfaces.estimate_normals(points)",
        "hand.from_file hand.from_urdf hand.from_yaml": (
            "Hand.load(path) of a YAML file, which `lis-grasp hand new FILE` writes"
        ),
        "runconfig.from_file runconfig.from_yaml": "RunConfig.from_facts(yaml.safe_load(text))",
        "shape() shape.from_file shape.load": (
            "shapes.load(path), or shapes.build(name), or Shape.from_mesh(mesh)"
        ),
        "distance sdf signed_distance": "evaluate(points): negative inside, 0 on the surface",
        "normal normals": "gradient(points)",
        "std variance": "uncertainty(points)",
    }.items()
    for name in names.split()
}


def new_place(name: str) -> str | None:
    """Return a sentence that says where a module or name is now; None if it did not move."""
    place = _PLACES.get(name.removeprefix("lis_grasp."))
    return None if place is None else f"{name} is now {place}"


def module_names(
    module: str, names: Sequence[str], homes: Mapping[str, str] = MappingProxyType({})
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package, which say where a name of 1.4 is now.

    `homes` are its modules, each with the names that are loaded from it on first use.
    """

    def get(name: str) -> Any:
        for home in homes:
            if name in (home, *homes[home].split()):
                loaded = import_module(f"{module}.{home}")
                return loaded if name == home else getattr(loaded, name)
        advice = "" if name.startswith("_") else nearest_or_all(name, names)
        place = new_place(f"{module}.{name}")
        raise AttributeError(place or f"module '{module}' has no attribute '{name}'{advice}")

    return get, lambda: sorted(names)


class MovedModules:
    """Finder that raises `ModuleNotFoundError` with the new place of a module that moved."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> None:
        """Raise for a module that moved; find none otherwise."""
        place = new_place(name) if name.startswith("lis_grasp.") else None
        if place is not None:
            # Without the attribute `name`, the sentence passes through `from package import name`.
            raise ModuleNotFoundError(place)
