"""Frames, bodies, model instances and poses that users give: accepted, or answered in one line."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from inspect import Parameter, signature
from typing import ParamSpec, TypeVar, cast

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, ModelInstanceIndex, RigidBody

from lis_grasp.exceptions import InvalidOptionError, nearest_of, shown
from lis_grasp.geometry import require_pose
from lis_grasp.typing import FloatArray

_P = ParamSpec("_P")
_R = TypeVar("_R")


def wrong_type(option: str, value: object, required: str) -> InvalidOptionError:
    """Return the error of an option that is not of a type; `required` names the type."""
    it_is = f"{type(value).__name__} {shown(value)}"
    return InvalidOptionError(
        f"{option} must be {required}; it is {it_is}", option=option, value=value
    )


def written_as(example: str) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Refuse calls of a function with more arguments by place than it has; show an example."""

    def decorate(function: Callable[_P, _R]) -> Callable[_P, _R]:
        kinds = (parameter.kind for parameter in signature(function).parameters.values())
        most = sum(kind is Parameter.POSITIONAL_OR_KEYWORD for kind in kinds)

        @wraps(function)
        def call(*arguments: _P.args, **options: _P.kwargs) -> _R:
            for extra in arguments[most:]:
                raise InvalidOptionError(
                    f"{function.__name__} takes {most} arguments without a name, and {shown(extra)}"
                    f" is one more: write {example}",
                    option=function.__name__,
                    value=extra,
                )
            return function(*arguments, **options)

        return call

    return decorate


def require_type(option: str, value: object, kind: type) -> None:
    """Raise `InvalidOptionError` unless a value is None or of a kind."""
    if value is not None and not isinstance(value, kind):
        raise wrong_type(option, value, f"of type {kind.__name__}")


def rigid(X: FloatArray) -> RigidTransform:
    """Return a pose (4, 4), a rotation but for rounding, as Drake's."""
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(X[:3, :3]), X[:3, 3])


def require_plant(plant: object) -> MultibodyPlant:
    """Return the plant, or raise `InvalidOptionError` for anything else."""
    if not isinstance(plant, MultibodyPlant):
        raise wrong_type("plant", plant, "a MultibodyPlant")
    return plant


def numbers_of(value: object, option: str, shape: tuple[int, ...], *, least: float) -> FloatArray:
    """Return finite numbers of a shape, each at least `least`."""
    try:
        numbers = np.array(value, np.float64)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    if numbers.shape != shape or not (np.isfinite(numbers) & (numbers >= least)).all():
        many = f"numbers of shape {shape}" if shape else "a number"
        from_least = f", each at least {least:g}" if np.isfinite(least) else ""
        raise wrong_type(option, value, f"{many}{from_least}")
    return numbers


def pose_of(value: object, option: str) -> RigidTransform:
    """Return a pose that is a RigidTransform or a matrix (4, 4); None is the identity."""
    if value is None:
        return RigidTransform()
    if isinstance(value, RigidTransform):
        return value
    return rigid(require_pose(option, cast("npt.ArrayLike", value)))


def frame_of(plant: MultibodyPlant, value: object, option: str) -> Frame:
    """Return a frame of the plant: a Frame, the frame of a RigidBody, or that of a body's name."""
    if isinstance(value, str):
        value = _named(plant, value, option)
    if isinstance(value, RigidBody):
        value = value.body_frame()
    if not isinstance(value, Frame):
        raise wrong_type(option, value, "a Frame or a RigidBody of the plant")
    if value.GetParentPlant() is not plant:
        raise InvalidOptionError(
            f"{option} must be of this plant: {value.name()} is in another", option=option
        )
    return value


def instance_of(plant: MultibodyPlant, value: object, option: str) -> ModelInstanceIndex:
    """Return a model instance of the plant: its index, its name, or a list of only one."""
    if isinstance(value, list | tuple) and len(value) == 1:  # what Parser.AddModels returns
        (value,) = value
    if isinstance(value, str):
        if plant.HasModelInstanceNamed(value):
            return plant.GetModelInstanceByName(value)
        every = map(ModelInstanceIndex, range(plant.num_model_instances()))
        names = [plant.GetModelInstanceName(each) for each in every]
        raise InvalidOptionError(
            f"{option} must be a model instance of the plant; it has none named"
            f" '{value}'{nearest_of(value, names)}",
            option=option,
            value=value,
        )
    if not isinstance(value, ModelInstanceIndex):
        raise wrong_type(option, value, "a ModelInstanceIndex or the name of a model instance")
    if not value.is_valid() or int(value) >= plant.num_model_instances():
        raise InvalidOptionError.out_of_range(option, int(value), "a model instance of this plant")
    return value


def bodies_of(plant: MultibodyPlant, value: object, option: str) -> list[RigidBody]:
    """Return bodies of the plant: of a RigidBody, a Frame, a model instance, or names of these."""
    if isinstance(value, str) and plant.HasModelInstanceNamed(value):
        value = plant.GetModelInstanceByName(value)
    if isinstance(value, ModelInstanceIndex):
        return [*map(plant.get_body, plant.GetBodyIndices(instance_of(plant, value, option)))]
    if not isinstance(value, RigidBody | Frame | str):
        raise wrong_type(option, value, "bodies, frames or model instances of the plant")
    return [frame_of(plant, value, option).body()]


def _named(plant: MultibodyPlant, name: str, option: str) -> RigidBody:
    count = plant.NumBodiesWithName(name)
    if count != 1:
        raise InvalidOptionError(
            f"{option} must be a frame or body of the plant; it has {count or 'no'} bodies named"
            f" '{name}': give the Frame or the RigidBody itself",
            option=option,
            value=name,
        )
    return plant.GetBodyByName(name)
