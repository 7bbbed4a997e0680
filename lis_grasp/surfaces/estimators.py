"""Estimators by name, the package's own and plug-ins."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.plugins import Guarded, Registry, errors_of, misfit
from lis_grasp.surfaces.blended_implicit_surface import BlendedImplicitSurface
from lis_grasp.surfaces.contact_verdicts import judge_contacts
from lis_grasp.surfaces.gaussian_process_implicit_surface import GaussianProcessImplicitSurface
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.surfaces.local_implicit_surface import LocalImplicitSurface
from lis_grasp.surfaces.patch_implicit_surface import PatchImplicitSurface
from lis_grasp.surfaces.smooth_implicit_surface import SmoothImplicitSurface

Estimator = Callable[..., ImplicitSurface]
"""Makes a surface from `Contacts`; keywords give the sensor's noise and options."""

ESTIMATORS: Mapping[str, Estimator] = MappingProxyType(
    {
        "lis": LocalImplicitSurface.from_contacts,
        "gpis": GaussianProcessImplicitSurface.from_contacts,
        "smooth": SmoothImplicitSurface.from_contacts,
        "patch": PatchImplicitSurface.from_contacts,
        "blend": BlendedImplicitSurface.from_contacts,
    }
)
"""Every estimator by its short name, with its default options."""

ESTIMATOR_MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "blend": "smooth patches that meet in edges, or smooth where that predicts as well",
        "smooth": "Gaussian processes for shapes without edges",
        "gpis": "a Gaussian process, which rounds edges",
        "patch": "the patches alone",
        "lis": "the paper's tangent planes",
    }
)
"""The package's estimators in words."""

ESTIMATOR_NAMES = Registry("estimator", ESTIMATORS)
"""Surface estimators: a class with `from_contacts`, or a function of contacts."""

FEW_CONTACTS = 10
"""Contacts below which hardly more than position and size of an object is known."""

_NOISE = ("position_noise", "normal_noise")
_MEMBERS = ("evaluate", "gradient", "uncertainty", "bounds")
_SIGN_STEP = 1e-3  # from a contact along its normal, in extents of the contacts


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

        Raises `PluginError` if the estimator or its surface raises an error of its own, and
        `InvalidOptionError` if what is returned is no `ImplicitSurface`.
        """
        noise = {name: options.get(name) for name in _NOISE}
        contacts = judge_contacts(contacts, **noise).credible
        with errors_of(self.name, self.make):
            surface = self.make(contacts, **accepted_options(self.make, options))
        self._require_members(surface)
        plugged: Any = Guarded(self.name, surface)
        self._require_shapes(plugged, contacts)
        require_signs(plugged, contacts, self.name)
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
        for member in _MEMBERS[:3]:
            wanted = points.shape if member == "gradient" else points.shape[:1]
            shape = np.shape(getattr(surface, member)(points))
            if shape != wanted:
                raise InvalidOptionError(
                    f"estimator '{self.name}': {member} must return shape {wanted} for points of"
                    f" shape {points.shape}; it returned {shape}",
                    option="estimator",
                    value=self.name,
                )


def require_signs(surface: ImplicitSurface, contacts: Contacts, name: str) -> None:
    """Raise `InvalidOptionError` if an estimator's surface is inside out.

    Beyond most contacts f is larger than behind them, and its gradient points outward there.
    """
    if not len(contacts):
        return
    step = _SIGN_STEP * (contacts.extent or 1.0) * contacts.normals
    both = np.stack([contacts.points + step, contacts.points - step])
    beyond, behind = np.asarray(surface.evaluate(both))
    slopes = np.sum(np.asarray(surface.gradient(contacts.points)) * contacts.normals, axis=1)
    wrong = ""
    if np.mean(beyond < behind) > 0.5:
        wrong = "evaluate must return values above 0 outside of the object, and below 0 inside"
    elif np.mean(slopes < 0.0) > 0.5:
        wrong = "gradient must point out of the object; it points inward"
    if wrong:
        raise InvalidOptionError(
            f"estimator '{name}': {wrong}: change its sign", option="estimator", value=name
        )


def require_noise_below_size(contacts: Contacts, position_noise: float | None) -> None:
    """Raise `InvalidOptionError` if noise [m] is as large as many contacts are far apart."""
    if position_noise is None or len(contacts) < FEW_CONTACTS or not contacts.extent:
        return
    if position_noise < contacts.extent:
        return
    raise InvalidOptionError.out_of_range(
        "position_noise",
        position_noise,
        f"in metres, and below the {contacts.extent:.3g} m that the contacts are apart;"
        f" {position_noise:g} mm are {1e-3 * position_noise:g} m",
    )


def few_contacts(contacts: Contacts) -> str:
    """Return a sentence on the worth of an estimate from few contacts; empty if they are enough."""
    places = len(np.unique(contacts.points, axis=0))
    if places == 1:
        return "contacts at one place show no size of an object: that of the estimate is arbitrary"
    if not 0 < places < FEW_CONTACTS:
        return ""
    return (
        f"fewer than {FEW_CONTACTS} contacts at different places show little more than position"
        " and size of an object, and the standard deviation is too small"
    )


def find_estimator(
    name: str, *, registry: Registry = ESTIMATOR_NAMES, option: str = ""
) -> Estimator:
    """Return an estimator by its name, or one at ``my.module:Class``.

    Raises `InvalidOptionError` if there is none, or it cannot be called.
    """
    found = registry.find(name, option=option)
    if name in registry.builtin:
        return found  # type: ignore[no-any-return]
    return PluggedEstimator(name, maker_of(found, name, option=option))


def maker_of(estimator: Any, name: str, *, option: str = "") -> Estimator:
    """Return the function of contacts that an estimator is, or that a class has as from_contacts.

    Raises `InvalidOptionError` if it has none, or one of other arguments.
    """
    make = getattr(estimator, "from_contacts", estimator)
    wrong = misfit(make, *_NOISE) if callable(make) else f"it is of type {type(make).__name__}"
    if wrong:
        raise InvalidOptionError(
            f"estimator '{name}' must be a class with from_contacts, or a function of contacts;"
            f" {wrong}",
            option=option or "estimator",
            value=name,
        )
    return cast(Estimator, make)


def accepted_options(make: Callable[..., Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that a function has keywords for."""
    try:
        parameters = inspect.signature(make).parameters
    except (TypeError, ValueError):
        return dict(options)
    if any(p.kind is inspect.Parameter.VAR_KEYWORD for p in parameters.values()):
        return dict(options)
    return {name: value for name, value in options.items() if name in parameters}
