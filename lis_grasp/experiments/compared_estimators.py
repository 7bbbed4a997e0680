"""The estimators that the experiments compare, each told the sensor's noise in its own way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.experiments.baselines import BASELINES
from lis_grasp.surfaces import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    ImplicitSurface,
    LocalImplicitSurface,
    PatchImplicitSurface,
)
from lis_grasp.surfaces.kernels import KernelName
from lis_grasp.surfaces.local_implicit_surface import Beta


@dataclass(frozen=True, slots=True)
class Noise:
    """One standard deviation of contacts' positions [m] and of their normals [rad], each way."""

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

    def told(self) -> dict[str, Any]:
        """Return the options that tell an estimator of noise; none where there is none.

        Without noise every estimator keeps its own small default, which conditions its equations.
        """
        if not self.any:
            return {}
        return {"position_noise": self.position, "normal_noise": self.normal}


Contender = Callable[[Contacts, Noise], ImplicitSurface]


def _lis(beta: Beta) -> Contender:
    return lambda contacts, noise: LocalImplicitSurface.from_contacts(
        contacts, beta=beta, **noise.told()
    )


def _gpis(kernel: KernelName) -> Contender:
    return lambda contacts, noise: GaussianProcessImplicitSurface.from_contacts(
        contacts, kernel=kernel, **noise.told()
    )


OURS: Mapping[str, Contender] = MappingProxyType(
    {
        "lis": _lis("corrected"),
        "lis_as_published": _lis("as_published"),
        "lis_no_beta": _lis("none"),
        "gpis": _gpis("matern52"),
        "gpis_rbf": _gpis("rbf"),
        "gpis_thin_plate": _gpis("thin_plate"),
        "patch": lambda contacts, noise: PatchImplicitSurface.from_contacts(
            contacts, **noise.told()
        ),
        "blend": lambda contacts, noise: BlendedImplicitSurface.from_contacts(
            contacts, **noise.told()
        ),
    }
)


CONTENDERS: tuple[str, ...] = (*OURS, *BASELINES)
"""Every name that `contender` knows; some baselines need packages of their own."""


def contender(name: str) -> Contender:
    """Return an estimator of this package, or one of the baselines, by its name.

    Baselines are not told the sensor's noise: they have no place for it.
    """
    if name in OURS:
        return OURS[name]
    return lambda contacts, noise: BASELINES[name](contacts)
