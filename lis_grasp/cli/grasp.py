"""`lis-grasp grasp`: force-closure grasp planning on a mesh, estimated or your own."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import PRINTED, Stage, next_step, say, say_search
from lis_grasp.exceptions import InvalidOptionError, require_packages
from lis_grasp.exports.dexgraspbench import TabletopObject, save_for_dexgraspbench
from lis_grasp.grasping.export import save_isaac_grasps, save_moveit_grasps
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.results.grasped_file import PLANNED_WITH, GraspedFile, grasp_file
from lis_grasp.results.labels import label_file
from lis_grasp.shapes import placed_as_recorded
from lis_grasp.simulation.mujoco.convex_pieces import convex_pieces
from lis_grasp.stages.scenario import find_object

# docs/study/rows.parquet: 58 of 114 grasps planned on `lis` held, at a mean prediction of 0.72.
_ON_LIS = (
    "success is predicted too high on a surface of lis, where half of the grasps hold; it was"
    " fitted to surfaces of blend (estimate --estimator blend)"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    opt.add_mesh(parser)
    opt.add_support_option(
        parser,
        "height of the plane below the object, or none for an object that is held in the air"
        " (default: as recorded: of an estimate, that of the table, else of the lowest contact; of"
        " another MESH its lowest point)",
    )
    parser.add_argument(
        "--isaac", action="store_true", help="also write grasps.isaac.yaml, for Isaac Sim"
    )
    parser.add_argument(
        "--moveit",
        nargs="?",
        const="object",
        metavar="NAME",
        help="also write grasps.moveit.yaml, a list of moveit_msgs/msg/Grasp; NAME is the object's"
        " in the planning scene, and its frame (default: object)",
    )
    parser.add_argument(
        "--dexgraspbench",
        action="store_true",
        help="also write the folder dexgraspbench, for the benchmark of that name: the grasps, the"
        " hand, and the true object if it is recorded, else MESH; needs the extra mujoco",
    )
    parser.add_argument(
        "--label",
        action="store_true",
        help="also simulate the lift of each grasp, of the true object if it is recorded, else of"
        " MESH, and write grasps.parquet; resumable; needs the extra study. With --isaac and"
        " --dexgraspbench the outcomes are in their files too",
    )
    opt.add_jobs(parser)
    opt.add_options(parser, "units", "up")
    opt.add_options(parser, *PLANNED_WITH, recorded=True)
    parser.add_argument(
        "--count", dest="grasps", type=int, metavar="N", help="the same as --grasps"
    )
    opt.add_output(parser, "the folder of MESH")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Plan grasps, print what was written, and return 0, or 1 if no grasp was found."""
    if options.dexgraspbench:
        require_packages("mujoco", extra="mujoco", option="--dexgraspbench")
    if options.jobs is not None and not options.label:
        raise InvalidOptionError("--jobs is for the lifts of --label: give both", option="--jobs")
    if options.label:
        require_packages("pyarrow", extra="study", option="--label")
    used = opt.given(options, "units", "up", *PLANNED_WITH)
    output = options.output
    made = grasp_file(options.mesh, output, support=options.support, progress=PRINTED, **used)
    say_search(made.search)
    if made.search.grasps and made.recorded.get("estimator") == "lis":
        say(f"warning: {_ON_LIS}")
    say(f"wrote {made.path}")
    hand = made.agent.hand
    labels = _label(options, made) if options.label else ()
    if options.isaac:
        isaac = made.path.with_name("grasps.isaac.yaml")
        save_isaac_grasps(isaac, made.search, hand, labels)
        say(f"wrote {isaac}")
    if options.moveit:
        station = made.agent.station
        moveit, X_FB = made.path.with_name("grasps.moveit.yaml"), hand.X_FB
        carrier = f"the link that hand {hand.name} is mounted on"
        if station is not None:
            X_FB, carrier = station.mount.X_FB, f"{station.arm.flange} of arm {station.arm.name}"
        elif X_FB is None:
            carrier = f"{hand.base_link}, the base link of hand {hand.name}"
        save_moveit_grasps(moveit, made.search, hand, name=options.moveit, X_FB=X_FB)
        say(f"wrote {moveit}: poses of {carrier}")
    if options.dexgraspbench:
        folder = _write_dexgraspbench(made, options.mesh, labels)
        say(f"wrote {folder}: copy hand/lis_{hand.name}.yaml to the benchmark's config/hand, then")
        say(f"  python src/main.py task=eval hand=lis_{hand.name} save_dir={folder}")
    if not made.search.grasps:
        surface, then = options.mesh.parent, "another hand, or what the most frequent reason names"
        if (surface / "surface.ply").is_file():
            then = f"lis-grasp view {{}} shows the surface; then {then}"
        say(next_step(then, surface))
        return 1
    say(_next_step(made, options.mesh))
    return 0


def _next_step(made: GraspedFile, mesh: Path) -> str:
    """Return the advice to lift the known object, else to view the surface, else to lift the mesh.

    A folder without the surface has nothing to view before a lift.
    """
    folder = made.path.parent
    if "object" in made.recorded:
        return next_step("lis-grasp lift {}", made.path)
    if any((folder / name).is_file() for name in ("surface.ply", "contacts.ply")):
        return next_step("lis-grasp view {}", folder)
    return next_step("lis-grasp lift {} --object {}", made.path, mesh)


def _label(options: argparse.Namespace, made: GraspedFile) -> Sequence[Mapping[str, Any]]:
    """Simulate the lift of each grasp, and return the outcomes."""
    of_mesh: dict[str, Any] = {}
    if "object" not in made.recorded:
        of_mesh["object"] = str(options.mesh)
    names = ("units", "up", "jobs", "arm", "base", "mass", "friction")
    labelled = label_file(made.path, progress=PRINTED, **of_mesh, **opt.given(options, *names))
    held = sum(label["held"] for label in labelled.labels)
    say(f"wrote {labelled.path}: {held} of {len(labelled.labels)} grasps were held")
    return labelled.labels


def _write_dexgraspbench(
    made: GraspedFile, source: Path, labels: Sequence[Mapping[str, Any]]
) -> Path:
    """Write the folder of DexGraspBench and the results of its protocol; return it.

    The object is the true one if it is recorded, else the mesh.
    """
    from lis_grasp.simulation.mujoco.dexgraspbench_protocol import dexgraspbench_protocol

    name = Path(made.recorded.get("object", source)).stem
    mesh, hand, grasps = made.mesh, made.agent.hand, made.search.grasps
    support_height = made.agent.support_height
    if "object" in made.recorded:
        mesh = placed_as_recorded(find_object(made.task.world), made.recorded).mesh
    with Stage("Splitting into convex pieces") as stage:
        pieces = convex_pieces(mesh)
        stage.result = str(len(pieces))
    folder = made.path.with_name("dexgraspbench")
    target = TabletopObject(name, pieces, support_height)
    folder = save_for_dexgraspbench(folder, target, hand, grasps, labels)
    with Stage("Testing by the protocol of DexGraspBench") as stage:
        tests = [dexgraspbench_protocol(hand, g, pieces, support_height) for g in grasps]
        lifts, holds = (sum(getattr(t, f) for t in tests) for f in ("table_lift", "force_test"))
        stage.result = f"of {len(tests)} grasps {lifts} pass the table lift, {holds} the force test"
    write_json(folder / "protocol.json", [asdict(test) for test in tests])
    return folder
