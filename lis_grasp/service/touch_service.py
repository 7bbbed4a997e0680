"""Exploration by requests: the next touch, the estimate and grasps, for a robot's program."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import InitVar, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidInputError, LisGraspError
from lis_grasp.exploration import (
    ExplorationState,
    Observation,
    Probe,
    ProbeOutcome,
    Region,
    TactilePerception,
    TouchLog,
    advance,
    begin,
)
from lis_grasp.exploration.touch_detection import APPROACH_NOISE
from lis_grasp.grasping.export import moveit_grasps
from lis_grasp.io import provenance
from lis_grasp.io.schemas import Number, Vector, first_mistake
from lis_grasp.io.units import LARGEST
from lis_grasp.results.estimated_file import estimate_file
from lis_grasp.results.folder import result_file
from lis_grasp.results.grasped_file import grasp_file
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.contact_sources import ContactSource
from lis_grasp.stages.next_touch import NextTouch, ObjectPlace, endless, next_touch_after
from lis_grasp.stages.touch import make_perception
from lis_grasp.surfaces.contact_checks import doubt_of_side
from lis_grasp.typing import FloatArray

_MOST_ROWS, _MOST_GRASPS = 1000, 100  # in a request
_LONGEST_NAME = 100  # letters
_Rows = Annotated[list[Vector], Field(max_length=_MOST_ROWS)]


class _Request(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    id: Any = None


class NextRequest(_Request):
    """Outcome of the last probe, if it was carried out; the answer is the next probe."""

    request: Literal["next"] = "next"
    status: Literal["touched", "missed", "blocked"] | None = None
    points: _Rows = Field(default_factory=list)
    normals: _Rows | None = None
    free_points: _Rows = Field(default_factory=list)
    free_radii: Annotated[list[Number], Field(max_length=_MOST_ROWS)] = Field(default_factory=list)
    position_noise: Number | None = None
    normal_noise: Number | None = None


class EstimateRequest(_Request):
    """The surface of all contacts, in surface.ply."""

    request: Literal["estimate"]


class GraspRequest(_Request):
    """Grasps on the surface of all contacts, in grasps.json."""

    request: Literal["grasp"]
    grasps: Annotated[int, Field(ge=1, le=_MOST_GRASPS)] | None = None
    mass: float | None = None
    friction: float | None = None
    moveit: Annotated[str, Field(max_length=_LONGEST_NAME)] | None = None


_REQUESTS: Mapping[str, type[_Request]] = {
    "next": NextRequest,
    "estimate": EstimateRequest,
    "grasp": GraspRequest,
}


@dataclass(slots=True, eq=False)
class TouchService:
    """Answers requests for touches, estimates and grasps of one object.

    Each outcome is on the disk, in the log, before its answer is made. Files are written to the
    folder only, under fixed names.

    Parameters
    ----------
    agent
        The robot; it does not know the object's place.
    place
        What is known of the object's place.
    folder
        Folder of contacts.ply, surface.ply and grasps.json.
    log
        Log of the probes; the files have the same facts.
    before, recorded
        Earlier contacts, and earlier observations by probes.
    """

    agent: Agent
    place: ObjectPlace
    folder: Path
    log: TouchLog
    before: Contacts = field(default_factory=Contacts.empty)
    recorded: InitVar[Sequence[Observation]] = ()
    _perception: TactilePerception = field(init=False)
    _state: ExplorationState = field(init=False)
    _touch: NextTouch | None = field(default=None, init=False)  # not carried out yet

    def __post_init__(self, recorded: Sequence[Observation]) -> None:
        self._perception = make_perception(self.agent.perception, self.before)
        self._state = begin(self._perception, recorded=recorded)

    def answer(self, content: Mapping[str, Any]) -> dict[str, Any]:
        """Return the answer to a request, as plain values.

        Raises `LisGraspError`, and changes nothing, if the request is not valid or cannot be
        carried out.
        """
        kind = content.get("request", "next")
        if not isinstance(kind, str) or kind not in _REQUESTS:
            raise InvalidInputError(
                f"request must be one of {', '.join(_REQUESTS)} or stop; it is {str(kind)[:40]!r}"
            )
        try:
            request = _REQUESTS[kind].model_validate(content)
        except ValidationError as invalid:
            key, reason = first_mistake(invalid, {k: [k] for k in _REQUESTS[kind].model_fields})
            raise InvalidInputError(f"{key or 'a request'} {reason}") from None
        if isinstance(request, NextRequest):
            return self._next(request)
        surface = self._estimate()
        return surface if not isinstance(request, GraspRequest) else self._grasp(request)

    def _next(self, request: NextRequest) -> dict[str, Any]:
        reports = bool(request.model_fields_set - {"request", "id"})
        if reports:
            outcome = self._outcome(request)
            self._require_near(outcome)
            self.log.append(Observation(outcome))
            self._state, self._touch = advance(self._perception, self._state, outcome), None
        contacts, touched = self._state.known, self._state.touched
        try:
            if self._touch is None:
                agent = self.agent.placed(self.place.space(contacts))
                self._touch = next_touch_after(agent, self._perception, endless(agent), self._state)
        except LisGraspError as error:
            if not reports:
                raise
            return {"ok": False, "error": str(error), "recorded": True, "contacts": len(touched)}
        facts = {**self._touch.facts(self.agent.hand), "contacts": len(touched)}
        return facts | _warning(self.place.doubt(contacts), doubt_of_side(touched))

    def _outcome(self, request: NextRequest) -> ProbeOutcome:
        points = np.array(request.points, dtype=np.float64).reshape(-1, 3)
        if request.status is None and not len(points):
            raise InvalidInputError("without points, status must be missed or blocked")
        status = request.status or "touched"
        normals, normal_noise = request.normals, request.normal_noise
        if self._touch is not None:
            probe = self._touch.probe
            if normals is None:
                normals = [(-probe.direction).tolist()] * len(points)
                normal_noise = APPROACH_NOISE if normal_noise is None else normal_noise
        elif normals and len(points):
            probe = Probe(points[0], -np.array(normals[0]), 0.0, 0.0)
        else:
            raise InvalidInputError(
                "no touch was asked for: points then need normals, and nothing can be missed"
            )

        def each(noise: float | None) -> FloatArray | None:
            return None if noise is None else np.full(len(points), noise)

        contacts = Contacts(
            points,
            np.array(normals, dtype=np.float64).reshape(-1, 3),
            position_noise=each(request.position_noise),
            normal_noise=each(normal_noise),
        )
        free = np.array(request.free_points, dtype=np.float64).reshape(-1, 3)
        radii = np.array(request.free_radii, dtype=np.float64)
        reason = "reported" if status == "blocked" else ""
        return ProbeOutcome(probe, status, contacts, free, reason=reason, free_radii=radii)

    def _require_near(self, outcome: ProbeOutcome) -> None:
        """Raise `InvalidInputError` for points in another unit or frame: the log keeps them."""
        if self.place.region is not None:
            low, high = Region(self.place.region).bounds
            margin, where = 0.5 * (high - low), "in the region, or at most half of its lengths away"
        else:
            others = np.vstack([self._state.known.points, outcome.probe.target])
            low, high = others.min(axis=0), others.max(axis=0)
            margin, where = np.full(3, LARGEST), f"within {LARGEST:g} m of the others and the touch"
        for points, more in ((outcome.contacts.points, 0.0), (outcome.free_points, LARGEST)):
            beyond = np.abs(points - 0.5 * (low + high)) > 0.5 * (high - low) + margin + more
            if beyond.any():
                far = points[beyond.any(axis=1)][0].tolist()
                where = f"{where}; one is {far}: nothing was recorded"
                raise InvalidInputError(f"points must be in metres, {where}")

    def _estimate(self) -> dict[str, Any]:
        contacts, path = self._state.touched, self.folder / "contacts.ply"
        if not len(contacts):
            raise InvalidInputError("there is no contact yet: ask for the next touch")
        facts = {name: value for name, value in self.log.facts.items() if name != "cloud"}
        table = self.place.table(contacts)
        facts |= {} if table is None else {"support_height": table}
        if self.place.support is not None:
            facts["free"] = True  # on a table, which closes the estimate from below
        with result_file(path) as temporary:
            contacts.save(temporary, header=provenance.describe(**facts))
        made = estimate_file([ContactSource(path, normals="outward")])
        extents = made.mesh.extents.tolist()
        answer = {"file": made.path.name, "contacts": len(contacts), "extents": extents}
        return answer | _warning(doubt_of_side(contacts))

    def _grasp(self, request: GraspRequest) -> dict[str, Any]:
        options = request.model_dump(include={"grasps", "mass", "friction"})
        made = grasp_file(self.folder / "surface.ply", **options)
        written = json.loads(made.path.read_text(encoding="utf-8"))
        names = ("grasps", "candidates", "rejections")
        answer = {"file": made.path.name, **{name: written[name] for name in names}}
        if request.moveit is not None:
            name, X_FB = request.moveit, self.agent.hand.X_FB
            answer["moveit"] = moveit_grasps(made.search, self.agent.hand, name=name, X_FB=X_FB)
        return answer


def _warning(*doubts: str) -> dict[str, str]:
    """Return the doubts that are not empty as the warning of an answer, if there are any."""
    told = "; ".join(filter(None, doubts))
    return {"warning": told} if told else {}
