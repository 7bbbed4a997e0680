"""`lis-grasp run`: the whole pipeline, with one folder of results."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

import trimesh

from lis_grasp import pipeline
from lis_grasp.cli import options as opt
from lis_grasp.cli.estimate import write_surface
from lis_grasp.cli.explore import TOUCH_OPTIONS, explore_with_log, warn_if_too_wide
from lis_grasp.cli.grasp import say_search, write_grasps
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import results_folder
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.io.folder_lock import sole_writer
from lis_grasp.io.surface_files import load_surface
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.lifting.trial import AcceptGrasp
from lis_grasp.pipeline.regrasp import Stages, grasp_with_tactile_check
from lis_grasp.pipeline.report_json import build_report
from lis_grasp.pipeline.scenario import Scenario
from lis_grasp.pipeline.summary import run_lines
from lis_grasp.robots.inertias import require_possible_inertias
from lis_grasp.visualization.run_scene import write_scene_of

_LOG = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    opt.add_object(parser)
    opt.add_conditions(parser)
    opt.add_options(parser, *TOUCH_OPTIONS, "free_space", "grasps", "attempts", "simulator")
    opt.add_output(parser, "results/<run>")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Run every stage, and write the file of each as soon as it is done."""
    watch = pipeline.Stopwatch()
    config = opt.configure_touch(options)
    output = results_folder(config, options.output)
    scenario = Scenario.from_config(config)
    shape, hand = opt.announced(scenario.truth.shape), scenario.known.hand
    require_possible_inertias(hand.inertials)
    pipeline.require_simulator(config.simulator, shape)
    options.until_end.enter_context(sole_writer(output))
    warn_if_too_wide(shape, hand)

    with watch.measure("touch"):
        arm_use = ArmUse()
        exploration = explore_with_log(scenario, output, arm_use)
        # Later stages read the files, so that each repeats exactly when run alone.
        contacts = Contacts.load(output / "contacts.ply")
    if not len(contacts):
        raise EstimationError(
            f"no contact was made in {len(exploration.outcomes)} probes, so that there is nothing"
            " to estimate: check that the region contains the object and that the hand gets there"
        )

    after = scenario.after(exploration)
    (output / "motion.npz").unlink(missing_ok=True)
    stages = StoredStages(output, watch)
    attempts = tuple(grasp_with_tactile_check(after, contacts, stages))
    search = attempts[-1].search

    with Stage("Reporting"), watch.measure("report"):
        _LOG.info("comparing the estimate and the grasps with the true object")
        report = build_report(after, exploration, attempts, arm_use)
        lines = run_lines(report)
        _LOG.info("drawing the scene")
        write_scene_of(output, summary=lines)
    report["timings"] = {name: round(seconds, 3) for name, seconds in watch.seconds.items()}
    report["timings"]["total"] = round(sum(watch.seconds.values()), 3)
    write_json(output / "report.json", report)

    if not search.grasps:
        say_search(search)
    for line in lines:
        say(line)
    say(f"wrote {output}/contacts.ply, surface.ply, grasps.json, report.json, scene.html")
    say(f"next: open {output}/scene.html, or: lis-grasp view {output}")


class StoredStages(Stages):
    """The stages of an attempt, with the files of the last attempt in a folder."""

    def __init__(self, output: Path, watch: pipeline.Stopwatch) -> None:
        self._output, self._watch = output, watch
        self._recorded = provenance.read(output / "contacts.ply")
        self._stored = len(Contacts.load(output / "contacts.ply"))

    def plan(self, scenario: Scenario, contacts: Contacts) -> tuple[trimesh.Trimesh, GraspSearch]:
        """Estimate and plan, and write contacts.ply, surface.ply and grasps.json."""
        output, recorded = self._output, self._recorded
        recorded |= scenario.facts()
        if len(contacts) > self._stored:
            contacts.save(output / "contacts.ply", header=provenance.merge(recorded))
            contacts = Contacts.load(output / "contacts.ply")
        with self._watch.measure("estimate"):
            write_surface(output / "surface.ply", scenario.known, contacts, recorded)
            mesh = load_surface(output / "surface.ply")
        with self._watch.measure("grasp"):
            path = output / "grasps.json"
            return mesh, write_grasps(path, scenario.known, mesh, scenario.config, recorded)

    def lift(
        self,
        scenario: Scenario,
        grasp: Grasp,
        mesh: trimesh.Trimesh,
        accept_grasp: AcceptGrasp | None,
    ) -> LiftOutcome:
        """Simulate the lift, and write motion.npz."""
        title = f"Lifting the true {scenario.truth.shape.name}"
        with Stage(title) as stage, self._watch.measure("lift"):
            outcome = super().lift(scenario, grasp, mesh, accept_grasp)
            outcome.motion.save(self._output / "motion.npz")
            stage.result = outcome.reason
        return outcome
