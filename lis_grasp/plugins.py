"""Registry of what users can plug in by name: estimators, policies, planners, hands and verbs.

A name is one of the package's own, one that an installed package registers as an entry point of
the group ``lis_grasp.estimators``, ``lis_grasp.policies``, ``lis_grasp.planners``,
``lis_grasp.hands`` or ``lis_grasp.verbs``, or ``my.module:Class``, which is imported; the current
folder is searched too.
"""

from __future__ import annotations

import inspect
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache, partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

from lis_grasp.exceptions import EstimationError, InvalidOptionError, PluginError
from lis_grasp.io.provenance import digest_of

Role = Literal["estimator", "policy", "planner", "hand", "verb"]

_GROUPS = {
    "estimator": "lis_grasp.estimators",
    "policy": "lis_grasp.policies",
    "planner": "lis_grasp.planners",
    "hand": "lis_grasp.hands",
    "verb": "lis_grasp.verbs",
}

# Parameters that need no value, and those that a value given by place may fill.
_ANY_NUMBER = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
_BY_PLACE = (
    inspect.Parameter.POSITIONAL_ONLY,
    inspect.Parameter.POSITIONAL_OR_KEYWORD,
    inspect.Parameter.VAR_POSITIONAL,
)


@dataclass(frozen=True, slots=True)
class Registry:
    """Names of one role, and the object that each stands for.

    Parameters
    ----------
    role
        Kind of object that is plugged in.
    builtin
        The package's own by name. These names cannot be taken by plug-ins.
    """

    role: Role
    builtin: Mapping[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the package's own, then those that installed packages register."""
        return (*self.builtin, *(name for name in self._registered() if name not in self.builtin))

    def find(self, name: str, *, option: str = "") -> Any:
        """Return the object that a name stands for, imported if it is not the package's own.

        Parameters
        ----------
        name
            A registered name, or ``module:attribute``.
        option
            Name of the user's option, for messages; empty for the role.

        Raises
        ------
        InvalidOptionError
            If there is no such name, or its module cannot be imported.
        """
        option = option or self.role
        if name in self.builtin:
            return self.builtin[name]
        registered = self._registered()
        if name in registered:
            return _loaded(registered[name], name, option)
        if ":" not in name:
            raise InvalidOptionError.not_one_of(option, name, (*self.names, "my.module:Class"))
        if "" not in sys.path and str(Path.cwd()) not in sys.path:
            sys.path.append(str(Path.cwd()))  # a console script's path lacks the current folder
        return _loaded(EntryPoint(name, name, _GROUPS[self.role]), name, option)

    def digest(self, name: str) -> str:
        """Return a hash of the source file of a plug-in, by which stored results are recognised.

        Empty for the package's own, and where there is no source file. For errors see `find`.
        """
        file = self.source_file(name)
        return "" if file is None else digest_of(file)

    def source_file(self, name: str) -> Path | None:
        """Return the source file of a plug-in; None for the package's own, or if there is none."""
        return None if name in self.builtin else _source_file(self.find(name))

    def _registered(self) -> Mapping[str, EntryPoint]:
        return _registered(_GROUPS[self.role], tuple(sys.path))


@lru_cache
def _registered(group: str, _path: tuple[str, ...]) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group that are installed on a search path."""
    return {point.name: point for point in entry_points(group=group)}


def misfit(make: Callable[..., Any], *given: str) -> str:
    """Return in words what a function takes, if it is not one value and keywords `given`, or "".

    A class takes what its constructor takes.
    """
    try:
        taken = inspect.signature(make)
    except (TypeError, ValueError):  # of a compiled function
        return ""
    parameters = [p for name, p in taken.parameters.items() if name not in given]
    first = next((p for p in parameters if p.kind in _BY_PLACE), None)
    required = [p for p in parameters if p is not first and p.default is p.empty]
    if first is not None and all(p.kind in _ANY_NUMBER for p in required):
        return ""
    return f"it takes {', '.join(taken.parameters) or 'nothing'}"


def qualified_name(plugin: Any) -> str:
    """Return ``module:name`` of a function or a class, or of the class of another object."""
    named = plugin if hasattr(plugin, "__qualname__") else type(plugin)
    return f"{named.__module__}:{named.__qualname__}"


@contextmanager
def errors_of(name: str, plugin: Any) -> Iterator[None]:
    """Raise an error of a plug-in's code as `PluginError`, with its place in the plug-in's file.

    An `EstimationError` passes: it is a result that estimators have.
    """
    try:
        yield
    except EstimationError:
        raise
    # A user's code may raise anything.
    except Exception as error:
        place = _place(error, _source_file(plugin))
        reason = " ".join(str(error).split()) or "no reason given"
        message = f"{name} raised {type(error).__name__}{place}: {reason}"
        raise PluginError(message, plugin=name) from error


@dataclass(frozen=True, slots=True)
class Guarded:
    """A plug-in's surface or policy with its members, whose errors name the plug-in.

    Parameters
    ----------
    name
        The name that the user gave.
    plugin
        The surface or policy.
    kinds
        Return types of methods by name; other methods are not checked.
    """

    name: str
    plugin: Any
    kinds: Mapping[str, tuple[type, ...]] = field(default_factory=dict)

    def __getattr__(self, member: str) -> Any:
        with errors_of(self.name, type(self.plugin)):
            value = getattr(self.plugin, member)
        return partial(self._call, member, value) if callable(value) else value

    def _call(self, member: str, method: Callable[..., Any], *args: Any, **options: Any) -> Any:
        with errors_of(self.name, type(self.plugin)):
            made = method(*args, **options)
        kinds = self.kinds.get(member, (object,))
        if not isinstance(made, kinds):
            wanted = " or ".join(kind.__name__ for kind in kinds).replace("NoneType", "None")
            raise InvalidOptionError(
                f"{member} of plug-in '{self.name}' must return a {wanted}; it returned"
                f" {type(made).__name__}",
                value=self.name,
            )
        return made


def _place(error: Exception, file: Path | None = None) -> str:
    """Return " at file:line" of the innermost call in a file, else of the innermost of all."""
    calls = [c for c in traceback.extract_tb(error.__traceback__) if "<frozen" not in c.filename]
    own = [call for call in calls if file is not None and Path(call.filename) == file]
    innermost = (own or calls)[-1]
    path = Path(innermost.filename)
    shown = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
    return f" at {shown}:{innermost.lineno}"


def _source_file(plug_in: Any) -> Path | None:
    """Return the file that defines an object, None if there is none."""
    try:
        file = inspect.getsourcefile(inspect.unwrap(plug_in))
    except TypeError:
        return None
    return Path(file) if file and Path(file).is_file() else None


def _loaded(point: EntryPoint, name: str, option: str) -> Any:
    module, _, attribute = point.value.partition(":")
    try:
        found = import_module(module)
        return attrgetter(attribute)(found) if attribute else found
    # An import runs a user's code, which may raise anything.
    except Exception as error:
        reason = " ".join(str(error).split())
        own = isinstance(error, ImportError | AttributeError | SyntaxError)
        absent = error.name if isinstance(error, ModuleNotFoundError) else ""
        cure = f": put {absent} into this folder, or install it" if absent else ""
        if absent and module.endswith(".py"):
            cure = f": write {module.removesuffix('.py').replace('/', '.')}:{attribute}"
        raise InvalidOptionError(
            f"{option} '{name}' must be an attribute of a module that can be imported;"
            f" {type(error).__name__}{'' if own else _place(error)}:"
            f" {reason or 'no reason given'}"
            f"{cure}",
            option=option,
            value=name,
        ) from error
