"""Model of a tactile sensor: force threshold, noise, taxels, missed and false touches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, require_at_least
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.exploration.touch_detection import APPROACH_NOISE
from lis_grasp.geometry import unit
from lis_grasp.typing import FloatArray, Seed

UNKNOWN = "unknown"
"""The link of a false touch."""

REPORTS = ("normals", "touch")
"""What a sensor reports of a contact: its normal, or that there is one."""


@dataclass(frozen=True, slots=True)
class TactileSensor:
    """A tactile sensor: a function of the true contacts and of random draws.

    Parameters
    ----------
    force_threshold
        Contacts of pads with less total normal force are not detected [N].
    position_noise
        One standard deviation of a contact's position along each axis [m].
    normal_noise
        One standard deviation of each component of a normal perpendicular to it [rad].
    taxel_pitch
        Distance of the taxels on the pad [m]: a contact is reported at the centre of its taxel. 0
        for a continuous sensor.
    miss_rate
        Fraction of contacts that are not reported.
    false_rate
        Fraction of probes without a contact that report one, anywhere along the motion.
    reports
        "normals", or "touch" for a switch, which reports only that there is a contact: its normal
        is then taken to be against the probe's direction, with the noise of such normals.

    Raises
    ------
    InvalidOptionError
        If a number is negative or not finite, a rate above 1, or `reports` is neither.
    """

    force_threshold: float = 0.0
    position_noise: float = 0.0
    normal_noise: float = 0.0
    taxel_pitch: float = 0.0
    miss_rate: float = 0.0
    false_rate: float = 0.0
    reports: Literal["normals", "touch"] = "normals"

    def __post_init__(self) -> None:
        require_at_least(0, force_threshold=self.force_threshold, taxel_pitch=self.taxel_pitch)
        require_at_least(0, position_noise=self.position_noise, normal_noise=self.normal_noise)
        for name in ("miss_rate", "false_rate"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise InvalidOptionError.out_of_range(name, value, "from 0 to 1")
        if self.reports not in REPORTS:
            raise InvalidOptionError.not_one_of("reports", self.reports, REPORTS)

    @property
    def free_margin(self) -> float:
        """Distance by which the free space of a link is smaller than the link [m].

        Two standard deviations of a contact's position: a contact must not be removed by its
        noise.
        """
        return 2.0 * self.position_noise

    def sense(self, contacts: Contacts, *, rng: Seed = 0) -> Contacts:
        """Return the reported contacts: detected ones, which carry their noise."""
        rng = np.random.default_rng(rng)
        detected = np.ones(len(contacts), dtype=bool)
        if contacts.forces is not None:
            detected &= _force_on_pad(contacts) >= self.force_threshold
        detected &= rng.random(len(contacts)) >= self.miss_rate
        chosen = contacts.subset(np.flatnonzero(detected))
        normals = chosen.normals + self.normal_noise * _tangential(
            rng.normal(size=chosen.normals.shape), chosen.normals
        )
        normals = unit(normals)
        points = chosen.points + self.position_noise * rng.normal(size=chosen.points.shape)
        # The centre of the taxel is within half a pitch, along the surface.
        offset = self.taxel_pitch * rng.uniform(-0.5, 0.5, size=chosen.points.shape)
        points += _tangential(offset, chosen.normals)
        return self._with_noise(replace(chosen, points=points, normals=normals))

    def report(self, outcome: ProbeOutcome, *, rng: np.random.Generator) -> ProbeOutcome:
        """Return the reported outcome of a probe."""
        if outcome.status == "blocked":
            return outcome
        if outcome.status == "missed":
            return self._false_touch(outcome, rng) if rng.random() < self.false_rate else outcome
        made = len(outcome.contacts) - outcome.slid
        reported = self.sense(outcome.contacts[:made], rng=rng)
        if len(reported):
            end = outcome.contacts[made:]
            end = self.sense(end, rng=rng) if len(end) else end
            contacts = reported.append(end)
            if self.reports == "touch":
                contacts = _against(contacts, outcome.probe.direction)
            return replace(outcome, contacts=contacts, slid=len(end))
        # The hand stopped at a contact that it did not detect: the rest of its path is not free.
        reason = "stopped at an undetected contact"
        return replace(outcome, status="blocked", contacts=reported, reason=reason, slid=0)

    def _with_noise(self, contacts: Contacts) -> Contacts:
        """Return contacts that carry the sensor's noise, where it has any."""
        count, position, normal = len(contacts), self.position_noise, self.normal_noise
        return replace(
            contacts,
            position_noise=np.full(count, position) if position else contacts.position_noise,
            normal_noise=np.full(count, normal) if normal else contacts.normal_noise,
        )

    def _false_touch(self, outcome: ProbeOutcome, rng: np.random.Generator) -> ProbeOutcome:
        """Return a missed probe as if it had stopped at a contact."""
        probe = outcome.probe
        stop = rng.uniform(-probe.standoff, probe.overshoot)
        contacts = Contacts(
            (probe.target + stop * probe.direction)[None],
            -probe.direction[None],
            forces=np.array([self.force_threshold]),
            fingers=(UNKNOWN,),
            times=np.array([0.5 * outcome.duration]),
        )
        contacts = self._with_noise(contacts)
        passed = (outcome.free_points - probe.target) @ probe.direction <= stop
        return replace(
            outcome,
            status="touched",
            contacts=contacts,
            free_points=outcome.free_points[passed],
            free_radii=outcome.free_radii[passed],
        )


def _against(contacts: Contacts, direction: FloatArray) -> Contacts:
    """Return contacts whose normals are taken to be against a direction (3,)."""
    normals = np.tile(-direction, (len(contacts), 1))
    return replace(contacts, normals=normals, normal_noise=np.full(len(contacts), APPROACH_NOISE))


def _force_on_pad(contacts: Contacts) -> FloatArray:
    """Return the force on the pad of each contact, shape (N,) [N].

    A touch across an edge makes two contacts, which share the force on the pad.
    """
    forces = np.asarray(contacts.forces)
    if not contacts.fingers:
        return forces
    _, pads = np.unique(np.asarray(contacts.fingers), return_inverse=True)
    return np.asarray(np.bincount(pads, weights=forces)[pads])


def _tangential(vectors: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the parts of vectors (N, 3) perpendicular to unit normals (N, 3)."""
    along = np.einsum("nk,nk->n", vectors, normals)
    return np.asarray(vectors - along[:, None] * normals)
