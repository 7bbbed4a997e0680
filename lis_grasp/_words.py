"""Words of other libraries for functions, options and members of this one.

A user who writes `plan_grasps`, `mu=0.5` or `grasp.q` gets what is meant: the names of this package
alone are documented and completed, and what is written here is the only copy.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import partial, wraps
from pkgutil import resolve_name
from typing import Any, ParamSpec, TypeVar

from lis_grasp.exceptions import nearest_or_all

_P = ParamSpec("_P")
_R = TypeVar("_R")


def _lists(ours: Mapping[str, str]) -> dict[str, list[str]]:
    return {name: words.split() for name, words in ours.items()}


FUNCTIONS = {
    word: name
    for name, words in _lists(
        {
            "contacts.Contacts": "PointCloud Points",
            "surfaces.load_contacts": "load_points load_point_cloud read_contacts read_points",
            "stages.estimate.estimate": "fit reconstruct estimate_surface fit_surface",
            "meshing.extract_mesh": "mesh marching_cubes reconstruct_mesh to_mesh",
            "pipeline.direct.explore": "touch explore_object",
            "pipeline.direct.plan": "grasp find_grasps plan_grasp plan_grasps sample_grasps",
            "pipeline.direct.lift": "simulate simulate_lift simulate_grasp lift_object execute",
            "evaluation.surface_error.surface_error": "chamfer chamfer_distance compare_meshes",
            "grasping.epsilon.epsilon_quality": "ferrari_canny grasp_quality",
            "robots.arm.Arm": "Arm",
            "robots.arm.Arm.load": "load_arm",
            "robots.hand.Hand.load": "load_hand load_gripper",
            "robots.shipped_models.READY_HANDS": "hand_names HANDS list_hands",
            "results.run_results.Run.load": "load_run load_results load_result open_run",
            "grasping.grasps.GraspSearch.load": "load_grasps read_grasps",
            "io.surface_files.load_surface": "load_surface read_surface",
            "shapes.find": "load_mesh load_object load_shape",
            "shapes.NAMES": "objects object_names OBJECTS SHAPES list_objects",
            "surfaces.ESTIMATORS": "estimators ESTIMATORS list_estimators",
            "exploration.POLICIES": "policies POLICIES list_policies",
        }
    ).items()
    for word in words
}
"""Names of `lis_grasp` by other words: paths below the package."""

OPTIONS = _lists(
    {
        "estimator": "method model surface_model algorithm",
        "position_noise": "noise noise_std sigma point_noise",
        "normal_noise": "angle_noise normal_std",
        "support_height": "table table_height ground ground_height table_z",
        "touches": "n_touches num_touches max_touches number_of_touches n_contacts budget n count",
        "grasps": "n n_grasps num_grasps max_grasps number_of_grasps count top top_k",
        "friction": "mu friction_coefficient friction_coeff coulomb_friction",
        "hand": "gripper end_effector robot_hand hand_name",
        "arm": "robot robot_arm manipulator arm_name",
        "seed": "random_state random_seed rng_seed",
        "folder": "output output_dir out out_dir outdir save_to results_dir",
        "resolution": "voxel_size cell_size spacing voxel step",
        "units": "unit length_unit",
        "simulator": "sim backend engine physics",
        "object": "obj object_name shape",
    }
)
"""Options and parameters, with other words for each; some words are of several."""

MEMBERS = _lists(
    {
        "points": "positions xyz",
        "in_frame": "transform transformed apply_transform",
        "load": "from_file from_csv from_ply from_yaml from_urdf from_folder from_json read",
        "save": "to_csv to_ply to_file to_json write export",
        "append": "concatenate extend merge",
        "to_pandas": "to_dataframe to_df dataframe",
        "evaluate": "value mean",
        "uncertainty": "std stddev standard_deviation",
        "gradient": "grad",
        "pose": "transform matrix",
        "joint_positions": "q joints joint_values configuration joint_angles",
        "contact_points": "contacts",
        "best": "best_grasp",
        "forward_kinematics": "fk",
        "held": "success succeeded successful",
    }
)
"""Members of records and surfaces, with other words for each; some words are of several."""


METHODS = {
    "evaluate": dict.fromkeys(
        ("to_mesh", "mesh", "extract_mesh", "to_trimesh"), "meshing.extract_mesh"
    ),
    "free_points": dict.fromkeys(("estimate", "fit"), "stages.estimate.estimate"),
    "__dataclass_fields__": dict.fromkeys(("to_dict", "as_dict", "asdict"), "records.fields_of"),
}
"""Functions that are called as methods, by a member of the object that is their first argument."""


def option_called(word: str, accepted: Iterable[str]) -> str:
    """Return the one accepted option that a word means, or the word itself."""
    accepted = {*accepted}
    meant = [name for name in accepted if word in OPTIONS.get(name, ())]
    return meant[0] if len(meant) == 1 and word not in accepted else word


def in_our_words(given: Mapping[str, Any], accepted: Iterable[str]) -> dict[str, Any]:
    """Return options with other words replaced by ours, where one of `accepted` is meant.

    Raises `TypeError` if an option is given by both.
    """
    accepted, ours = [*accepted], {}
    for word, value in given.items():
        name = option_called(word, accepted)
        if name in ours or (name != word and name in given):
            raise TypeError(f"'{name}' is given twice: leave out '{word}'")
        ours[name] = value
    return ours


def takes_words(*more: str) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Let a function take its parameters, and `more` options, by other words too.

    Its signature and its help stay as they are.
    """

    def decorate(function: Callable[_P, _R]) -> Callable[_P, _R]:
        accepted = {*inspect.signature(function).parameters, *more}

        @wraps(function)
        def call(*args: _P.args, **options: _P.kwargs) -> _R:
            return function(*args, **in_our_words(options, accepted))  # type: ignore[arg-type]

        return call

    return decorate


def _members_called(word: str) -> list[str]:
    return [name for name, words in MEMBERS.items() if word in words]


class WordedClass(type):
    """Metaclass that finds class methods by other words, and nothing else: `dataclass` asks too."""

    def __getattr__(cls, word: str) -> Any:
        for name in _members_called(word):
            if isinstance(inspect.getattr_static(cls, name, None), classmethod):
                return getattr(cls, name)
        names = [name for name in dir(cls) if name[0] != "_"]
        advice = "" if word.startswith("_") else nearest_or_all(word, names)
        raise AttributeError(f"type object '{cls.__name__}' has no attribute '{word}'{advice}")


class Worded:
    """Base of classes whose members are also found by other words."""

    __slots__ = ()

    def __getattr__(self, word: str) -> Any:
        names = [name for name in dir(type(self)) if name[0] != "_"]
        if word in names:  # a property that raised `AttributeError`: again, with its own sentence
            return object.__getattribute__(self, word)
        for name in _members_called(word):
            if name in names:
                return getattr(self, name)
        for member, methods in METHODS.items():
            if word in methods and hasattr(type(self), member):
                return partial(resolve_name(f"lis_grasp.{methods[word]}"), self)
        advice = "" if word.startswith("_") else nearest_or_all(word, names)
        raise AttributeError(f"'{type(self).__name__}' has no attribute '{word}'{advice}")
