"""`lis-grasp run`: touch, estimate, mesh, grasp, lift and shake; one folder of results."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import trimesh

from lis_grasp import pipeline
from lis_grasp.cli import options as opt
from lis_grasp.cli.explore import explored_header, touch_with_log
from lis_grasp.cli.grasp import grasp_header, say_search
from lis_grasp.cli.progress import Stage, say
from lis_grasp.contacts import Contacts
from lis_grasp.grasping.grasps import GraspSearch, save_grasps
from lis_grasp.hands.hand import Hand
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.io.surface_files import load_surface, save_surface
from lis_grasp.pipeline.regrasp import Attempt, grasp_by_touch
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.run_report import build_report
from lis_grasp.shapes import Shape
from lis_grasp.visualization.run_scene import write_scene_of

if TYPE_CHECKING:
    from lis_grasp.simulation.simulate_lift import LiftOutcome


def add_parser(verbs: Any) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser(
        "run", help="touch -> estimate -> mesh -> grasp -> lift and shake, one folder of results"
    )
    opt.add_object(parser)
    opt.add_hand(parser)
    opt.add_estimator(parser)
    opt.add_prober(parser)
    opt.add_fingers(parser)
    opt.add_free(parser)
    opt.add_policy(parser)
    opt.add_free_space(parser)
    opt.add_noise(parser)
    opt.add_touches(parser)
    opt.add_grasps(parser)
    opt.add_attempts(parser)
    opt.add_physics(parser)
    opt.add_friction(parser)
    opt.add_seed(parser)
    opt.add_output(parser, "results/<run>")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Run every stage, writing each one's file as soon as it is there."""
    watch = pipeline.Stopwatch()
    config = opt.configure(options)
    output: Path = options.output or opt.default_output(config)
    shape = opt.load_object(config)
    hand = Hand.load(config.hand)
    for repair in shape.repairs:
        say(f"repaired: {repair}")

    with watch.measure("touch"):
        exploration = touch_with_log(config, shape, hand, output)
        # Later stages take what the files hold, so that each repeats exactly when run alone.
        exploration.contacts.save(output / "contacts.ply", header=explored_header(config, shape))
        contacts = Contacts.load(output / "contacts.ply")

    attempts = _attempts(shape, hand, config, contacts, output, watch)
    search = attempts[-1].search

    with Stage("Reporting"), watch.measure("report"):
        report = build_report(config, shape, hand, attempts, watch.seconds)
        lines = _summary(report)
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
) -> tuple[Attempt, ...]:
    """Return all attempts; the files are of the last one."""
    recorded = provenance.read(output / "contacts.ply")
    support = pipeline.support_height(shape)
    known = len(contacts)

    def plan(contacts: Contacts) -> tuple[trimesh.Trimesh, GraspSearch]:
        if len(contacts) > known:
            contacts.save(output / "contacts.ply", header=provenance.merge(recorded))
            contacts = Contacts.load(output / "contacts.ply")
        mesh = _estimate(config, contacts, output, watch)
        return mesh, _plan(config, mesh, hand, support, output, watch)

    def lift(*arguments: Any, **options: Any) -> LiftOutcome:
        with Stage(f"Lifting the true {shape.name}") as stage, watch.measure("lift"):
            outcome = pipeline.lift(*arguments, **options)
            outcome.motion.save(output / "motion.npz")
            stage.result = outcome.reason
        return outcome

    (output / "motion.npz").unlink(missing_ok=True)
    return tuple(grasp_by_touch(shape, hand, contacts, config, planner=plan, lift=lift))


def _estimate(
    config: RunConfig, contacts: Contacts, output: Path, watch: pipeline.Stopwatch
) -> trimesh.Trimesh:
    title = f"Estimating the surface ({config.estimator})"
    with Stage(title) as stage, watch.measure("estimate"):
        _, mesh = pipeline.estimate(
            contacts, config.estimator, config.sensor(), free_space=config.free_space
        )
        recorded = provenance.read(output / "contacts.ply")
        header = provenance.merge(recorded, estimator=config.estimator)
        save_surface(mesh, output / "surface.ply", header=header)
        stage.result = f"{len(mesh.faces)} triangles from {len(contacts)} contacts"
    return load_surface(output / "surface.ply")


def _plan(
    config: RunConfig,
    mesh: trimesh.Trimesh,
    hand: Hand,
    support: float,
    output: Path,
    watch: pipeline.Stopwatch,
) -> GraspSearch:
    with Stage(f"Planning grasps of {hand.name}") as stage, watch.measure("grasp"):
        search = pipeline.plan(
            mesh,
            hand,
            support=support,
            friction=config.friction,
            count=config.grasps,
            seed=config.seed,
        )
        recorded = provenance.read(output / "contacts.ply")
        header = grasp_header(recorded, config, support)
        save_grasps(output / "grasps.json", search, header=header)
        stage.result = f"{len(search.grasps)} grasps of {search.candidates} candidates"
    return search


def _summary(report: dict[str, Any]) -> tuple[str, ...]:
    surface, grasps, lift = report["surface"], report["grasps"], report["lift"]
    edge = surface["edge_rmsd"]
    lines = [
        f"touched   {report['touches']} contacts, {100 * surface['coverage']:.0f} % of the surface"
        " within a step of one",
        f"estimated rmsd {1e3 * surface['rmsd']:.2f} mm"
        + (f", {1e3 * edge:.2f} mm at the edges" if edge is not None else ""),
    ]
    if grasps["number"]:
        lines.append(
            f"grasped   {grasps['number']} grasps; the best has epsilon"
            f" {grasps['best_epsilon_estimate']:.3f} on the estimate,"
            f" {grasps['best_epsilon_truth']:.3f} on the true object"
        )
    else:
        lines.append("grasped   no grasp found")
    declined = len(report["attempts"]) - 1
    if declined:
        them = "a grasp" if declined == 1 else f"{declined} grasps"
        lines.append(f"felt      that {them} would not hold, and planned again")
    if lift["held"]:
        lines.append(f"lifted    and held through the shake; slipped {1e3 * lift['slip']:.1f} mm")
    else:
        lines.append(f"lifted    {'yes' if lift['lifted'] else 'no'}, not held: {lift['reason']}")
    return tuple(lines)
