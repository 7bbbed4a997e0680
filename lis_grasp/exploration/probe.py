"""Probe, probe outcome, hand pose at a touch, and the protocols of probers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal, Protocol, get_args, runtime_checkable

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.contacts import FARTHEST, Contacts, checked_radii
from lis_grasp.exceptions import InvalidOptionError, require_at_least
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.geometry import UNIT_ROUNDING, apply_pose, inverse_pose, require_pose, rotate
from lis_grasp.records import Record, read_only, short_repr
from lis_grasp.typing import BoolArray, FloatArray

# A way is passed again if the palm is this near it [m], and turned as little [rad].
_SAME_WAY, _SAME_TURN = 0.005, 0.05

ProbeStatus = Literal["touched", "missed", "blocked"]
ProbePurpose = Literal["search", "extent", "repeat", "policy"]
Pace = Literal["gentle", "tested", "quick"]
"""Gently; gently, then at rest to feel whether the object resists; or quickly, as it did."""


@dataclass(frozen=True, slots=True, eq=False)
class PassedWay(Record):
    """Way of a hand that an earlier probe passed without a touch."""

    X_OH: FloatArray  #: (4, 4): pose of the palm where it ended, at a touch
    margin: float  #: length before the end on which the object may be met again [m]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_OH", require_pose("X_OH", self.X_OH))
        require_at_least(0, margin=self.margin)

    def length_from(self, X_OH: FloatArray, direction: FloatArray) -> float:
        """Return how far a palm at X_OH (4, 4) can go in a direction (3,) on this way [m]."""
        offset = self.X_OH[:3, 3] - X_OH[:3, 3]
        along = float(offset @ direction)
        aside = float(np.linalg.norm(offset - along * direction))
        turned = float(np.linalg.norm(self.X_OH[:3, :3] - X_OH[:3, :3], ord=2))
        if aside > _SAME_WAY or turned > _SAME_TURN:
            return 0.0
        return max(along - self.margin, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Probe(Record):
    """A guarded straight motion of a fingertip through a point where surface is expected.

    The tip's leading point moves along the line ``target + s * direction``, from
    ``s = -standoff`` to ``s = overshoot``, and stops at the first touch.

    Parameters
    ----------
    target
        Shape (3,) [m], in the object frame O: expected point of the surface.
    direction
        Shape (3,), in O: direction of the motion; normalised here.
    standoff
        Length before the target [m].
    overshoot
        Length beyond the target [m].
    slides
        Shape (K, 3) [m], in O: slides of the fingertip, the best first; one may follow.
    purpose
        What it is for: to find the object, or its ends, to repeat an earlier touch of an object
        that may move, or what the policy wants.
    passed
        Way of an earlier probe that this one repeats.
    pace
        How to touch an object that may move; see `Pace`.

    Raises
    ------
    InvalidOptionError
        If a number is not finite, the direction is zero, or a length is negative.
    """

    target: FloatArray
    direction: FloatArray
    standoff: float
    overshoot: float
    slides: FloatArray = field(default_factory=lambda: np.empty((0, 3)), repr=False)
    purpose: ProbePurpose = field(default="policy", repr=False)
    passed: PassedWay | None = field(default=None, repr=False)
    pace: Pace = field(default="gentle", repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", read_only(_vector("target", self.target)))
        object.__setattr__(self, "direction", _unit("direction", self.direction))
        for name in ("standoff", "overshoot"):
            value = float(getattr(self, name))
            require_at_least(0, **{name: value})
            object.__setattr__(self, name, value)
        slides = [_vector("slides", slide) for slide in self.slides]
        object.__setattr__(self, "slides", read_only(np.reshape(slides, (-1, 3))))

    def in_frame(self, X_EF: FloatArray) -> Probe:
        """Return the probe in a frame F with pose X_EF (4, 4)."""
        X_FE = inverse_pose(X_EF)
        target, direction = apply_pose(X_FE, self.target), rotate(X_FE, self.direction)
        slides, passed = rotate(X_FE, self.slides), self.passed
        if passed is not None:
            passed = replace(passed, X_OH=X_FE @ passed.X_OH)
        return replace(self, target=target, direction=direction, slides=slides, passed=passed)

    @property
    def start(self) -> FloatArray:
        """Start of the motion, shape (3,) [m]."""
        return self.target - self.standoff * self.direction

    @property
    def end(self) -> FloatArray:
        """End of a motion without a touch, shape (3,) [m]."""
        return self.target + self.overshoot * self.direction


@dataclass(frozen=True, slots=True, eq=False)
class HandPose(Record):
    """Pose of a hand and positions of its joints."""

    X_OH: FloatArray  #: (4, 4): pose of the palm frame H in the object frame O
    joint_positions: FloatArray  #: (J,) [rad or m], in the order of the hand's joints

    __repr__ = short_repr

    def __post_init__(self) -> None:
        positions = np.array(self.joint_positions, dtype=np.float64)
        if positions.ndim != 1 or not np.isfinite(positions).all():
            raise InvalidOptionError.out_of_range(
                "joint_positions", positions.tolist(), "a list of finite numbers"
            )
        object.__setattr__(self, "X_OH", require_pose("X_OH", self.X_OH))
        object.__setattr__(self, "joint_positions", read_only(positions))


@dataclass(frozen=True, slots=True, eq=False)
class ProbeOutcome(Record):
    """Outcome of a probe: what the hand measured.

    Parameters
    ----------
    probe
        The probe.
    status
        ``"touched"`` with at least one contact, ``"missed"`` if the motion ended without one, or
        ``"blocked"`` if it could not be carried out, or was stopped without a usable contact.
    contacts
        The contacts, in O; empty if missed (a blocked motion may have some).
    duration
        Time that the probe took [s]. Times of contacts count from its beginning.
    reason
        Why a motion was blocked; empty otherwise.
    moved
        Largest displacement of a point of the object by the touch [m].
    free_points, free_radii
        Free space that the hand passed, in O, as in `Contacts`.
    hand_pose
        Pose of the hand when it made the contacts, in their frame; None if unknown.
    slid
        How many contacts, the last ones, are at the end of a slide.
    seconds
        The duration's parts, by the kind of motion [s]; empty if unknown.
    left_at
        Joint positions of an arm, then of its hand, where the probe left them [rad or m]; empty
        without an arm, or at its home.
    resisted
        Whether a hand that rested after the touch still felt the object; None if it did not rest.

    Raises
    ------
    InvalidOptionError
        If status and contacts contradict each other, the duration or displacement is negative, or
        the reason is no text.
    InvalidContactsError
        If the radii are not one length of at least 0 for each free point.
    """

    probe: Probe
    status: ProbeStatus
    contacts: Contacts = field(default_factory=Contacts.empty)
    free_points: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    duration: float = 0.0
    reason: str = ""
    moved: float = 0.0
    free_radii: FloatArray = field(default_factory=lambda: np.empty(0))
    hand_pose: HandPose | None = None
    slid: int = 0
    seconds: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    left_at: FloatArray = field(default_factory=lambda: np.empty(0))
    resisted: bool | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.status not in get_args(ProbeStatus):
            raise InvalidOptionError.not_one_of("status", self.status, get_args(ProbeStatus))
        if (self.status == "touched" and not len(self.contacts)) or (
            self.status == "missed" and len(self.contacts)
        ):
            raise InvalidOptionError(
                f"a probe that {self.status} must have"
                f" {'a contact' if self.status == 'touched' else 'no contact'}; it has"
                f" {len(self.contacts)}",
                option="contacts",
                value=len(self.contacts),
            )
        free_points = np.array(self.free_points, dtype=np.float64).reshape(-1, 3)
        if not np.isfinite(free_points).all():
            raise InvalidOptionError.out_of_range(
                "free_points", free_points.tolist(), "finite numbers"
            )
        object.__setattr__(self, "free_points", read_only(free_points))
        object.__setattr__(self, "free_radii", checked_radii(self.free_radii, len(free_points)))
        object.__setattr__(self, "seconds", MappingProxyType(dict(self.seconds)))
        left_at = np.array(self.left_at, dtype=np.float64).reshape(-1)
        object.__setattr__(self, "left_at", read_only(left_at))
        require_at_least(0, **self.seconds)
        require_at_least(0, duration=self.duration, moved=self.moved, slid=self.slid)
        if self.slid > len(self.contacts):
            raise InvalidOptionError.out_of_range("slid", self.slid, "at most all contacts")
        if not isinstance(self.reason, str):
            raise InvalidOptionError.out_of_range("reason", self.reason, "text")

    def in_frame(self, X_EF: FloatArray) -> ProbeOutcome:
        """Return the outcome in a frame F with pose X_EF (4, 4); the probe stays as it was."""
        X_FE = inverse_pose(X_EF)
        hand_pose = self.hand_pose
        return replace(
            self,
            contacts=self.contacts.in_frame(X_EF),
            # trimesh keeps the bits of points that a pose moves by rounding only.
            free_points=np.ascontiguousarray(trimesh.transform_points(self.free_points, X_FE)),
            hand_pose=hand_pose and replace(hand_pose, X_OH=X_FE @ hand_pose.X_OH),
        )


class Prober(Protocol):
    """Carries out probes.

    Every probe and every contact is in the object frame O. A probe that cannot be carried out is an
    outcome (``"blocked"``), not an exception.
    """

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        """Carry out one probe and return its outcome.

        The approach avoids `obstacles`; None is for a hand that is already at the probe's start.
        """
        ...


@runtime_checkable
class MovingProber(Prober, Protocol):
    """A prober of an object that touches move; it gives later probes in the object's frame."""

    def move_frame(self, X_EF: FloatArray) -> None:
        """Give later probes in a frame F with pose X_EF, shape (4, 4), in the present frame."""
        ...


