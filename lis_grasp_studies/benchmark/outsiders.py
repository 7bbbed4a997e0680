"""Estimators by packages of others, with settings chosen on development objects, as plug-ins."""

from __future__ import annotations

from typing import ClassVar

from lis_grasp.contacts import Contacts
from lis_grasp_studies.baselines import MeshLabSurface, OffsetSurface
from lis_grasp_studies.estimators import COMPETITORS

OUTSIDERS = tuple(f"{__name__}:{name}" for name in ("screened_poisson", "apss", "thin_plate"))
"""Names of this module's plug-ins, which have rows among the baselines of `surfaces`."""


def screened_poisson(contacts: Contacts, *, position_noise: float = 0.0) -> MeshLabSurface:
    """Reconstruct by MeshLab's screened Poisson (Kazhdan and Hoppe 2013).

    Positions [m] have that standard deviation. The extra `baselines` has the package.
    """
    chosen = COMPETITORS["poisson"].chosen
    return MeshLabSurface.screened_poisson(contacts, **chosen, position_noise=position_noise)


def apss(contacts: Contacts, *, position_noise: float = 0.0) -> MeshLabSurface:
    """Reconstruct by MeshLab's algebraic point set surfaces (Guennebaud and Gross 2007).

    Positions [m] have that standard deviation. The extra `baselines` has the package.
    """
    chosen = COMPETITORS["apss"].chosen
    return MeshLabSurface.algebraic(contacts, **chosen, position_noise=position_noise)


class NoisySurface(OffsetSurface):
    """`OffsetSurface` with the errors that it has between touches, and by their noise."""

    __slots__ = ()
    error: ClassVar[float] = 0.32
    misfit: ClassVar[float] = 0.04


def thin_plate(contacts: Contacts, *, position_noise: float = 0.0) -> OffsetSurface:
    """Interpolate offset points by SciPy's RBFInterpolator, a thin-plate spline (Carr et al. 2001).

    Positions [m] have that standard deviation.
    """
    chosen = COMPETITORS["thin_plate"].chosen
    return NoisySurface.thin_plate(contacts, **chosen, position_noise=position_noise)
