"""`lis-grasp grasp`: force-closure grasp planning on a mesh, estimated or your own."""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import trimesh

from lis_grasp import pipeline
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import result_file
from lis_grasp.contacts import FARTHEST
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Workspace
from lis_grasp.geometry import require_pose
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.grasping.isaac_grasps import save_isaac_grasps
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.io.optional_packages import require_packages
from lis_grasp.io.surface_files import load_surface
from lis_grasp.pipeline.dexgraspbench import TabletopObject, save_for_dexgraspbench
from lis_grasp.pipeline.reasons import rejection_sentence
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.scenario import Known, find_object, make_station, station_facts
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import load, placed_as_recorded
from lis_grasp.simulation.mujoco.convex_pieces import convex_pieces
from lis_grasp.typing import FloatArray

# docs/study.md: of 114 grasps planned on `lis` 58 held, with a mean prediction of 0.72.
_ON_LIS = (
    "success is predicted too high on a surface of lis, where half of the grasps hold; it was"
    " fitted to surfaces of blend (estimate --estimator blend)"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument(
        "mesh", type=Path, metavar="MESH", help="surface.ply of `estimate`, or any mesh file"
    )
    parser.add_argument(
        "--support",
        type=float,
        metavar="METRES",
        help="height of the plane below the object (default: as recorded, else the lowest point of"
        " MESH)",
    )
    parser.add_argument(
        "--isaac", action="store_true", help="also write grasps.isaac.yaml, for Isaac Sim"
    )
    parser.add_argument(
        "--dexgraspbench",
        action="store_true",
        help="also write the folder dexgraspbench, for the benchmark of that name: the grasps, the"
        " hand, and the true object if it is recorded, else MESH; needs the extra mujoco",
    )
    names = ("hand", "arm", "base", "mass", "friction", "load", "grasps", "seed")
    opt.add_options(parser, "units")
    opt.add_options(parser, *names, recorded=True)
    opt.add_output(parser, "the folder of MESH")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Plan grasps, and write them."""
    if options.dexgraspbench:
        require_packages("mujoco", extra="mujoco", option="--dexgraspbench")
    recorded = provenance.read(options.mesh, usual="surface.ply")
    config = opt.configure(options, recorded)
    mesh = load_mesh(options.mesh, options.units, recorded)
    hand = Hand.load(config.hand)
    support = options.support
    if support is None:
        support = recorded.get("support_height", float(mesh.bounds[0, 2]))
    if not abs(support) <= FARTHEST:
        raise InvalidOptionError.out_of_range(
            "support", support, f"a height in metres, from {-FARTHEST:g} to {FARTHEST:g}"
        )
    station = make_station(config, hand, support, recorded_base(options, recorded))
    recorded |= station_facts(station)
    space = Workspace(1.0, mesh.bounds.mean(axis=0), float(mesh.extents.max()))
    known = replace(Known.for_hand(config, hand, space, support), station=station)
    path = (options.output or options.mesh.parent) / "grasps.json"
    with result_file(path) as temporary:
        search = write_grasps(temporary, known, mesh, config, recorded)
    say_search(search)
    if search.grasps and recorded.get("estimator") == "lis":
        say(f"warning: {_ON_LIS}")
    say(f"wrote {path}")
    if options.isaac:
        save_isaac_grasps(path.with_name("grasps.isaac.yaml"), search, hand)
        say(f"wrote {path.with_name('grasps.isaac.yaml')}")
    if options.dexgraspbench:
        if "object" in recorded:
            mesh = placed_as_recorded(opt.announced(find_object(config)), recorded).mesh
        name = Path(recorded.get("object", options.mesh)).stem
        folder = write_dexgraspbench(path.parent, name, mesh, hand, search, support)
        say(f"wrote {folder}: copy hand/lis_{hand.name}.yaml to the benchmark's config/hand, then")
        say(f"  python src/main.py task=eval hand=lis_{hand.name} save_dir={folder}")
    if "object" in recorded and search.grasps:
        say(f"next: lis-grasp lift {path}")


def write_grasps(
    path: Path, known: Known, mesh: trimesh.Trimesh, config: RunConfig, recorded: dict[str, Any]
) -> GraspSearch:
    """Plan grasps on a surface with the recorded facts, write them, and return them."""
    with Stage(f"Planning grasps of {known.hand.name}") as stage:
        search = pipeline.plan(known, mesh)
        names = ("hand", "arm", "base", "mass", "friction", "load", "grasps", "seed")
        facts = {name: getattr(config, name) for name in names}
        header = provenance.merge(recorded, **facts, support_height=known.support)
        search.save(path, header=header)
        stage.result = f"{len(search.grasps)} grasps of {search.candidates} candidates"
    return search


def write_dexgraspbench(
    output: Path, name: str, mesh: trimesh.Trimesh, hand: Hand, search: GraspSearch, support: float
) -> Path:
    """Write the folder of DexGraspBench in `output` and the results of its protocol; return it."""
    from lis_grasp.simulation.mujoco.dexgraspbench_protocol import dexgraspbench_protocol

    with Stage("Splitting into convex pieces") as stage:
        pieces = convex_pieces(mesh)
        stage.result = str(len(pieces))
    folder = output / "dexgraspbench"
    target = TabletopObject(name, pieces, support)
    folder = save_for_dexgraspbench(folder, target, hand, search.grasps)
    with Stage("Testing by the protocol of DexGraspBench") as stage:
        tests = [dexgraspbench_protocol(hand, g, pieces, support) for g in search.grasps]
        lifts, holds = (sum(getattr(t, f) for t in tests) for f in ("table_lift", "force_test"))
        stage.result = f"of {len(tests)} grasps {lifts} pass the table lift, {holds} the force test"
    write_json(folder / "protocol.json", [asdict(test) for test in tests])
    return folder


def recorded_base(options: argparse.Namespace, recorded: dict[str, Any]) -> FloatArray | None:
    """Return the recorded pose of the arm's base (4, 4), unless another arm or base is given."""
    if options.arm is not None or options.base is not None or "X_EA" not in recorded:
        return None
    return require_pose("X_EA", recorded["X_EA"])


def say_search(search: GraspSearch) -> None:
    """Print the best grasp, or why there is none."""
    if search.grasps:
        best = search.grasps[0]
        fingers = ", ".join(best.contact_fingers)
        say(
            f"best grasp: predicted success {best.quality['success_probability']:.2f},"
            f" epsilon {best.quality['epsilon']:.3f}, with {fingers}"
        )
        return
    say("no grasp found; rejected candidates by reason:")
    for reason, count in sorted(search.rejections.items(), key=lambda item: -item[1]):
        if count:
            say(f"  {count:6d}  {rejection_sentence(reason)} ({reason})")


def load_mesh(path: Path, units: str | None, recorded: dict[str, Any]) -> trimesh.Trimesh:
    """Return the mesh of a file [m]: an estimate with recorded facts, or repaired."""
    # A surface of this package has an uncertainty, and is in metres already.
    if recorded and units is None:
        return load_surface(path)
    return opt.announced(load(path, units=units or "m")).mesh
