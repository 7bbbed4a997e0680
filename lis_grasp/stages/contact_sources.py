"""Contacts of several sensors: files joined, each with its own noise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.surfaces import load_contacts
from lis_grasp.surfaces.contact_checks import NormalSide
from lis_grasp.surfaces.contact_preparation import thin_contacts, with_noise
from lis_grasp.task.recorded_facts import read_facts

# An exploration estimates the surface after every touch: a cloud with more contacts is thinned.
_MOST_OF_CLOUD = 300


@dataclass(frozen=True, slots=True)
class ContactSource:
    """A file of contacts of one sensor, and what the file does not say about them.

    Parameters
    ----------
    path
        The file.
    units, normals, fingertip_radius, viewpoint
        The arguments of `load_contacts`.
    position_noise, normal_noise
        Noise [m], [rad] of contacts that do not carry their own; None for the noise that the
        file's header states for its sensor, or else an estimate from the file's contacts.

    Examples
    --------
    >>> pipeline.ContactSource("contacts.csv", units="mm").units
    'mm'
    """

    path: Path | str
    units: str | None = None
    normals: NormalSide | None = None
    position_noise: float | None = None
    normal_noise: float | None = None
    fingertip_radius: float = 0.0
    viewpoint: Sequence[float] | None = None


def read_source(source: ContactSource) -> tuple[Contacts, dict[str, Any]]:
    """Return the contacts of a file, and the facts that it records.

    Missing normals are estimated; simulated ones are outward. For errors see
    `load_contacts`.
    """
    recorded, noise = read_facts(Path(source.path)), source.position_noise
    contacts = load_contacts(
        source.path,
        units=source.units,
        normals=source.normals or ("outward" if "object" in recorded else None),
        fingertip_radius=source.fingertip_radius,
        viewpoint=source.viewpoint,
        position_noise=_positive(recorded.get("position_noise")) if noise is None else noise,
    )
    return contacts, recorded


def load_source(source: ContactSource) -> Contacts:
    """Load the contacts of one sensor, with the noise of each.

    The noise stays unknown if the contacts do not determine it. See `read_source`.
    """
    contacts, recorded = read_source(source)
    given = [
        _positive(recorded.get(name)) if value is None else value
        for name, value in (
            ("position_noise", source.position_noise),
            ("normal_noise", source.normal_noise),
        )
    ]
    return with_noise(contacts, *given)


def join_sources(sources: Iterable[ContactSource]) -> Contacts:
    """Load the contacts of several sensors by `load_source`, and join them."""
    return sum(map(load_source, sources), Contacts.empty())


def load_cloud(path: str | None) -> Contacts:
    """Load the contacts known before the first touch; no contacts for None.

    For errors see `load_source`.
    """
    if path is None:
        return Contacts.empty()
    try:
        return load_source(ContactSource(path))
    except InvalidContactsError as error:  # options of `estimate` would help
        advice = "in lis-grasp estimate: name the contacts.ply that it writes as `cloud`"
        raise InvalidContactsError(f"{error}, {advice}", field=error.field) from None


def prior_contacts(cloud: Contacts) -> Contacts:
    """Return a cloud as the prior knowledge of an exploration: thinned, with its free space."""
    thinned = thin_contacts(cloud, _MOST_OF_CLOUD)
    return replace(thinned, free_points=cloud.free_points, free_radii=cloud.free_radii)


def _positive(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and value > 0.0 else None
