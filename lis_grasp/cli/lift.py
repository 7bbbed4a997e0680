"""`lis-grasp lift`: simulate the lift of planned grasps on the true object."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import trimesh

from lis_grasp import pipeline
from lis_grasp.arms.station import Station
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.io.folder_lock import sole_writer
from lis_grasp.io.surface_files import load_surface
from lis_grasp.pipeline.reasons import lift_sentence
from lis_grasp.pipeline.report_json import lift_facts
from lis_grasp.pipeline.scenario import Scenario
from lis_grasp.pipeline.worker_pool import process_count


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("grasps_file", type=Path, metavar="GRASPS", help="grasps.json of `grasp`")
    opt.add_object(parser, required_name=False)
    parser.add_argument(
        "--best", type=int, default=1, metavar="N", help="lift with the N best grasps (default: 1)"
    )
    opt.add_jobs(parser)
    opt.add_options(parser, "arm", "base", "mass", "friction", "simulator", recorded=True)
    opt.add_output(parser, "the folder of GRASPS")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Simulate the lift with each of the best grasps, and write the outcomes."""
    recorded = provenance.read(options.grasps_file, usual="grasps.json")
    search = GraspSearch.load(options.grasps_file)
    if options.object is None and "object" not in recorded:
        raise InvalidOptionError(
            f"{options.grasps_file} records no object: name it with --object", option="object"
        )
    if options.best < 1:
        raise InvalidOptionError.out_of_range("--best", options.best, "at least 1")
    config = opt.configure(options, recorded)
    poses = dict(recorded)
    if options.arm is not None or options.base is not None:
        poses.pop("X_EA", None)
    scenario = Scenario.from_config(config, recorded=poses)
    shape, mass = opt.announced(scenario.truth.shape), scenario.truth.mass
    pipeline.require_simulator(config.simulator, shape)
    output = options.output or options.grasps_file.parent
    options.until_end.enter_context(sole_writer(output))
    grasps = search.grasps[: options.best]
    trials = pipeline.lift_each(
        scenario,
        grasps,
        jobs=process_count(options.jobs),
        estimate=_estimate(options.grasps_file, scenario.known.station),
    )
    outcomes: list[dict[str, Any]] = []
    for rank in range(1, len(grasps) + 1):
        with Stage(f"Lifting {shape.name} with grasp {rank}") as stage:
            outcome = next(trials)
            stage.result = outcome.reason
        if not outcomes:
            outcome.motion.save(output / "motion.npz")
        outcomes.append({"rank": rank, **lift_facts(outcome, mass=mass)})
    facts = {name: value for name, value in config.facts().items() if name not in opt.PLUGGED}
    write_json(
        output / "lifts.json", {"header": provenance.merge(recorded, **facts), "lifts": outcomes}
    )
    held = sum(outcome["held"] for outcome in outcomes)
    say(f"held {held} of {len(outcomes)} grasps, {mass:.3g} kg")
    for reason in dict.fromkeys(o["reason"] for o in outcomes if not o["held"]):
        ranks = ", ".join(str(o["rank"]) for o in outcomes if o["reason"] == reason)
        say(f"grasp {ranks} not held: {lift_sentence(reason)}")
    say(f"wrote {output / 'lifts.json'}")
    say(f"next: lis-grasp view {output}")


def _estimate(grasps_file: Path, station: Station | None) -> trimesh.Trimesh | None:
    """Return the estimate beside the grasps, which an arm avoids on its way; None without one."""
    surface = grasps_file.with_name("surface.ply")
    return load_surface(surface) if station is not None and surface.exists() else None
