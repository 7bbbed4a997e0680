"""Files that the stages write: surface.ply, grasps.json, motion.npz and growing contacts.ply."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.surface_files import load_surface, save_surface
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.results.progress import Progress, Stopwatch
from lis_grasp.results.summary import lesson_sentence
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.estimate import Perception, SurfaceEstimate, few_contacts, note_doubts
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.stages.regrasp import Stages
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touching_again import Lesson
from lis_grasp.task.recorded_facts import read_facts
from lis_grasp.task.task import Task

NOISE = ("position_noise", "normal_noise")
"""Facts of a sensor in the headers of surfaces."""

OF_CONTACTS = ("turned", "left_out", "doubt_log_odds", "warnings")
"""Facts in the headers of surfaces about doubtful contacts, if there are any."""

PLANNED_WITH = ("hand", "arm", "base", "mass", "friction", "load", "grasps", "world", "at", "seed")
"""Options that grasp planning depends on."""


def write_surface(
    path: Path,
    known: Perception,
    contacts: Contacts,
    recorded: Mapping[str, Any],
    progress: Progress,
) -> trimesh.Trimesh:
    """Estimate a surface from contacts with the recorded facts, and write and return its mesh.

    Its header has the verdicts on bad contacts by row, and the warnings of the estimate.
    """
    made = SurfaceEstimate(contacts, known)
    verdicts, warnings = made.verdicts, list(recorded.get("warnings") or ())
    warnings += filter(None, [few_contacts(made.measured)])  # `note_doubts` notes these
    note_doubts(made.given.seen.append(made.credible), known.support_height)
    if verdicts.bad.any():
        warnings.append(verdicts.sentence())
        progress.say(f"warning: {warnings[-1]} (`keep_all` believes all)")
    with progress.stage(f"Estimating the surface ({known.estimator})") as stage:
        mesh = made.mesh
        facts = {name: getattr(known.sensor, name) for name in NOISE}
        facts |= {"estimator": known.estimator, "free_space": known.free_space}
        facts |= verdicts.facts() | {"warnings": warnings} if warnings else {}
        save_surface(mesh, path, header=provenance.merge(recorded, **facts))
        stage.result = f"{len(mesh.faces)} triangles from {len(contacts)} contacts"
    return mesh


def write_grasps(
    path: Path, agent: Agent, mesh: trimesh.Trimesh, recorded: Mapping[str, Any], progress: Progress
) -> GraspSearch:
    """Plan grasps on a surface with the recorded facts, write them, and return them."""
    with progress.stage(f"Planning grasps of {agent.hand.name}") as stage:
        search = plan_grasps(agent, mesh)
        search.save(path, header=provenance.merge(recorded))
        stage.result = f"{len(search.grasps)} grasps of {search.candidates} candidates"
    return search


def planning_facts(task: Task) -> dict[str, Any]:
    """Return the facts that grasp planning depends on, for the header of its file."""
    facts = task.facts()
    return {name: facts[name] for name in PLANNED_WITH}


class StoredStages(Stages):
    """The stages of an attempt, with the files of the last attempt in a folder.

    Later stages read the files of earlier ones, so that each stage repeats exactly when run alone.
    """

    def __init__(self, folder: Path, watch: Stopwatch, progress: Progress) -> None:
        self._folder, self._watch, self._progress = folder, watch, progress
        self._recorded = read_facts(folder / "contacts.ply")
        self._stored = Contacts.load(folder / "contacts.ply").points

    def estimate(self, scenario: Scenario, contacts: Contacts) -> trimesh.Trimesh:
        """Estimate the surface, and write contacts.ply if there are new ones, and surface.ply."""
        self._recorded.pop("warnings", None)
        self._recorded |= scenario.facts() | scenario.warnings(contacts)
        with self._watch.measure("estimate"):
            if not np.array_equal(contacts.points, self._stored):
                path = self._folder / "contacts.ply"
                contacts.save(path, header=provenance.merge(self._recorded))
                contacts = Contacts.load(path)
            path = self._folder / "surface.ply"
            write_surface(path, scenario.agent.perception, contacts, self._recorded, self._progress)
            return load_surface(path)

    def plan(self, scenario: Scenario, mesh: trimesh.Trimesh) -> GraspSearch:
        """Plan grasps, and write grasps.json."""
        facts = self._recorded | planning_facts(scenario.task)
        facts["support_height"] = scenario.agent.support_height
        with self._watch.measure("grasp"):
            path = self._folder / "grasps.json"
            return write_grasps(path, scenario.agent, mesh, facts, self._progress)

    def lift(
        self,
        scenario: Scenario,
        grasp: Grasp,
        mesh: trimesh.Trimesh,
        accept_grasp: AcceptGrasp | None,
    ) -> LiftOutcome:
        """Simulate the lift, and write motion.npz."""
        title = f"Lifting the true {scenario.truth.shape.name}"
        with self._progress.stage(title) as stage, self._watch.measure("lift"):
            outcome = super().lift(scenario, grasp, mesh, accept_grasp)
            outcome.motion.save(self._folder / "motion.npz")
            put = outcome.place
            stage.result = outcome.reason + ("" if put is None else f", {put.reason}")
        return outcome

    def touch_more(
        self, scenario: Scenario, contacts: Contacts, *, moved: bool
    ) -> tuple[Scenario, Contacts, Lesson]:
        """Find the object again, and touch it some more times."""
        title = f"Touching {scenario.truth.shape.name} again"
        with self._progress.stage(title) as stage, self._watch.measure("touch"):
            scenario, contacts, lesson = super().touch_more(scenario, contacts, moved=moved)
            stage.result = lesson_sentence(asdict(lesson))
        return scenario, contacts, lesson