@runtime_checkable
class HomingProber(Prober, Protocol):
    """A prober whose robot stays where a probe left it, and goes home at the end."""

    def go_home(self) -> float:
        """Move the robot to its home, and return the time of the motion [s]."""
        ...


def end_at_home(prober: Prober) -> float:
    """Move a robot that stays where a probe left it home, and return the time of that [s]."""
    return prober.go_home() if isinstance(prober, HomingProber) else 0.0


@runtime_checkable
class SimulatedProber(Prober, Protocol):
    """A prober that knows the true pose of its object, for evaluation and for records alone."""

    @property
    def X_EO(self) -> FloatArray | None:
        """Current true pose (4, 4) of a free object in the frame of probes; None if fixed."""
        ...


def are_touches(contacts: Contacts, outcomes: Sequence[ProbeOutcome]) -> BoolArray:
    """Return which contacts of one map's outcomes, (N,), are touches, not first made by a slide."""
    if not any(outcome.slid for outcome in outcomes):
        return np.ones(len(contacts), dtype=np.bool_)
    touched = {
        point.tobytes(): k < len(outcome.contacts) - outcome.slid
        for outcome in reversed(outcomes)
        for k, point in reversed([*enumerate(outcome.contacts.points)])
    }
    return np.array([touched.get(p.tobytes(), True) for p in contacts.points], dtype=np.bool_)


def _vector(name: str, values: npt.ArrayLike) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if array.shape != (3,) or not np.all(np.abs(array) <= FARTHEST):
        raise InvalidOptionError.out_of_range(
            name, array.tolist(), f"3 finite numbers, at most {FARTHEST:g}"
        )
    return array


def _unit(name: str, values: npt.ArrayLike) -> FloatArray:
    vector = _vector(name, values)
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise InvalidOptionError.out_of_range(name, vector.tolist(), "longer than 0")
    # A unit vector keeps its bits, so that files survive any number of rounds.
    return read_only(vector if abs(length - 1.0) < UNIT_ROUNDING else vector / length)
