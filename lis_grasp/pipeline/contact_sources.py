"""Contacts of several sensors: files joined, each with its own noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.io import provenance
from lis_grasp.surfaces import load_contacts
from lis_grasp.surfaces.contact_loading import NormalSide
from lis_grasp.surfaces.contact_noise import noise_of
from lis_grasp.surfaces.contact_thinning import thin_contacts
from lis_grasp.surfaces.noise_estimation import estimate_noise

# An exploration estimates the surface after every touch: more contacts of a cloud are thinned.
_MOST_OF_CLOUD = 300


def load_source(
    path: Path | str,
    *,
    units: str = "m",
    normals: NormalSide | None = None,
    position_noise: float | None = None,
    normal_noise: float | None = None,
    fingertip_radius: float = 0.0,
) -> Contacts:
    """Load the contacts of one sensor, with the noise of each.

    A contact's noise is that of the file's columns, else what is given [m] and [rad], else what the
    file's header says of its sensor, else the estimate from the file's contacts. It stays unknown
    where they do not determine it. Normals that the file lacks are estimated, and
    the points may be centres of a fingertip: arguments and errors are those of `load_contacts`.
    """
    recorded = provenance.read(Path(path))
    if position_noise is None:
        position_noise = _positive(recorded.get("position_noise"))
    if normal_noise is None:
        normal_noise = _positive(recorded.get("normal_noise"))
    contacts = load_contacts(
        path,
        units=units,
        normals=normals,
        fingertip_radius=fingertip_radius,
        position_noise=position_noise,
    )
    position, normal = noise_of(
        contacts,
        position_noise,
        normal_noise,
        default=(np.nan, np.nan),
    )
    if np.isnan(position).any() or np.isnan(normal).any():
        estimates = estimate_noise(contacts)
        position = np.where(np.isnan(position), estimates[0], position)
        normal = np.where(np.isnan(normal), estimates[1], normal)
    return replace(contacts, position_noise=position, normal_noise=normal)


def join_sources(
    paths: Sequence[Path | str],
    *,
    units: str = "m",
    normals: NormalSide | None = None,
    position_noise: float | None = None,
    normal_noise: float | None = None,
    fingertip_radii: Sequence[float] | None = None,
) -> Contacts:
    """Load the contacts of several sensors, one file each, as of `load_source`, and join them.

    `fingertip_radii` [m] has one for each file; None takes 0.
    """
    joined = Contacts.empty()
    for path, radius in zip(paths, fingertip_radii or [0.0] * len(paths), strict=True):
        contacts = load_source(
            path,
            units=units,
            normals=normals,
            position_noise=position_noise,
            normal_noise=normal_noise,
            fingertip_radius=radius,
        )
        joined = joined.append(contacts)
    return joined


def prior_contacts(cloud: Contacts) -> Contacts:
    """Return a cloud as the prior knowledge of an exploration: thinned, with its free space."""
    thinned = thin_contacts(cloud, _MOST_OF_CLOUD)
    return replace(thinned, free_points=cloud.free_points, free_radii=cloud.free_radii)


def _positive(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and value > 0.0 else None
