"""Answers to names of other libraries: what this package has in place of `fit` or `from_numpy`.

Classes, their objects, modules, keywords of functions and the command line have one table,
``guesses.ini``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable
from configparser import ConfigParser
from functools import cache, wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

from lis_grasp.exceptions import all_of, nearest_of

KEYWORDS = {
    "output": "folder",
    "support": "support_height",
    "view": "views",
    "clamped": "free=False",
    "unknown": "known=False",
    "no-free-space": "free_space=False",
}
"""Keywords in Python by the options of the command line that have other names."""

_Function = TypeVar("_Function", bound=Callable[..., Any])


@cache
def answers(section: str) -> dict[str, tuple[str, ...]]:
    """Return the answers of a section of the table, by the names that get them."""
    table = ConfigParser(delimiters=("<-",), interpolation=None)
    table.optionxform = str  # type: ignore[assignment, method-assign]
    table.read_string(Path(__file__).with_suffix(".ini").read_text(encoding="utf-8"))
    found: dict[str, tuple[str, ...]] = {}
    for answer, names in table[section].items() if section in table else ():
        for name in names.split():
            found[name] = (*found.get(name, ()), answer)
    return found


def advice(sections: Collection[str], name: str, names: Collection[str]) -> str:
    """Return the end of a message on a name that does not exist: an answer, or a similar name."""
    for section in sections:
        if name in answers(section):
            return f": use {answers(section)[name][0]}"
    return nearest_of(name, names)


def advice_or_all(sections: Collection[str], name: str, names: Iterable[str]) -> str:
    """Return the end of a message as `advice` does, or else with all public names."""
    public = [each for each in names if not each.startswith("_")]
    return advice(sections, name, public) or all_of(public)


def advice_on_option(given: str, options: Collection[str]) -> str:
    """Return the end of a message on an option or a keyword, with one of `options` if it helps.

    These are flags of a verb (``--output``), or keywords of a function.
    """
    are_flags = any(option.startswith("--") for option in options)
    plain = given.lstrip("-").replace("_", "-").lower()
    flags = {keyword.replace("_", "-"): flag for flag, keyword in KEYWORDS.items()}
    asked = flags.get(plain, plain)
    for answer in (asked, *answers("options").get(asked, ())):
        name, rest = re.split(r"(?=[^a-z-]|$)", answer, maxsplit=1)
        own = f"--{name}" if are_flags else KEYWORDS.get(name, name.replace("-", "_"))
        if own.partition("=")[0] in options:
            return f": use {own}{rest}"
    none = answers("no option" if are_flags else "no keyword").get(asked)
    return f": {none[0]}" if none else nearest_of(given, options)


def advice_on_keyword(given: str, accepted: Collection[str]) -> str:
    """Return the end of a message on a keyword: advice as on an option, or else all keywords."""
    return advice_on_option(given, accepted) or all_of(sorted({*accepted}))


def with_advice(function: _Function) -> _Function:
    """Decorate a function whose keywords are few: a wrong one gets a sentence with the right one.

    Examples
    --------
    >>> extract_mesh(sphere, voxel_size=0.01)
    Traceback (most recent call last):
    TypeError: extract_mesh has no option 'voxel_size': use resolution
    """
    parameters = signature(function).parameters
    accepted = [n for n, p in parameters.items() if p.kind != Parameter.VAR_KEYWORD]
    accepted = [name for name in accepted if name not in ("cls", "self")]

    @wraps(function)
    def call(*args: Any, **keywords: Any) -> Any:
        for name in sorted(keywords.keys() - {*accepted}):
            end = advice_on_keyword(name, accepted)
            raise TypeError(f"{function.__qualname__} has no option '{name}'{end}")
        return function(*args, **keywords)

    return cast("_Function", call)


def _answered(owner: type, name: str, error: AttributeError, asked: object) -> AttributeError:
    """Return the error of a missing attribute with advice; special names and others get none."""
    if name.startswith("_") or f"'{name}'" not in str(error):
        return error
    fields = getattr(owner, "__dataclass_fields__", {})  # those without a default are no members
    sections = [base.__name__ for base in owner.__mro__]
    end = advice_or_all(sections, name, sorted({*dir(owner), *fields}))
    return AttributeError(f"{error}{end}", name=name, obj=asked)


class _AnsweringClass(type(Protocol)):  # type: ignore[misc]  # its classes may be protocols too
    """Class of the classes with `Answering`: they answer as their objects do."""

    if not TYPE_CHECKING:  # else any attribute would pass the type checker

        def __getattr__(cls, name: str) -> Any:
            try:
                return type.__getattribute__(cls, name)
            except AttributeError as error:
                raise _answered(cls, name, error, cls) from None


class Answering(metaclass=_AnsweringClass):
    """Base of classes that answer to names of other libraries, as do their objects.

    Examples
    --------
    >>> contacts.to_dataframe()
    Traceback (most recent call last):
    AttributeError: 'Contacts' object has no attribute 'to_dataframe': use to_pandas()
    """

    __slots__ = ()
    _is_protocol = False  # what `typing` asks of every class whose class is that of protocols

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            try:
                return object.__getattribute__(self, name)  # a property's own error
            except AttributeError as error:
                raise _answered(type(self), name, error, self) from None
