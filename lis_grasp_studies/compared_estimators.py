"""Estimators and sensor noise levels that the experiments compare."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidContactsError
from lis_grasp.pipeline.plugged_in import find_estimator
from lis_grasp.plugins import Registry
from lis_grasp.surfaces import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    ImplicitSurface,
    LocalImplicitSurface,
    PatchImplicitSurface,
)
from lis_grasp_studies.baselines import BASELINES


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviation of contact positions [m] and normals [rad], along each axis."""

    position: float = 0.0
    normal: float = 0.0

    def disturb(self, contacts: Contacts, *, rng: np.random.Generator) -> Contacts:
        """Return the contacts, each moved and its normal turned at random."""
        if not self.any:
            return contacts
        normals = contacts.normals + self.normal * rng.normal(size=contacts.normals.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        points = contacts.points + self.position * rng.normal(size=contacts.points.shape)
        return Contacts(points, normals)

    @property
    def any(self) -> bool:
        """Whether there is noise."""
        return self.position > 0.0 or self.normal > 0.0

    def options(self) -> dict[str, Any]:
        """Return an estimator's options for this noise; none without noise.

        Without noise every estimator keeps its own small default, which conditions its equations.
        """
        if not self.any:
            return {}
        return {"position_noise": self.position, "normal_noise": self.normal}


NoisyEstimator = Callable[[Contacts, Noise], ImplicitSurface]

OURS: Mapping[str, Callable[..., ImplicitSurface]] = {
    "lis": partial(LocalImplicitSurface.from_contacts, beta="corrected"),
    "lis_as_published": partial(LocalImplicitSurface.from_contacts, beta="as_published"),
    "lis_no_beta": partial(LocalImplicitSurface.from_contacts, beta="none"),
    "gpis": partial(GaussianProcessImplicitSurface.from_contacts, kernel="matern52"),
    "gpis_rbf": partial(GaussianProcessImplicitSurface.from_contacts, kernel="rbf"),
    "gpis_thin_plate": partial(GaussianProcessImplicitSurface.from_contacts, kernel="thin_plate"),
    "patch": PatchImplicitSurface.from_contacts,
    "blend": BlendedImplicitSurface.from_contacts,
}
"""Estimators of this package by name; each takes contacts, and options for the sensor's noise."""

COMPARED = Registry("estimator", {**OURS, **BASELINES})
"""Every name that `compared_estimator` knows; some baselines need packages of their own."""


def compared_estimator(name: str) -> NoisyEstimator:
    """Return an estimator of this package, a baseline, or a plug-in, by its name.

    Baselines have no option for the sensor's noise. Errors as of `find_estimator`.
    """
    make = find_estimator(name, registry=COMPARED)
    if name in BASELINES:
        return lambda contacts, noise: make(contacts)
    return lambda contacts, noise: make(contacts, **noise.options())


def require_installed(
    names: Iterable[str], find: Callable[[str], NoisyEstimator] = compared_estimator
) -> None:
    """Raise `InvalidOptionError` if a package of an estimator is missing: every row would fail.

    `find` returns the estimator of a name; those of this package need no package of their own.
    """
    axes = np.vstack([np.eye(3), -np.eye(3)])
    for name in names:
        if name not in OURS:
            with suppress(EstimationError, InvalidContactsError):
                find(name)(Contacts(0.03 * axes, axes), Noise())
