"""Touch log of an exploration, `touches.jsonl`: every probe and what it showed, to resume from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, InvalidInputError
from lis_grasp.exploration.beside_rows import (
    BodyTouchEntry,
    RefusedEntry,
    beside_rows,
    with_rows,
)
from lis_grasp.exploration.disturbance import Disturbance
from lis_grasp.exploration.observations import Observation
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.exploration.probe import (
    HandPose,
    Probe,
    ProbeOutcome,
    ProbePurpose,
    ProbeStatus,
)
from lis_grasp.geometry import require_pose
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.io.json_lines import Row, append_lines, read_lines
from lis_grasp.io.schemas import FileRecord, Number, Pose, Vector, checked
from lis_grasp.records import Record, fields_of
from lis_grasp.typing import FloatArray

_END = "ended"


@dataclass(frozen=True, slots=True, eq=False)
class LoggedProbe(Record):
    """A row of a touch log: what a probe showed, and the truth in simulation."""

    observation: Observation
    #: (4, 4): true pose of a free object after the probe, in the frame of its contacts
    X_EO: FloatArray | None = None
    #: what it and earlier probes did to the bodies beside the object; None if as before
    disturbance: Disturbance | None = None

    def __post_init__(self) -> None:
        if self.X_EO is not None:
            object.__setattr__(self, "X_EO", require_pose("simulated_pose", self.X_EO))


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Content of a touch log."""

    probes: tuple[LoggedProbe, ...]  #: in order; none if facts have changed
    ending: str | None  #: reason for which the exploration ended; None if it did not
    #: facts that prevent resuming: for each, the recorded value and the present one
    changes: Mapping[str, tuple[Any, Any]]

    @property
    def observations(self) -> tuple[Observation, ...]:
        """What every probe showed, in order."""
        return tuple(probe.observation for probe in self.probes)


@dataclass(frozen=True, slots=True)
class TouchLog:
    """A file of probes and what they showed: a header, then one JSON object a line.

    Lengths are in metres, times in seconds, everything in the object frame O. Numbers are kept to
    the last bit. `Exploration.replay` rebuilds the contacts.
    """

    path: Path  #: of a file that need not exist
    facts: Mapping[str, Any]  #: of the exploration, as plain values: the header

    def read(self) -> Recording:
        """Return the content of the file; it stays as it is.

        Raises `InvalidFileError` if the file exists and is no touch log.
        """
        header, rows = read_lines(self.path)
        if header and "touch_log" not in header:
            raise InvalidFileError(
                f"{self.path} must be a touch log, to resume or to replace; it is something else:"
                " write to another folder",
                path=self.path,
            )
        ours = self._header() if header else header
        changes = {
            name: (header.get(name), ours.get(name))
            for name in sorted({*header, *ours})
            if header.get(name) != ours.get(name)
        }
        probes = [] if changes else [row for row in rows if _END not in row]
        ending = next((str(row[_END]) for row in rows if _END in row), None)
        return Recording(_logged(self.path, probes), ending, changes)

    def begin(self) -> None:
        """Write the header, if there is none yet."""
        append_lines(self.path, self._header(), [])

    def append(
        self,
        observation: Observation,
        X_EO: FloatArray | None = None,
        disturbance: Disturbance | None = None,
    ) -> None:
        """Add an observation; it is on the disk when this returns.

        `X_EO` is the true pose of a simulated free object after it, (4, 4); None if unknown.
        `disturbance` is what touches did so far to the bodies beside it; None if as before.
        """
        probe = LoggedProbe(observation, X_EO, disturbance)
        append_lines(self.path, self._header(), [_row(probe)])

    def end(self, reason: str) -> None:
        """Mark the exploration as ended, with the reason."""
        append_lines(self.path, self._header(), [{_END: reason}])

    def go_on(self) -> None:
        """Replace the header of a log of fewer touches by this one, and remove the end."""
        _, rows = read_lines(self.path)
        with whole_file(self.path) as temporary:
            append_lines(temporary, self._header(), [row for row in rows if _END not in row])

    def _header(self) -> Row:
        return {"touch_log": 1, **self.facts}


def load_observations(path: Path) -> tuple[Observation, ...]:
    """Read every observation of a log, ended or not; for errors see `read_log`."""
    return tuple(probe.observation for probe in read_log(path)[1])


def load_outcomes(path: Path) -> tuple[ProbeOutcome, ...]:
    """Read the outcome of every probe of a log; for errors see `read_log`."""
    return tuple(observation.outcome for observation in load_observations(path))


def read_log(path: Path) -> tuple[Row, tuple[LoggedProbe, ...]]:
    """Read the header of a log, and every probe, ended or not.

    Raises `InvalidFileError` if the file is missing or no touch log.
    """
    header, rows = read_lines(path)
    if "touch_log" not in header:
        raise InvalidFileError(
            f"{path} must be a touch log, as `lis-grasp explore` writes it; it is"
            f" {'something else' if header else 'missing or empty'}",
            path=path,
        )
    return header, _logged(path, [row for row in rows if _END not in row])


