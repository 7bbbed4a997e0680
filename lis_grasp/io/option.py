"""Records of options: each option is declared once, and checked when a record is made.

Types are checked by pydantic; ranges, choices and names by the check of the declaration.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache, wraps
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import pydantic.dataclasses
from pydantic import ConfigDict, TypeAdapter, ValidationError
from typing_extensions import dataclass_transform

from lis_grasp.exceptions import UNIT_NAMES, InvalidOptionError

Check = Callable[[str, Any], Any]
"""Returns the value to keep of an option's name and value, or raises `InvalidOptionError`."""

LARGEST_NUMBER = 1e9
"""A larger number in an option or a log is damage, whatever its unit."""

_REQUIRED: Mapping[type, str] = {
    str: "a text that is not empty",
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    tuple: "a list of numbers",
}

# What a text is, by the name of the value in the help.
_NAMES = {"FILE": "the path of a file"} | dict.fromkeys(
    ("HAND", "ARM", "POSE"), "a name or the path of a file"
)

_T = TypeVar("_T")


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
    words: str = ""  #: the default in words, for verbs that explore; empty for the value itself
    words_else: str = ""  #: the same for verbs that read a file; empty for `words`
    check: Check = lambda name, value: value
    registry: Names | None = None  #: names that it may have, plug-ins too
    meanings: Mapping[str, str] = field(default_factory=dict)  #: the package's own names in words


def option(default: Any, help: str, group: str = "", **declaration: Any) -> Any:
    """Return a field of a record with its declaration."""
    return field(default=default, metadata={"option": Option(help, group, **declaration)})


@dataclass_transform(frozen_default=True)
def record_of_options(cls: type[_T]) -> type[_T]:
    """Make a class a frozen dataclass whose fields are options, checked and documented.

    Making one raises `InvalidOptionError` for the first value that is not permitted.
    """
    made: Any = pydantic.dataclasses.dataclass(frozen=True, config=ConfigDict(strict=True))(cls)
    declared, fill = options_of(made), made.__init__

    @wraps(fill)
    def make(self: Any, *args: Any, **values: Any) -> None:
        try:
            fill(self, *map(_plain, args), **{name: _plain(v) for name, v in values.items()})
        except ValidationError as invalid:
            error = invalid.errors(include_url=False)[0]
            name = error["loc"][0] if error["loc"] else ""
            if name not in declared:  # Python's own words for a wrong call
                raise TypeError(f"{cls.__name__}: {error['msg']}: {name}") from None
            if choices := declared[name].choices:
                raise InvalidOptionError.not_one_of(name, error["input"], choices) from None
            kind = kind_of(made, str(name))
            if kind is tuple and items_of(made, str(name)) is str:
                raise InvalidOptionError.out_of_range(
                    str(name), error["input"], "a list of texts"
                ) from None
            others = _classes_of(made, str(name))
            raise _wrong(str(name), error["input"], kind, declared[name], others) from None
        for name, option in declared.items():
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _permitted(name, value, option))

    made.__init__ = make
    lines = [f"    {name}\n        {o.help}." for name, o in declared.items()]
    made.__doc__ = f"{cls.__doc__}\n    Parameters\n    ----------\n" + "\n".join(lines) + "\n"
    return made  # type: ignore[no-any-return]


def _plain(value: Any) -> Any:
    """Return paths as text, scalars of numpy as Python's, and lists as tuples."""
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (list, np.ndarray)):
        return tuple(map(_plain, value))
    return value.item() if isinstance(value, np.generic) else value


def _permitted(name: str, value: Any, option: Option) -> Any:
    if value == "":
        raise InvalidOptionError.out_of_range(name, value, _REQUIRED[str])
    if option.choices and value not in option.choices:
        raise InvalidOptionError.not_one_of(name, value, option.choices)
    return option.check(name, value)


