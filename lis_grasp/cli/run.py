"""`lis-grasp run`: the whole pipeline, with one folder of results."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path
from typing import Any

import trimesh

from lis_grasp import pipeline
from lis_grasp.arms.station import Station
from lis_grasp.cli import options as opt
from lis_grasp.cli.estimate import write_surface
from lis_grasp.cli.explore import TOUCH_OPTIONS, explore_with_log, warn_if_too_wide
from lis_grasp.cli.grasp import say_search, write_grasps
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import results_folder
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.io.folder_lock import sole_writer
from lis_grasp.io.surface_files import load_surface
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.pipeline.arm_station import make_station, station_after, station_facts
from lis_grasp.pipeline.regrasp import Attempt, grasp_with_tactile_check
from lis_grasp.pipeline.report_json import build_report
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.summary import run_lines
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.inertias import require_possible_inertias
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray
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
    shape, X_WO = opt.place_object(config)
    hand = Hand.load(config.hand)
    require_possible_inertias(hand.inertials)
    pipeline.require_simulator(config.simulator, shape)
    options.until_end.enter_context(sole_writer(output))
    warn_if_too_wide(shape, hand)

    with watch.measure("touch"):
        arm_use = ArmUse()
        station = make_station(config, hand, pipeline.support_height(shape, config))
        exploration = explore_with_log(config, shape, hand, output, X_WO, station, arm_use)
        # Later stages read the files, so that each repeats exactly when run alone.
        contacts = Contacts.load(output / "contacts.ply")
    if not len(contacts):
        raise EstimationError(
            f"no contact was made in {len(exploration.outcomes)} probes, so that there is nothing"
            " to estimate: check that the region contains the object and that the hand gets there"
        )

    X_WO = exploration.simulated_pose
    station = station_after(station, exploration)
    attempts = _attempts(shape, hand, config, contacts, output, watch, X_WO, station)
    search = attempts[-1].search

    with Stage("Reporting"), watch.measure("report"):
        _LOG.info("comparing the estimate and the grasps with the true object")
        report = build_report(
            config, shape, hand, attempts, exploration=exploration, station=station, arm_use=arm_use
        )
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


def _attempts(
    shape: Shape,
    hand: Hand,
    config: RunConfig,
    contacts: Contacts,
    output: Path,
    watch: pipeline.Stopwatch,
    X_WO: FloatArray | None,
    station: Station | None,
) -> tuple[Attempt, ...]:
    """Grasp and lift with the files of the last attempt in `output`; return all attempts.

    The true object is at X_WO (4, 4) in the frame of the contacts; None for the identity. So is the
    station, if an arm carries the hand.
    """
    recorded = provenance.read(output / "contacts.ply")
    known = len(contacts)

    def plan(
        contacts: Contacts, X_WO: FloatArray | None, station: Station | None
    ) -> tuple[trimesh.Trimesh, GraspSearch]:
        if X_WO is not None:
            recorded["X_EO"] = X_WO.tolist()
        recorded.update(station_facts(station))
        if len(contacts) > known:
            contacts.save(output / "contacts.ply", header=provenance.merge(recorded))
            contacts = Contacts.load(output / "contacts.ply")
        with watch.measure("estimate"):
            write_surface(output / "surface.ply", contacts, config, recorded)
            mesh = load_surface(output / "surface.ply")
        with watch.measure("grasp"):
            support = pipeline.support_height(shape, config)
            path = output / "grasps.json"
            return mesh, write_grasps(path, mesh, hand, support, config, recorded, station)

    def lift(*arguments: Any, **options: Any) -> LiftOutcome:
        with Stage(f"Lifting the true {shape.name}") as stage, watch.measure("lift"):
            outcome = pipeline.lift(*arguments, **options)
            outcome.motion.save(output / "motion.npz")
            stage.result = outcome.reason
        return outcome

    (output / "motion.npz").unlink(missing_ok=True)
    return tuple(
        grasp_with_tactile_check(
            shape, hand, contacts, config, planner=plan, lift=lift, X_WO=X_WO, station=station
        )
    )