def _row(probe: LoggedProbe) -> Row:
    observation, belief = probe.observation, probe.observation.belief
    outcome = observation.outcome
    contacts, hand_pose = outcome.contacts, outcome.hand_pose
    names = ("points", "normals", "forces", "fingers", "times")
    noise = {name: getattr(contacts, name) for name in ("position_noise", "normal_noise")}
    row = {n: v for n, v in fields_of(outcome.probe).items() if n != "slides" or len(v)}
    del row["passed"], row["pace"]  # the times show them
    row |= {} if row.pop("purpose") == "policy" else {"purpose": outcome.probe.purpose}
    row |= {name: getattr(outcome, name) for name in ("status", "reason", "duration", "moved")}
    row |= {name: getattr(contacts, name) for name in names}
    # None for a contact of unknown noise; absent if all are unknown.
    known = {name: values.tolist() for name, values in noise.items() if values is not None}
    row |= {name: [None if np.isnan(x) else x for x in values] for name, values in known.items()}
    row |= {"free_points": outcome.free_points, "free_radii": outcome.free_radii}
    row |= {"X_OH": None, "joint_positions": None} if hand_pose is None else fields_of(hand_pose)
    row |= {"dropped": observation.dropped} if len(observation.dropped) else {}
    row |= {"slid": outcome.slid} if outcome.slid else {}
    row |= {"seconds": dict(outcome.seconds)} if outcome.seconds else {}
    row |= {"left_at": outcome.left_at} if len(outcome.left_at) else {}
    row |= {} if outcome.resisted is None else {"resisted": outcome.resisted}
    row |= beside_rows(observation)
    row |= {} if belief is None else {"tracked_pose": belief.as_dict()}
    row |= {} if probe.X_EO is None else {"simulated_pose": probe.X_EO}
    if probe.disturbance is not None:
        row |= {"disturbance": _disturbance_row(probe.disturbance)}
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in row.items()}


def _disturbance_row(disturbance: Disturbance) -> Row:
    poses = {name: X.tolist() for name, X in disturbance.poses.items()}
    contacts, forces = dict(disturbance.contacts), dict(disturbance.forces)
    return {"contacts": contacts, "forces": forces, "poses": poses}


def _logged(path: Path, rows: list[Row]) -> tuple[LoggedProbe, ...]:
    probes = []
    for number, row in enumerate(rows, start=2):
        entry = checked(TouchEntry, row, path, f"probe in line {number}")
        try:
            probes.append(_probe_of(entry))
        except InvalidInputError as error:
            message = f"{path} has no valid probe in line {number}: {error}"
            raise InvalidFileError(message, path=path) from None
    return tuple(probes)


def _probe_of(row: TouchEntry) -> LoggedProbe:
    contacts = Contacts(
        _rows(row.points),
        _rows(row.normals),
        forces=_array(row.forces),
        fingers=tuple(row.fingers),
        times=_array(row.times),
        position_noise=_array(row.position_noise),
        normal_noise=_array(row.normal_noise),
    )
    motion = np.array(row.target), np.array(row.direction), row.standoff, row.overshoot
    probe = Probe(*motion, _rows(row.slides), row.purpose)
    outcome = ProbeOutcome(
        probe,
        row.status,
        contacts,
        _rows(row.free_points),
        row.duration,
        row.reason,
        row.moved,
        np.array(row.free_radii),
        None if row.X_OH is None else HandPose(np.array(row.X_OH), np.array(row.joint_positions)),
        row.slid,
        row.seconds,
        np.array(row.left_at),
        row.resisted,
    )
    tracked = row.tracked_pose
    belief = None if tracked is None else PoseBelief.from_dict(tracked.model_dump())
    observation = Observation(outcome, belief, _rows(row.dropped))
    observation = with_rows(observation, row.beside, row.refused)
    return LoggedProbe(observation, _array(row.simulated_pose), _disturbance_of(row.disturbance))


def _disturbance_of(entry: DisturbanceEntry | None) -> Disturbance | None:
    if entry is None:
        return None
    poses = {name: np.array(X) for name, X in entry.poses.items()}
    return Disturbance(entry.contacts, entry.forces, poses)


def _array(values: Sequence[Any] | None) -> FloatArray | None:
    """Return values as an array, NaN for each None; None for no values."""
    return None if values is None else np.array(values, dtype=np.float64)


def _rows(values: list[list[float]]) -> FloatArray:
    return np.array(values, dtype=np.float64).reshape(-1, 3)  # an empty list has no columns


class BeliefEntry(FileRecord):
    """A `PoseBelief`."""

    X_WE: Pose
    means: list[Vector]
    covariances: list[Annotated[list[Vector], Field(min_length=3, max_length=3)]]
    log_weights: list[Number]
    doubts: int
    repeated: bool
    suspicious: bool
    lost: bool
    joined: Pose | None = None


class DisturbanceEntry(FileRecord):
    """A `Disturbance`."""

    contacts: dict[str, Annotated[int, Field(ge=0)]]
    forces: dict[str, Number]
    poses: dict[str, Pose]


class TouchEntry(FileRecord):
    """A `LoggedProbe`. Logs of older versions have neither poses nor radii."""

    target: Vector
    direction: Vector
    standoff: Number
    overshoot: Number
    status: ProbeStatus
    reason: str
    duration: Number
    moved: Number
    points: list[Vector]
    normals: list[Vector]
    forces: list[Number] | None
    fingers: list[str]
    times: list[Number] | None
    position_noise: list[Number | None] | None = None
    normal_noise: list[Number | None] | None = None
    free_points: list[Vector]
    free_radii: list[Number] = Field(default_factory=list)
    X_OH: Pose | None = None
    joint_positions: list[Number] | None = None
    simulated_pose: Pose | None = None
    tracked_pose: BeliefEntry | None = None
    dropped: list[Vector] = Field(default_factory=list)
    beside: list[BodyTouchEntry] = Field(default_factory=list)
    refused: list[RefusedEntry] = Field(default_factory=list)
    slides: list[Vector] = Field(default_factory=list)
    purpose: ProbePurpose = "policy"
    slid: Annotated[int, Field(ge=0)] = 0
    seconds: dict[str, Annotated[float, Field(ge=0.0)]] = Field(default_factory=dict)
    left_at: list[Number] = Field(default_factory=list)
    resisted: bool | None = None
    disturbance: DisturbanceEntry | None = None