@cache
def options_of(record: Any) -> dict[str, Option]:
    """Return the declaration of every option of a record by its name."""
    declared = {item.name: item.metadata.get("option") for item in fields(record)}
    return {name: option for name, option in declared.items() if option is not None}


@cache
def kind_of(record: Any, name: str) -> type:
    """Return the type of an option's values beside None: str, bool, int, float or tuple."""
    hint = get_type_hints(record)[name]
    if get_origin(hint) is Literal:
        return type(get_args(hint)[0])
    kinds = get_args(hint) if type(None) in get_args(hint) or str in get_args(hint) else (hint,)
    return get_origin(kinds[0]) or kinds[0]


@cache
def _classes_of(record: Any, name: str) -> tuple[type, ...]:
    """Return the classes of the package whose objects an option may be, beside plain values."""
    kinds = get_args(get_type_hints(record)[name])
    return tuple(kind for kind in kinds if getattr(kind, "__module__", "").startswith("lis_grasp"))


@cache
def items_of(record: Any, name: str) -> type:
    """Return the type of the items of an option that is a tuple: float or str."""
    hint = get_type_hints(record)[name]
    of_tuple = next(kind for kind in (hint, *get_args(hint)) if get_origin(kind) is tuple)
    return get_args(of_tuple)[0]  # type: ignore[no-any-return]


def checked_value(name: str, value: Any, kind: type, check: Check) -> Any:
    """Return a check's result for a value of a type: str, bool, int or float.

    Raises `InvalidOptionError` for another type, or if the check fails.
    """
    try:
        checked: Any = TypeAdapter(kind, config=ConfigDict(strict=True)).validate_python(
            _plain(value)
        )
    except ValidationError:
        raise _wrong(name, value, kind) from None
    return check(name, checked)


def _wrong(
    name: str, value: Any, kind: type, option: Option | None = None, others: Sequence[type] = ()
) -> InvalidOptionError:
    """Return the error of a value of a wrong type; an option may have values of `others` too."""
    required = _REQUIRED[kind]
    if option is not None and kind is str and value != "":
        required = _NAMES.get(str(option.metavar), "a text")
        if option.registry:
            required = "a name, my.module:Class, or a function"
        required = " or ".join((required, *(f"of type {other.__name__}" for other in others)))
    elif option is not None and isinstance(option.metavar, str):
        required += f" in {UNIT_NAMES[option.metavar]}" if option.metavar in UNIT_NAMES else ""
    return InvalidOptionError.out_of_range(name, value, required)


def within(required: str, is_within: Callable[[Any], bool]) -> Check:
    """Return the check of values for which a function is true; `required` says so in words."""

    def check(name: str, value: Any) -> Any:
        if not is_within(value):
            raise InvalidOptionError.out_of_range(name, value, required)
        return value

    return check


POSITIVE = within("above 0 and finite", lambda value: 0 < value <= LARGEST_NUMBER)
PROBABILITY = within("above 0 and below 1", lambda value: 0 < value < 1)
NOT_LARGE = within("at least 0 and at most 1 m", lambda value: 0 <= value <= 1)
FRACTION = within("above 0 and at most 1", lambda value: 0 < value <= 1)
RATE = within("from 0 to 1", lambda value: 0 <= value <= 1)
SPREAD = within("in radians, from 0 to 1 (57 deg)", lambda value: 0 <= value <= 1)


def at_least(least: int) -> Check:
    """Return the check of numbers with a lower limit."""
    return within(f"at least {least} and finite", lambda value: least <= value < float("inf"))


def place(name: str, value: Any) -> tuple[float, ...]:
    """Return a place, three finite numbers."""
    if np.shape(value) != (3,) or not np.isfinite(value).all():
        raise InvalidOptionError.out_of_range(name, value, "3 finite numbers")
    return tuple(float(x) for x in value)


def named(find: Callable[[str], object]) -> Check:
    """Return the check of names that a function finds; an object is taken as it is."""

    def check(name: str, value: Any) -> Any:
        if isinstance(value, str):
            find(value)
        return value

    return check
