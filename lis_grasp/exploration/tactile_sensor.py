"""What a fingertip's sensor makes of a touch: thresholds, noise, taxels, and mistakes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.typing import FloatArray

UNKNOWN = "unknown"
"""The link of a false touch."""


@dataclass(frozen=True, slots=True)
class TactileSensor:
    """A sensor, as a function of physical contacts: the same contacts and draws give the same.

    Parameters
    ----------
    force_threshold
        Contacts of less normal force are not felt [N]; those of unknown force are.
    position_noise
        One standard deviation of a contact's position along each axis [m].
    normal_noise
        One standard deviation of each component of a normal across it [rad].
    taxel_pitch
        Distance of the taxels on the pad [m]: a contact is reported at the middle of its taxel,
        which lies anywhere. 0 for a sensor without grain.
    miss_rate
        Share of contacts that are not reported.
    false_rate
        Share of probes without a contact that report one nevertheless, anywhere on the way.

    Raises
    ------
    InvalidOptionError
        If a number is negative or not finite, or a rate above 1.
    """

    force_threshold: float = 0.0
    position_noise: float = 0.0
    normal_noise: float = 0.0
    taxel_pitch: float = 0.0
    miss_rate: float = 0.0
    false_rate: float = 0.0

    def __post_init__(self) -> None:
        for name in ("force_threshold", "position_noise", "normal_noise", "taxel_pitch"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidOptionError(f"{name} must be at least 0 and finite; it is {value}")
        for name in ("miss_rate", "false_rate"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InvalidOptionError(f"{name} must be from 0 to 1; it is {getattr(self, name)}")

    @property
    def free_margin(self) -> float:
        """How much less than its links the space that the hand passed counts as free [m].

        Two standard deviations of a contact: a hand that feels no better knows no better where it
        is, and what it felt must not be carved off for its noise.
        """
        return 2.0 * self.position_noise

    def sense(self, contacts: Contacts, *, rng: np.random.Generator) -> Contacts:
        """Return what is reported of contacts: some of them, moved and turned."""
        felt = np.ones(len(contacts), dtype=bool)
        if contacts.forces is not None:
            felt &= contacts.forces >= self.force_threshold
        felt &= rng.random(len(contacts)) >= self.miss_rate
        chosen = contacts.subset(np.flatnonzero(felt))
        normals = chosen.normals + self.normal_noise * _across(
            rng.normal(size=chosen.normals.shape), chosen.normals
        )
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        points = chosen.points + self.position_noise * rng.normal(size=chosen.points.shape)
        # The middle of a taxel is anywhere within half a pitch, along the surface.
        grain = self.taxel_pitch * rng.uniform(-0.5, 0.5, size=chosen.points.shape)
        return replace(chosen, points=points + _across(grain, chosen.normals), normals=normals)

    def report(self, outcome: ProbeOutcome, *, rng: np.random.Generator) -> ProbeOutcome:
        """Return what is reported of a probe: what it met, or what it did not meet."""
        if outcome.status == "blocked":
            return outcome
        if outcome.status == "missed":
            return self._imagine(outcome, rng) if rng.random() < self.false_rate else outcome
        reported = self.sense(outcome.contacts, rng=rng)
        if len(reported):
            return replace(outcome, contacts=reported)
        # A hand that stopped at something it did not feel knows of no contact, nor that the rest of
        # its way is free.
        return replace(
            outcome, status="blocked", contacts=reported, reason="stopped without feeling why"
        )

    def _imagine(self, outcome: ProbeOutcome, rng: np.random.Generator) -> ProbeOutcome:
        """Return what is reported of a probe that met nothing, but stopped at a false touch."""
        probe = outcome.probe
        way = rng.uniform(-probe.standoff, probe.overshoot)
        contacts = Contacts(
            (probe.target + way * probe.direction)[None],
            -probe.direction[None],
            forces=np.array([self.force_threshold]),
            fingers=(UNKNOWN,),
            times=np.array([0.5 * outcome.duration]),
        )
        passed = (outcome.free_points - probe.target) @ probe.direction <= way
        return replace(
            outcome,
            status="touched",
            contacts=contacts,
            free_points=outcome.free_points[passed],
            free_radii=outcome.free_radii[passed],
        )


def _across(vectors: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the parts of vectors (N, 3) across unit normals (N, 3)."""
    along = np.einsum("nk,nk->n", vectors, normals)
    return np.asarray(vectors - along[:, None] * normals)
