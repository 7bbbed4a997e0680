"""Ports of records: checked reading, and values derived once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DependencyTicket, InputPort, LeafSystem, OutputPort

_Value = TypeVar("_Value")
_Made = TypeVar("_Made")


def declare_output(
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


def read_port(port: InputPort, context: Context, kind: type[_Value], source: str) -> _Value:
    """Return the value of an input port.

    Drake connects ports of any two Python types, so the type is checked here.

    Raises `TypeError` if the value is not of the `kind`; the message names system, port and the
    right `source`.
    """
    value = port.Eval(context)
    if not isinstance(value, kind):
        system = port.get_system()
        raise TypeError(
            f"input port '{port.get_name()}' of {type(system).__name__} '{system.get_name()}' takes"
            f" {kind.__name__}; it has a {type(value).__name__}: connect {source}"
        )
    return value


class MadeOnce(Generic[_Value, _Made]):
    """A function's result for a value, kept until it is called with another object.

    Drake calculates an output again after any update of any system's state; records keep their
    identity.
    """

    def __init__(self, make: Callable[[_Value], _Made]) -> None:
        self._make = make
        self._last: tuple[_Value, _Made] | None = None

    def __call__(self, value: _Value) -> _Made:
        """Return the result for a value."""
        if self._last is None or self._last[0] is not value:
            self._last = value, self._make(value)
        return self._last[1]
