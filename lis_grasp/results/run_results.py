"""Results of a run, read from its folder: everything is in the frame of the contacts."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, LisGraspError
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.guesses import Answering
from lis_grasp.io.schemas import FileRecord, read_json
from lis_grasp.io.surface_files import load_surface
from lis_grasp.motion import Motion
from lis_grasp.results.folder import PAGE, PICTURE
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape, find, placed_as_recorded
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.task.recorded_facts import located, read_facts
from lis_grasp.task.task import Task

# Files whose headers have the object's pose, the last written first.
SOURCES = ("grasps.json", "surface.ply", "contacts.ply")

_LIFTS = "lifts.json"
# Facts of an object that a lift names, where its grasps are of a mesh of no known object.
_OBJECT = ("object", "size", "units", "up")


class _Report(FileRecord):
    config: dict[str, Any]
    lift: dict[str, Any]


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Run(Answering):
    """Results in a folder: everything, also the true object, is in the frame of its contacts.

    Missing results are None.

    Examples
    --------
    >>> result = run("box", "wsg50", folder="box_by_wsg50", prober="kinematic", touches=12)
    >>> Run.load("box_by_wsg50").grasps.best.hand
    'wsg50'
    """

    folder: Path
    facts: Mapping[str, Any]  #: recorded in the header of the file that was made last
    contacts: Contacts | None  #: touches, then the points of a cloud
    mesh: trimesh.Trimesh | None  #: the estimate [m]
    grasps: GraspSearch | None  #: planned on the estimate
    motion: Motion | None  #: of the simulated lift
    report: Mapping[str, Any] | None  #: report.json

    def __repr__(self) -> str:
        planned = 0 if self.grasps is None else len(self.grasps)
        outcome = "not lifted" if self.lift is None else self.lift["reason"]
        return f"Run('{self.folder}', {self.contacts}, {planned} grasps, {outcome})"

    def _repr_html_(self) -> str:
        """Return a small picture, which a notebook displays and a click unfolds to the page."""
        from lis_grasp.visualization.notebook import framed, image

        text, page = f"<code>{escape(repr(self))}</code>", self.folder / PAGE
        picture = self.png()
        if picture is not None:
            text = f"{image(picture)}<br/>{text}"
        if not page.is_file():
            return f"<div>{text}</div>"
        frame = framed(page.read_text(encoding="utf-8"), str(self.folder))
        return f"<details><summary>{text}</summary>{frame}</details>"

    def png(self) -> bytes | None:
        """Return the picture of the run, as `Scene.png` does; None if it is empty."""
        from lis_grasp.visualization.still import Still

        path = self.folder / PICTURE
        if path.is_file():
            return path.read_bytes()
        if self.mesh is None and not self.contacts:
            return None
        still = Still(solid=self.mesh, contacts=self.contacts or Contacts.empty())
        if self.grasps:
            with suppress(LisGraspError):  # the hand is of another machine
                return replace(still, hand=self.hand, grasp=self.grasps[0]).png()
        return still.png()

    _repr_png_ = png

    @classmethod
    def load(cls, folder: Path | str) -> Run:
        """Return the results in a folder, of a run or of single stages.

        Raises `InvalidFileError` if the folder has no results, or a file is damaged.
        """
        folder = Path(str(folder))
        files = {path.name: path for path in folder.glob("*.*")}
        known = (*SOURCES, _LIFTS)
        source = next((files[name] for name in known if name in files), None)
        if source is None:
            raise InvalidFileError(
                f"{folder} has no results ({', '.join(known)}): name a folder that `lis-grasp"
                " run` or another verb wrote",
                path=folder,
            )
        report = files.get("report.json")
        facts = read_facts(source)
        if "object" not in facts and _LIFTS in files:
            lifted = read_facts(files[_LIFTS])
            facts = {**facts, **{n: lifted[n] for n in _OBJECT if n in lifted}}
        return cls(
            folder,
            facts,
            Contacts.load(files["contacts.ply"]) if "contacts.ply" in files else None,
            load_surface(files["surface.ply"]) if "surface.ply" in files else None,
            GraspSearch.load(files["grasps.json"]) if "grasps.json" in files else None,
            Motion.load(files["motion.npz"]) if "motion.npz" in files else None,
            None if report is None else read_json(_Report, report, "report of a run").model_dump(),
        )

    @cached_property
    def task(self) -> Task:
        """The task, as far as it is recorded; for `InvalidOptionError` see `Task`."""
        reported = {} if self.report is None else self.report["config"]
        return Task.from_facts(located({**self.facts, **reported}, self.folder))

    @cached_property
    def truth(self) -> Shape | None:
        """The true object at its pose in the frame of the contacts; None if not recorded.

        For errors see `lis_grasp.shapes.find`: its file may have moved.
        """
        facts = self.facts
        if "object" not in facts:
            return None
        shape = find(facts["object"], *(facts.get(name) for name in ("size", "units", "up")))
        return placed_as_recorded(shape, facts)

    @cached_property
    def hand(self) -> Hand:
        """The hand; for errors see `Hand.load`."""
        return Hand.load(self.task.robot.hand)

    @cached_property
    def surface(self) -> ImplicitSurface | None:
        """The surface, estimated again from the contacts; None without contacts."""
        if self.contacts is None:
            return None
        task, height = self.task, self.facts.get("support_height")
        known = Perception.of(task.robot, task.decide, height if task.on_table else None)
        return SurfaceEstimate(self.contacts, known).surface

    @property
    def held(self) -> bool | None:
        """Whether the lifted object was held through the shake; None without a lift."""
        return None if self.lift is None else bool(self.lift["held"])

    @property
    def lift(self) -> Mapping[str, Any] | None:
        """The outcome of the lift, as in the report: ``lift["held"]``, ``lift["reason"]``."""
        return None if self.report is None else self.report["lift"]
