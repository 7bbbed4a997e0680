"""Estimators that the experiments compare, their settings, and levels of sensor noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial, wraps
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.plugins import Registry
from lis_grasp.surfaces import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    ImplicitSurface,
    LocalImplicitSurface,
    PatchImplicitSurface,
    SmoothImplicitSurface,
)
from lis_grasp.surfaces.estimators import find_estimator
from lis_grasp_studies.baselines import (
    BASELINES,
    HermiteRBFSurface,
    MeshLabSurface,
    OffsetSurface,
    PrimitiveCSGSurface,
)


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
"""Makes a surface of contacts, given the noise of their sensor."""

Maker = Callable[..., ImplicitSurface]
"""Makes a surface of contacts; options are those of `Noise.options` and its own."""

Settings = Mapping[str, Any]
"""Options of an estimator."""


def _unaware_of_noise(make: Maker) -> Maker:
    """Return an estimator that takes the options of noise, and ignores them."""

    @wraps(make)
    def made(
        contacts: Contacts,
        *,
        position_noise: float | None = None,
        normal_noise: float | None = None,
        **settings: Any,
    ) -> ImplicitSurface:
        return make(contacts, **settings)

    return made


OURS: Mapping[str, Maker] = {
    "lis": partial(LocalImplicitSurface.from_contacts, beta="corrected"),
    "lis_as_published": partial(LocalImplicitSurface.from_contacts, beta="as_published"),
    "lis_no_beta": partial(LocalImplicitSurface.from_contacts, beta="none"),
    "gpis": partial(GaussianProcessImplicitSurface.from_contacts, kernel="matern52"),
    "gpis_rbf": partial(GaussianProcessImplicitSurface.from_contacts, kernel="rbf"),
    "gpis_thin_plate": partial(GaussianProcessImplicitSurface.from_contacts, kernel="thin_plate"),
    "smooth": SmoothImplicitSurface.from_contacts,
    "patch": PatchImplicitSurface.from_contacts,
    "blend": BlendedImplicitSurface.from_contacts,
}
"""Estimators of this package by name."""

COMPARED = Registry(
    "estimator", {**OURS, **{name: _unaware_of_noise(make) for name, make in BASELINES.items()}}
)
"""Every estimator with its defaults; no baseline is given the noise."""


def _gpis(contacts: Contacts, *, length: float | None, **options: Any) -> ImplicitSurface:
    """Fit a GPIS whose length is given in largest distances between contacts."""
    if length is not None and len(contacts) > 1:
        options["length"] = length * float(pdist(contacts.points).max())
    return GaussianProcessImplicitSurface.from_contacts(contacts, **options)


def _combined(**values: tuple[Any, ...]) -> tuple[Settings, ...]:
    """Return all combinations of values of settings."""
    return tuple(dict(zip(values, chosen, strict=True)) for chosen in product(*values.values()))


@dataclass(frozen=True, slots=True)
class Competitor:
    """An estimator with the settings that were best on development contact sets."""

    make: Maker
    searched: tuple[Settings, ...]
    """Settings that `benchmarks/bench_settings.py` compares."""
    chosen: Settings
    """The best of `searched`, by the geometric mean of both errors over development sets."""
    package: str = ""
    """What it needs, of the extra `baselines`."""


_MISFITS = ((0.0003, 0.03), (0.001, 0.1), (0.003, 0.2))

_POISSON: Mapping[str, tuple[Any, ...]] = {"depth": (5,), "fulldepth": (3,)}
_SAMPLES = (0.03, 0.1, 0.3)
_BEST_POISSON = {"depth": 5, "fulldepth": 3, "weight": 100.0, "scale": 2.0, "samples": 0.1}

COMPETITORS: Mapping[str, Competitor] = MappingProxyType(
    {
        "gpis_best": Competitor(
            _gpis,
            (
                *_combined(kernel=("matern52",), length=(0.4, 0.8, 1.6), misfit=_MISFITS),
                *_combined(kernel=("rbf",), length=(0.2, 0.4, 0.8), misfit=_MISFITS),
                *_combined(kernel=("thin_plate",), length=(None,), misfit=_MISFITS),
            ),
            {"kernel": "matern52", "length": 0.8, "misfit": (0.001, 0.1)},
        ),
        "hermite_rbf": Competitor(
            HermiteRBFSurface.from_contacts,
            _combined(smoothing=tuple((0.02 * n, n) for n in (0.0, 0.03, 0.1, 0.3))),
            {"smoothing": (0.0, 0.0)},
        ),
        "thin_plate": Competitor(
            _unaware_of_noise(OffsetSurface.thin_plate),
            _combined(offset=(0.05, 0.1, 0.25), smoothing=(0.0, 1e-3)),
            {"offset": 0.1, "smoothing": 0.0},
        ),
        "ransac_csg": Competitor(
            PrimitiveCSGSurface.from_contacts,
            _combined(tolerance=(0.005, 0.01, 0.02), angle=(0.03, 0.06, 0.1, 0.2)),
            {"tolerance": 0.02, "angle": 0.1},
        ),
        "poisson": Competitor(
            _unaware_of_noise(MeshLabSurface.screened_poisson),
            (
                *_combined(**_POISSON, weight=(100.0, 400.0), scale=(1.5, 2.0), samples=_SAMPLES),
                *_combined(**_POISSON, weight=(100.0,), scale=(3.0,), samples=_SAMPLES),
                *_combined(**_POISSON, weight=(4.0, 20.0), scale=(2.0,), samples=(0.1,)),
                *({**_BEST_POISSON, "depth": depth} for depth in (4, 6)),
                *({"depth": depth} for depth in (3, 4)),  # and MeshLab's defaults
            ),
            _BEST_POISSON,
            "pymeshlab",
        ),
        "apss": Competitor(
            _unaware_of_noise(MeshLabSurface.algebraic),
            _combined(support=(1.1, 1.25, 1.5, 2.0), cells=(32,)),
            {"support": 1.25, "cells": 32},
            "pymeshlab",
        ),
    }
)
"""Competitors of the study of surfaces by name. The settings of the last two, which need pymeshlab,
were chosen for the touch benchmark: by `bench_settings.py --touched 24`."""

TUNED = Registry(
    "estimator", {**OURS, **{n: partial(c.make, **c.chosen) for n, c in COMPETITORS.items()}}
)
"""Estimators of this package with their defaults, and competitors with their chosen settings."""


def given_noise(make: Maker) -> NoisyEstimator:
    """Return an estimator as a function of contacts and noise."""
    return lambda contacts, noise: make(contacts, **noise.options())


def compared_estimator(name: str, registry: Registry = COMPARED) -> NoisyEstimator:
    """Return an estimator of a registry, or a plug-in, by its name.

    Errors as of `find_estimator`.
    """
    return given_noise(find_estimator(name, registry=registry))
