"""Competitors of the study, each with the settings that were best on development shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.pipeline.plugged_in import find_estimator
from lis_grasp.plugins import Registry
from lis_grasp.surfaces import GaussianProcessImplicitSurface, ImplicitSurface
from lis_grasp.surfaces.gaussian_process import KernelName
from lis_grasp_studies.baselines import (
    HermiteRBFSurface,
    MeshLabSurface,
    OffsetSurface,
    PrimitiveCSGSurface,
)
from lis_grasp_studies.compared_estimators import OURS, Noise, NoisyEstimator

Settings = Mapping[str, Any]
"""Options of a competitor."""


def _gpis(
    contacts: Contacts, noise: Noise, *, kernel: KernelName, length: float | None, **options: Any
) -> ImplicitSurface:
    """Fit a GPIS whose length is given in largest distances between contacts."""
    if length is not None and len(contacts) > 1:
        options["length"] = length * float(pdist(contacts.points).max())
    return GaussianProcessImplicitSurface.from_contacts(
        contacts, kernel=kernel, **options, **noise.options()
    )


def _hermite(contacts: Contacts, noise: Noise, **settings: Any) -> ImplicitSurface:
    return HermiteRBFSurface.from_contacts(contacts, **settings, **noise.options())


def _ransac(contacts: Contacts, noise: Noise, **settings: Any) -> ImplicitSurface:
    return PrimitiveCSGSurface.from_contacts(contacts, **settings, **noise.options())


def _thin_plate(contacts: Contacts, noise: Noise, **settings: Any) -> ImplicitSurface:
    return OffsetSurface.thin_plate(contacts, **settings)


def _poisson(contacts: Contacts, noise: Noise, **settings: Any) -> ImplicitSurface:
    return MeshLabSurface.poisson(contacts, **settings)


_MAKERS: Mapping[str, Callable[..., ImplicitSurface]] = MappingProxyType(
    {
        "gpis_best": _gpis,
        "hermite_rbf": _hermite,
        "thin_plate": _thin_plate,
        "ransac_csg": _ransac,
        "poisson": _poisson,
    }
)

SEARCHED: Mapping[str, tuple[Settings, ...]] = MappingProxyType(
    {
        "gpis_best": tuple(
            {"kernel": kernel, "length": length, "misfit": misfit}
            for kernel, lengths in (
                ("matern52", (0.4, 0.8, 1.6)),
                ("rbf", (0.2, 0.4, 0.8)),
                ("thin_plate", (None,)),
            )
            for length in lengths
            for misfit in ((0.0003, 0.03), (0.001, 0.1), (0.003, 0.2))
        ),
        "hermite_rbf": tuple(
            {"smoothing": (0.02 * normal, normal)} for normal in (0.0, 0.03, 0.1, 0.3)
        ),
        "thin_plate": tuple(
            {"offset": offset, "smoothing": smoothing}
            for offset in (0.05, 0.1, 0.25)
            for smoothing in (0.0, 1e-3)
        ),
        "ransac_csg": tuple(
            {"tolerance": tolerance, "angle": angle}
            for tolerance in (0.005, 0.01, 0.02)
            for angle in (0.03, 0.06, 0.1, 0.2)
        ),
        "poisson": tuple(
            {"depth": depth, "pointweight": weight} for depth in (3, 4, 5) for weight in (1.0, 10.0)
        ),
    }
)
"""Settings of each competitor that `benchmarks/bench_settings.py` compares on development sets."""

CHOSEN: Mapping[str, Settings] = MappingProxyType(
    {
        "gpis_best": {"kernel": "matern52", "length": 0.8, "misfit": (0.001, 0.1)},
        "hermite_rbf": {"smoothing": (0.0, 0.0)},
        "thin_plate": {"offset": 0.1, "smoothing": 0.0},
        "ransac_csg": {"tolerance": 0.02, "angle": 0.1},
        "poisson": {"depth": 4, "pointweight": 10.0},
    }
)
"""The best of `SEARCHED`, by the geometric mean of both errors over development sets."""

COMPETITORS: tuple[str, ...] = tuple(_MAKERS)
"""Names of the competitors; `poisson` needs pymeshlab."""


def with_settings(name: str, settings: Settings) -> NoisyEstimator:
    """Return a competitor with settings of its own."""
    return partial(_MAKERS[name], **settings)


STUDIED = Registry("estimator", {**OURS, **{n: with_settings(n, CHOSEN[n]) for n in COMPETITORS}})
"""Every name that `studied_estimator` knows."""


def studied_estimator(name: str) -> NoisyEstimator:
    """Return an estimator of this package with its defaults, a competitor as chosen, or a plug-in.

    Errors as of `find_estimator`.
    """
    make = find_estimator(name, registry=STUDIED)
    if name in _MAKERS:
        return make
    return lambda contacts, noise: make(contacts, **noise.options())
