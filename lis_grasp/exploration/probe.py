"""An attempt to touch an object, what came of it, and the role of whatever can make it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import FARTHEST, Contacts, checked_radii
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.records import read_only
from lis_grasp.typing import FloatArray

if TYPE_CHECKING:
    from lis_grasp.exploration.known_shape import KnownShape


ProbeStatus = Literal["touched", "missed", "blocked"]

# Normalising rounds a length by no more than this.
_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True, eq=False)
class Probe:
    """A guarded straight motion of a fingertip through a point where surface is expected.

    The tip's leading point moves along the line ``target + s * direction``, from
    ``s = -standoff`` to ``s = overshoot``, and stops at the first touch.

    Parameters
    ----------
    target
        Shape (3,) [m], in the object frame O: where the surface is expected.
    direction
        Shape (3,), in O: the way the fingertip moves; normalised here.
    standoff
        How far before the target the motion starts [m].
    overshoot
        How far beyond the target it goes on before it gives up [m].

    Raises
    ------
    InvalidOptionError
        If a number is not finite, the direction is zero, or a length is negative.
    """

    target: FloatArray
    direction: FloatArray
    standoff: float
    overshoot: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", read_only(_vector("target", self.target)))
        object.__setattr__(self, "direction", _unit("direction", self.direction))
        for name in ("standoff", "overshoot"):
            value = float(getattr(self, name))
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidOptionError(
                    f"a probe's {name} must be a length of at least 0 m; it is {value}"
                )
            object.__setattr__(self, name, value)

    @property
    def start(self) -> FloatArray:
        """Where the motion starts, shape (3,) [m]."""
        return self.target - self.standoff * self.direction

    @property
    def end(self) -> FloatArray:
        """Where the motion gives up, shape (3,) [m]."""
        return self.target + self.overshoot * self.direction


@dataclass(frozen=True, slots=True, eq=False)
class HandPose:
    """Pose of a hand and positions of its joints.

    Parameters
    ----------
    X_OH
        Shape (4, 4): pose of the palm frame H in the object frame O.
    joint_positions
        Shape (J,) [rad or m], in the order of the hand's joints.

    Raises
    ------
    InvalidOptionError
        If a shape is wrong or a number is not finite.
    """

    X_OH: FloatArray
    joint_positions: FloatArray

    def __post_init__(self) -> None:
        for name, required in (("X_OH", "4 x 4"), ("joint_positions", "a list of")):
            array = np.array(getattr(self, name), dtype=np.float64)
            fits = array.shape == (4, 4) if name == "X_OH" else array.ndim == 1
            if not (fits and np.isfinite(array).all()):
                raise InvalidOptionError.out_of_range(
                    name, array.tolist(), f"{required} finite numbers"
                )
            object.__setattr__(self, name, read_only(array))


def _no_points() -> FloatArray:
    return np.empty((0, 3))


@dataclass(frozen=True, slots=True, eq=False)
class ProbeOutcome:
    """What came of a probe.

    Parameters
    ----------
    probe
        The attempt.
    status
        ``"touched"``: there is at least one contact; ``"missed"``: the motion reached its end, or
        beyond its target the table, and felt nothing; ``"blocked"``: the motion could not be
        carried out (out of reach, or the hand was stopped before its end by something that gave no
        usable contact).
    contacts
        What was felt, in O; empty unless touched (a blocked motion may have felt something too).
    free_points
        Shape (K, 3) [m], in O: places that the hand passed through and felt nothing.
    duration
        Time that the attempt took [s]: simulated, or on a robot's clock. Times of contacts count
        from its beginning.
    reason
        Why a motion was blocked; empty otherwise.
    moved
        By how much the touch moved the object, at its farthest point [m].
    free_radii
        Shape (K,) [m]: so far round each of the free points the hand filled space; 0 where only the
        point is known to be free, as of all of them if this is left empty.
    hand_pose
        Where the hand and its joints were when it made the contacts, in the object frame O at that
        time; None if the prober does not know.

    Raises
    ------
    InvalidOptionError
        If status and contacts contradict each other, the duration or the way that the object
        moved is negative, or the reason is no text.
    InvalidContactsError
        If the radii are not one length of at least 0 for each free point.
    """

    probe: Probe
    status: ProbeStatus
    contacts: Contacts = field(default_factory=Contacts.empty)
    free_points: FloatArray = field(default_factory=_no_points)
    duration: float = 0.0
    reason: str = ""
    moved: float = 0.0
    free_radii: FloatArray = field(default_factory=lambda: np.empty(0))
    hand_pose: HandPose | None = None

    def __post_init__(self) -> None:
        if self.status not in get_args(ProbeStatus):
            known = ", ".join(get_args(ProbeStatus))
            raise InvalidOptionError(f"status must be one of {known}; it is '{self.status}'")
        if self.status == "touched" and not len(self.contacts):
            raise InvalidOptionError("a probe that touched must come with a contact; there is none")
        if self.status == "missed" and len(self.contacts):
            raise InvalidOptionError(
                f"a probe that missed felt nothing, but comes with {len(self.contacts)} contacts"
            )
        free_points = np.array(self.free_points, dtype=np.float64).reshape(-1, 3)
        if not np.isfinite(free_points).all():
            raise InvalidOptionError("free_points must be finite numbers")
        object.__setattr__(self, "free_points", read_only(free_points))
        object.__setattr__(self, "free_radii", checked_radii(self.free_radii, len(free_points)))
        for name, unit in (("duration", "s"), ("moved", "m")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidOptionError(f"{name} must be at least 0 {unit}; it is {value}")
        if not isinstance(self.reason, str):
            raise InvalidOptionError(f"reason must be words; it is {self.reason!r}")


class Prober(Protocol):
    """Whatever can carry out a probe: a simulated hand, a real one, or geometry alone.

    The object does not move: every probe is given, and every contact reported, in the same
    object frame O. A probe that cannot be carried out is an outcome (``"blocked"``), no exception.
    """

    def probe(self, probe: Probe, known: KnownShape | None = None) -> ProbeOutcome:
        """Carry out one probe and report what was felt.

        Parameters
        ----------
        probe
            The attempt.
        known
            What the hand keeps clear of on its way to where the probe starts; None where it is
            there already.
        """
        ...


def _vector(name: str, values: npt.ArrayLike) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if array.shape != (3,) or not np.all(np.abs(array) <= FARTHEST):
        raise InvalidOptionError(
            f"a probe's {name} must be 3 finite numbers, at most {FARTHEST:g}; it is"
            f" {array.tolist()}"
        )
    return array


def _unit(name: str, values: npt.ArrayLike) -> FloatArray:
    vector = _vector(name, values)
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise InvalidOptionError(f"a probe's {name} must not be zero; give the way it moves")
    # A unit vector stays as it is to the last bit, so that files survive any number of rounds.
    return read_only(vector if abs(length - 1.0) < _ROUNDING else vector / length)
