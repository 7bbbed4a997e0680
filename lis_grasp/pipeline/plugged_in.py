"""Estimators and policies by name: the package's own and plug-ins."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import POLICIES, Policy, Probe, Workspace
from lis_grasp.plugins import Registry, errors_of
from lis_grasp.surfaces import ESTIMATORS, Estimator, ImplicitSurface

ESTIMATOR_NAMES = Registry("estimator", ESTIMATORS)
"""Surface estimators: a class with `from_contacts`, or a function of contacts."""

POLICY_NAMES = Registry("policy", POLICIES)
"""Exploration policies: the package's own kinds, or what makes a `Policy` of a `Workspace`."""

_MEMBERS = ("evaluate", "gradient", "uncertainty", "bounds")


@dataclass(frozen=True, slots=True)
class PluggedEstimator:
    """An estimator of another package, checked when it is used.

    Parameters
    ----------
    name
        The name that a user gave.
    make
        Makes a surface from contacts. The sensor's noise is given to it as the keywords
        ``position_noise`` [m] and ``normal_noise`` [rad] if it has them.
    """

    name: str
    make: Callable[..., Any]

    def __call__(self, contacts: Contacts, **options: Any) -> ImplicitSurface:
        """Return the surface of contacts.

        Raises
        ------
        PluginError
            If the estimator or its surface raises an error of its own.
        InvalidOptionError
            If what is returned is no `ImplicitSurface`.
        """
        with errors_of(self.name, self.make):
            surface = self.make(contacts, **_accepted(self.make, options))
        self._require_members(surface)
        plugged: Any = _Guarded(self.name, surface)
        self._require_shapes(plugged, contacts)
        return cast(ImplicitSurface, plugged)

    def _require_members(self, surface: Any) -> None:
        missing = [member for member in _MEMBERS if not hasattr(surface, member)]
        if missing:
            raise InvalidOptionError(
                f"estimator '{self.name}' must return a surface with {', '.join(_MEMBERS)}; its"
                f" {type(surface).__name__} has no {' and no '.join(missing)}",
                option="estimator",
                value=self.name,
            )

    def _require_shapes(self, surface: ImplicitSurface, contacts: Contacts) -> None:
        points = contacts.points[:2]
        for member, wanted in (
            ("evaluate", points.shape[:1]),
            ("gradient", points.shape),
            ("uncertainty", points.shape[:1]),
        ):
            shape = np.shape(getattr(surface, member)(points))
            if shape != wanted:
                raise InvalidOptionError(
                    f"estimator '{self.name}': {member} must return shape {wanted} for points of"
                    f" shape {points.shape}; it returned {shape}",
                    option="estimator",
                    value=self.name,
                )


@dataclass(frozen=True, slots=True)
class _Guarded:
    """A plug-in's surface or policy with its members, whose errors name the plug-in."""

    name: str
    plugin: Any

    def __getattr__(self, member: str) -> Any:
        with errors_of(self.name, type(self.plugin)):
            value = getattr(self.plugin, member)
        return partial(self._call, value) if callable(value) else value

    def _call(self, method: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        with errors_of(self.name, type(self.plugin)):
            made = method(*arguments, **options)
        if getattr(method, "__name__", "") == "next_probe" and not isinstance(made, Probe | None):
            raise InvalidOptionError(
                f"policy '{self.name}' must return a Probe or None; it returned"
                f" {type(made).__name__}",
                option="policy",
                value=self.name,
            )
        return made


def find_estimator(
    name: str, *, registry: Registry = ESTIMATOR_NAMES, option: str = ""
) -> Estimator:
    """Return an estimator by its name, or one at ``my.module:Class``.

    Raises
    ------
    InvalidOptionError
        If there is none, or it cannot be called.
    """
    found = registry.find(name, option=option)
    if name in registry.builtin:
        return found  # type: ignore[no-any-return]
    make = getattr(found, "from_contacts", found)
    if not callable(make):
        raise InvalidOptionError(
            f"estimator '{name}' must be a class with from_contacts, or a function of contacts; it"
            f" is of type {type(found).__name__}",
            option=option or "estimator",
            value=name,
        )
    return PluggedEstimator(name, make)


def find_policy(name: str, space: Workspace) -> Policy:
    """Return a plugged-in policy by its name for one workspace.

    Raises
    ------
    InvalidOptionError
        If there is none, or it is no policy.
    PluginError
        If it raises an error.
    """
    make = POLICY_NAMES.find(name)
    with errors_of(name, make):
        policy = make(space) if callable(make) else None
    if not callable(getattr(policy, "next_probe", None)):
        raise InvalidOptionError(
            f"policy '{name}' must make an object with next_probe from a Workspace; it is of type"
            f" {type(make).__name__}",
            option="policy",
            value=name,
        )
    return cast(Policy, _Guarded(name, policy))


def _accepted(make: Callable[..., Any], options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that a function has keywords for."""
    try:
        parameters = inspect.signature(make).parameters
    except (TypeError, ValueError):
        return options
    if any(p.kind is inspect.Parameter.VAR_KEYWORD for p in parameters.values()):
        return options
    return {name: value for name, value in options.items() if name in parameters}
