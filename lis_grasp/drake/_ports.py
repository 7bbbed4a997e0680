"""Ports of the public systems, and the motion of a hand to a probe, beginning to end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, DependencyTicket, InputPort, LeafSystem, OutputPort
from pydrake.trajectories import PiecewisePolynomial, PiecewisePose

from lis_grasp.exploration.states import NextProbe
from lis_grasp.probing.course import Course
from lis_grasp.records import Record
from lis_grasp.typing import FloatArray

_Value = TypeVar("_Value")
_Made = TypeVar("_Made")


def add_output(
    system: LeafSystem,
    name: str,
    empty: object,
    calculate: Callable[[Context], Any],
    needs: set[DependencyTicket],
) -> OutputPort:
    """Declare an output port that is calculated again only if what it `needs` has changed."""
    port: OutputPort = system.DeclareAbstractOutputPort(
        name,
        lambda: AbstractValue.Make(empty),
        lambda context, output: output.set_value(calculate(context)),
        needs,
    )
    return port


def read(port: InputPort, context: Context, kind: type[_Value], source: str) -> _Value:
    """Return the value of an input port.

    Drake connects ports of any two Python values. So the type is checked here.

    Raises `TypeError` if the value is not of a `kind`; the message names system, port and its right
    `source`.
    """
    value = port.Eval(context)
    if not isinstance(value, kind):
        system = port.get_system()
        raise TypeError(
            f"input port '{port.get_name()}' of {type(system).__name__} '{system.get_name()}' takes"
            f" {kind.__name__}; it has a {type(value).__name__}: connect {source}"
        )
    return value


def rigid(X: FloatArray) -> RigidTransform:
    """Return a pose (4, 4), a rotation but for rounding, as Drake's."""
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(X[:3, :3]), X[:3, 3])


class MadeOnce(Generic[_Value, _Made]):
    """What a function makes of a value, kept until it is called with another object.

    Drake calculates an output again after any update of any system's state; records keep their
    identity.
    """

    def __init__(self, make: Callable[[_Value], _Made]) -> None:
        self._make = make
        self._last: tuple[_Value, _Made] | None = None

    def __call__(self, value: _Value) -> _Made:
        """Return what is made of a value."""
        if self._last is None or self._last[0] is not value:
            self._last = value, self._make(value)
        return self._last[1]


LEVER = 0.1
"""A turn of the hand or of a joint counts as a motion at this lever [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class HandMotion(Record):
    """A motion of a hand over time, from 0 to a duration."""

    poses: PiecewisePose  # X_WG, of the base link
    joints: PiecewisePolynomial  # (J,) of the hand
    duration: float  # [s]
    arm: PiecewisePolynomial | None = None  # (K,) of the arm
    guarded: float = np.inf  # time from which on it may touch [s]
    slow: float = np.inf  # time at which the probe's own motion begins [s]
    at_table: bool = False  # whether it ends at the table, before the probe's target
    course: Course | None = None  # of an arm

    def state(self, path: PiecewisePolynomial, time: float) -> FloatArray:
        """Return positions and rates (2 N,) on a path at a time [s]; at rest outside of it."""
        inside = 0.0 <= time < self.duration
        at = min(max(time, 0.0), self.duration)
        q = path.value(at)[:, 0]
        return np.concatenate([q, path.EvalDerivative(at)[:, 0] if inside else 0.0 * q])

    def X_WG(self, time: float) -> RigidTransform:
        """Return the pose of the base link at a time [s]."""
        return self.poses.GetPose(min(max(time, 0.0), self.duration))


class Mover(Protocol):
    """Moves a hand to probes and back."""

    def home(self) -> HandMotion:
        """Return the motion that rests where the exploration begins."""

    def out(self, chosen: NextProbe, before: HandMotion) -> HandMotion | str:
        """Return the motion from the end of one before to a probe's end, or why there is none."""

    def back(self, motion: HandMotion, time: float) -> HandMotion:
        """Return the way back from a motion that ended at a time [s]."""
