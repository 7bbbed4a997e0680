"""Mass and inertia of a true object, from the YCB set's published masses or from its volume."""

from __future__ import annotations

import csv
import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError, note, require_positive
from lis_grasp.typing import FloatArray

GRAVITY = 9.81
"""Acceleration of gravity [m/s^2]."""

USUAL_MASS = 0.2
"""Mass of an object if nothing else is known [kg]."""

USUAL_FRICTION = 0.8
"""Coulomb's coefficient of rubber fingertips on an object if nothing else is known."""

MOST_FRICTION = 100.0
"""Largest Coulomb coefficient that is accepted: far above any material's."""

LARGEST_DENSITY = 2700.0
"""Density of aluminium [kg/m^3]: small objects of unknown material are not denser."""

DENSEST = 22_600.0
"""Density of osmium [kg/m^3]: a denser object's mass is in another unit, or its mesh is hollow."""

# Objects of the YCB set are files or folders such as `006_mustard_bottle`.
_YCB_NAME = re.compile(r"\d{3}(-[a-z])?_\w+")


def note_density(mass: float, mesh: trimesh.Trimesh) -> None:
    """Warn of a mass [kg] for which a closed mesh [m] would be denser than any material."""
    volume = float(mesh.volume)
    if mass > DENSEST * volume > 0.0:
        note(
            f"mass is in kg: an object of {mass:g} kg and {1e6 * volume:.3g} cm^3 would be denser"
            " than osmium; check the unit, or whether the mesh is hollow"
        )


def require_load(*, mass: float, friction: float) -> None:
    """Raise `InvalidOptionError` unless both are above 0, and friction at most 100."""
    require_positive(mass=mass, friction=friction)
    if friction > MOST_FRICTION:
        required = f"at most {MOST_FRICTION:g}"
        raise InvalidOptionError.out_of_range("friction", friction, required)


def default_mass(mesh: trimesh.Trimesh, name: str = "") -> float:
    """Return the mass of an object [kg].

    Scans of the YCB set have the published mass (Calli et al. 2015): a file or folder in the path
    `name` identifies the object. Others weigh 0.2 kg, or as much as solid aluminium if that is
    less: a key or a pen of 0.2 kg would be denser than most metals.

    Parameters
    ----------
    mesh
        The object, closed [m].
    name
        Path of its file, or another name.
    """
    mass = published_mass(name)
    return min(USUAL_MASS, LARGEST_DENSITY * float(mesh.volume)) if mass is None else mass


def published_mass(name: str) -> float | None:
    """Return the published mass of the scan at a path [kg]; None if it is not of the YCB set."""
    for part in (Path(name).stem, *reversed(Path(name).parent.parts)):
        match = _YCB_NAME.match(part)
        if match and match.group() in ycb_masses():
            return ycb_masses()[match.group()]
    return None


@lru_cache
def ycb_masses() -> dict[str, float]:
    """Return the published masses of the objects of the YCB set [kg] (Calli et al. 2015)."""
    with Path(__file__).with_name("ycb_masses.csv").open(encoding="utf-8", newline="") as table:
        return {row["object"]: 1e-3 * float(row["mass_g"]) for row in csv.DictReader(table)}


def uniform_inertia(mesh: trimesh.Trimesh, mass: float) -> FloatArray:
    """Return the inertia of a mass [kg] spread evenly over a closed mesh, (3, 3) [kg m^2].

    It is about the centre of mass, along the axes of the mesh.
    """
    return np.asarray(mesh.moment_inertia) * (mass / mesh.volume)
