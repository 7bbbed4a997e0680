"""A whole run with its files: touch, estimate, mesh, grasp, lift and shake, report and page."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import trimesh
from threadpoolctl import threadpool_limits

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidFileError
from lis_grasp.exploration import Exploration
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.io.folder_lock import sole_writer
from lis_grasp.io.surface_files import load_surface
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.motion import Motion
from lis_grasp.pipeline._stage_files import StoredStages
from lis_grasp.pipeline.exploring import explore_into, say_object
from lis_grasp.pipeline.lifting_stage import require_simulator
from lis_grasp.pipeline.progress import SILENT, Progress
from lis_grasp.pipeline.regrasp import grasp_with_tactile_check
from lis_grasp.pipeline.report_json import build_report
from lis_grasp.pipeline.results_folder import results_folder
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.scenario import Perception, Scenario
from lis_grasp.pipeline.stages import Stopwatch, estimate
from lis_grasp.pipeline.summary import run_lines
from lis_grasp.records import short_repr
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.inertias import require_possible_inertias
from lis_grasp.shapes import Shape, find, placed_as_recorded
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.visualization.run_scene import write_scene_of

_LOG = logging.getLogger(__name__)

# Files whose headers say where the object is, the last that is written first.
_SOURCES = ("grasps.json", "surface.ply", "contacts.ply")


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Run:
    """Results in a folder: everything is in the frame of its contacts, the true object too.

    What the folder lacks is None.
    """

    folder: Path
    facts: Mapping[str, Any]  #: recorded in the header of the file that was made last
    contacts: Contacts | None  #: touches, then the points of a cloud
    mesh: trimesh.Trimesh | None  #: the estimate [m]
    grasps: GraspSearch | None  #: planned on the estimate
    motion: Motion | None  #: of the simulated lift
    report: Mapping[str, Any] | None  #: report.json

    __repr__ = short_repr

    @classmethod
    def load(cls, folder: Path | str) -> Run:
        """Return the results in a folder, of a run or of single stages.

        Raises
        ------
        InvalidFileError
            If the folder has no results, or a file is damaged.
        """
        folder = Path(folder)
        files = {path.name: path for path in folder.glob("*.*")}
        source = next((files[name] for name in _SOURCES if name in files), None)
        if source is None:
            raise InvalidFileError(
                f"{folder} has no results ({', '.join(_SOURCES)}): name a folder that a run wrote",
                path=folder,
            )
        report = files.get("report.json")
        return cls(
            folder,
            provenance.read(source),
            Contacts.load(files["contacts.ply"]) if "contacts.ply" in files else None,
            load_surface(files["surface.ply"]) if "surface.ply" in files else None,
            GraspSearch.load(files["grasps.json"]) if "grasps.json" in files else None,
            Motion.load(files["motion.npz"]) if "motion.npz" in files else None,
            None if report is None else json.loads(report.read_text(encoding="utf-8")),
        )

    @cached_property
    def config(self) -> RunConfig:
        """The configuration, as far as it is recorded; `InvalidOptionError` as of `RunConfig`."""
        return RunConfig.from_facts(
            {**self.facts, **({} if self.report is None else self.report["config"])}
        )

    @cached_property
    def truth(self) -> Shape | None:
        """The true object where it is, in the frame of the contacts; None if none is recorded.

        Errors are those of `lis_grasp.shapes.find`: its file may be elsewhere now.
        """
        facts = self.facts
        if "object" not in facts:
            return None
        shape = find(facts["object"], size=facts.get("size"), units=facts.get("units", "m"))
        return placed_as_recorded(shape, facts)

    @cached_property
    def hand(self) -> Hand:
        """The hand; errors as of `Hand.load`."""
        return Hand.load(self.config.hand)

    @cached_property
    def surface(self) -> ImplicitSurface | None:
        """The surface, estimated again from the contacts; None without contacts."""
        if self.contacts is None:
            return None
        known = Perception.from_config(self.config, self.facts.get("support_height"))
        return estimate(known, self.contacts)[0]

    @property
    def lift(self) -> Mapping[str, Any] | None:
        """The outcome of the lift, as in the report."""
        return None if self.report is None else self.report["lift"]


def run(
    config: RunConfig,
    folder: Path | str | None = None,
    *,
    progress: Progress = SILENT,
    fresh: bool = False,
) -> Run:
    """Run every stage, and write the file of each as soon as it is done.

    An interrupted exploration is resumed, and a finished one is used again, if nothing that it
    depends on has changed. Files that were made from earlier ones are removed.

    Parameters
    ----------
    config
        The configuration.
    folder
        Folder of results; None for one in ``results/`` that is named after the configuration.
    progress
        Is told what happens.
    fresh
        Explore from the beginning in any case.

    Raises
    ------
    LisGraspError
        If an input cannot be used, no contact was made, or a stage fails.
    """
    folder, watch, arm_use = results_folder(config, folder), Stopwatch(), ArmUse()
    scenario = Scenario.from_config(config)
    say_object(scenario, progress)
    require_possible_inertias(scenario.known.hand.inertials)
    require_simulator(config.simulator, scenario.truth.shape)
    # Threads change the order of sums, and so the last digits of results.
    with sole_writer(folder), threadpool_limits(1):
        with watch.measure("touch"):
            exploration = explore_into(
                folder, scenario, progress=progress, fresh=fresh, arm_use=arm_use
            )
            contacts = _contacts(folder, exploration)
        (folder / "motion.npz").unlink(missing_ok=True)
        after = scenario.after(exploration)
        stages = StoredStages(folder, watch, progress)
        attempts = tuple(grasp_with_tactile_check(after, contacts, stages))
        with progress.stage("Reporting"), watch.measure("report"):
            _LOG.info("comparing the estimate and the grasps with the true object")
            report = build_report(after, exploration, attempts, arm_use)
            _LOG.info("drawing the scene")
            write_scene_of(folder, summary=run_lines(report))
        report["timings"] = {name: round(seconds, 3) for name, seconds in watch.seconds.items()}
        report["timings"]["total"] = round(sum(watch.seconds.values()), 3)
        write_json(folder / "report.json", report)
    return Run.load(folder)


def _contacts(folder: Path, exploration: Exploration) -> Contacts:
    contacts = Contacts.load(folder / "contacts.ply")
    if not len(contacts):
        raise EstimationError(
            f"no contact was made in {len(exploration.outcomes)} probes, so that there is nothing"
            " to estimate: check that the region contains the object and that the hand gets there"
        )
    return contacts
