"""Declaration of one option: its meaning, the values that it may have, and its check."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Protocol, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from lis_grasp.exceptions import InvalidOptionError

Check = Callable[[str, Any], Any]
"""Returns the value to keep of an option's name and value, or raises `InvalidOptionError`."""

# Beyond this a number of an option is damage, whatever its unit.
_LARGEST = 1e9

_KINDS: Mapping[type, tuple[type, str]] = {
    str: (str, "a text that is not empty"),
    bool: (bool, "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
}

_Config = TypeVar("_Config", bound=type)


class Names(Protocol):
    """Names that the value of an option may have."""

    @property
    def names(self) -> Sequence[str]:
        """All names, those of plug-ins last."""

    @property
    def builtin(self) -> Mapping[str, object]:
        """The package's own, by name."""


@dataclass(frozen=True, slots=True)
class Option:
    """The declaration of one field, for the command line, the documentation and the checks."""

    help: str  #: what it means
    group: str = ""  #: title in the help of a verb; empty for none
    metavar: str | tuple[str, ...] = ""  #: name of its value in the help, or of each of three
    choices: tuple[str, ...] = ()  #: the permitted values; empty for any
    words: str = ""  #: the default in words, of verbs that explore; empty for the value itself
    words_else: str = ""  #: the same of verbs that read a file; empty for `words`
    check: Check = lambda name, value: value
    registry: Names | None = None  #: names that it may have, plug-ins too
    meanings: Mapping[str, str] = field(default_factory=dict)  #: the package's own names in words


def option(default: Any, help: str, group: str = "", **declaration: Any) -> Any:
    """Return a field of a dataclass with its declaration."""
    return field(default=default, metadata={"option": Option(help, group, **declaration)})


@cache
def options_of(config: Any) -> dict[str, Option]:
    """Return the declaration of every field of a configuration by its name."""
    return {item.name: item.metadata["option"] for item in fields(config)}


def documented(config: _Config) -> _Config:
    """Add the options to the docstring of a configuration."""
    lines = [f"    {name}\n        {o.help}." for name, o in options_of(config).items()]
    config.__doc__ = f"{config.__doc__}\n    Parameters\n    ----------\n" + "\n".join(lines) + "\n"
    return config


@cache
def kind_of(config: Any, name: str) -> type:
    """Return the type of an option's values beside None: str, bool, int, float or tuple."""
    hint = get_type_hints(config)[name]
    either = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    (kind,) = (k for k in either if k is not NoneType)
    found = get_origin(kind) or kind
    return str if found is Literal else found


def check_options(config: Any) -> None:
    """Check every value of a configuration by type, choices and check, and keep what these return.

    Raises
    ------
    InvalidOptionError
        For the first value that is not permitted.
    """
    of_class: Any = type(config)
    defaults = {item.name: item.default for item in fields(config)}
    for name, declared in options_of(of_class).items():
        value = getattr(config, name)
        if isinstance(value, (str, NoneType)) and not value and value == defaults[name]:
            continue
        if isinstance(value, (Path, np.generic)):
            value = str(value) if isinstance(value, Path) else value.item()
        if declared.choices and value not in declared.choices:
            raise InvalidOptionError.not_one_of(name, value, declared.choices)
        value = checked_value(name, value, kind_of(of_class, name), declared.check)
        object.__setattr__(config, name, value)


def checked_value(name: str, value: Any, kind: type, check: Check) -> Any:
    """Return what a check returns of a value that is of a type: str, bool, int, float or any.

    Raises `InvalidOptionError` if it is not, or if the check fails.
    """
    permitted, required = _KINDS.get(kind, (object, ""))
    is_bool = isinstance(value, bool)
    if (
        not isinstance(value, permitted)
        or (kind is str and not value)
        or (is_bool and kind in (int, float))
    ):
        raise InvalidOptionError.out_of_range(name, value, required)
    return check(name, value)


def within(required: str, is_within: Callable[[Any], bool]) -> Check:
    """Return the check of values for which a function is true; `required` says so in words."""

    def check(name: str, value: Any) -> Any:
        if not is_within(value):
            raise InvalidOptionError.out_of_range(name, value, required)
        return value

    return check


POSITIVE = within("above 0 and finite", lambda value: 0 < value <= _LARGEST)
PROBABILITY = within("above 0 and below 1", lambda value: 0 < value < 1)
NOT_LARGE = within("at least 0 and at most 1 m", lambda value: 0 <= value <= 1)
FRACTION = within("above 0 and at most 1", lambda value: 0 < value <= 1)


def at_least(least: int) -> Check:
    """Return the check of numbers from a least one up."""
    return within(f"at least {least} and finite", lambda value: least <= value < float("inf"))


def place(name: str, value: Any) -> tuple[float, ...]:
    """Return a place, three finite numbers."""
    try:
        numbers = tuple(float(x) for x in value)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise InvalidOptionError.out_of_range(name, value, "3 finite numbers")
    return numbers


def named(find: Callable[[str], object]) -> Check:
    """Return the check of names that a function finds."""

    def check(name: str, value: str) -> str:
        find(value)
        return value

    return check
