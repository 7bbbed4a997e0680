"""`lis-grasp grasp`: force-closure grasps on a mesh, estimated or your own."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import trimesh

from lis_grasp import pipeline
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import result_file
from lis_grasp.grasping.grasps import GraspSearch, save_grasps
from lis_grasp.grasping.isaac_grasps import save_isaac_grasps
from lis_grasp.hands.hand import Hand
from lis_grasp.io import provenance
from lis_grasp.io.surface_files import load_surface
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.shapes import load


def add_parser(verbs: Any) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser("grasp", help="plan grasps on a mesh, write grasps.json")
    parser.add_argument(
        "mesh", type=Path, metavar="MESH", help="surface.ply of `estimate`, or any mesh file"
    )
    parser.add_argument(
        "--units", choices=list(opt.UNITS), default=None, help="length unit of MESH (default: m)"
    )
    parser.add_argument(
        "--support",
        type=float,
        metavar="METRES",
        help="height of the plane that the object stands on (default: as recorded, else the"
        " lowest point of MESH)",
    )
    parser.add_argument(
        "--isaac", action="store_true", help="write them for Isaac Sim too, as grasps.isaac.yaml"
    )
    opt.add_hand(parser)
    opt.add_friction(parser)
    opt.add_grasps(parser)
    opt.add_seed(parser)
    opt.add_output(parser, "the folder of MESH")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Plan grasps, and write them."""
    recorded = provenance.read(options.mesh) if options.mesh.suffix.lower() == ".ply" else {}
    config = opt.configure(options, recorded)
    mesh = _load(options.mesh, options.units, recorded)
    hand = Hand.load(config.hand)
    support = options.support
    if support is None:
        support = recorded.get("support_height", float(mesh.bounds[0, 2]))
    with Stage(f"Planning grasps of {hand.name}") as stage:
        search = pipeline.plan(
            mesh,
            hand,
            support=support,
            friction=config.friction,
            count=config.grasps,
            seed=config.seed,
        )
        stage.result = f"{len(search.grasps)} grasps of {search.candidates} candidates"
    path = (options.output or options.mesh.parent) / "grasps.json"
    with result_file(path) as temporary:
        save_grasps(temporary, search, header=grasp_header(recorded, config, support))
    say_search(search)
    say(f"wrote {path}")
    if options.isaac:
        save_isaac_grasps(path.with_name("grasps.isaac.yaml"), search, hand)
        say(f"wrote {path.with_name('grasps.isaac.yaml')}")
    if "object" in recorded and search.grasps:
        say(f"next: lis-grasp lift {path}")


def grasp_header(recorded: dict[str, Any], config: RunConfig, support: float) -> str:
    """Return the header of grasps, on top of what is recorded of the surface."""
    return provenance.merge(
        recorded,
        hand=config.hand,
        friction=config.friction,
        grasps=config.grasps,
        seed=config.seed,
        support_height=support,
    )


def say_search(search: GraspSearch) -> None:
    """Print the best grasp, or why there is none."""
    if search.grasps:
        best = search.grasps[0]
        fingers = ", ".join(best.contact_fingers)
        say(
            f"best grasp: holds with a probability of {best.quality['success_probability']:.2f},"
            f" epsilon {best.quality['epsilon']:.3f}, with {fingers}"
        )
        return
    say("no grasp found; rejected candidates by reason:")
    for reason, count in sorted(search.rejections.items(), key=lambda item: -item[1]):
        say(f"  {count:6d}  {reason}")


def _load(path: Path, units: str | None, recorded: dict[str, Any]) -> trimesh.Trimesh:
    # A surface of ours carries its uncertainty and is in metres already.
    if recorded and units is None:
        return load_surface(path)
    shape = load(path, units=units or "m")
    for repair in shape.repairs:
        say(f"repaired: {repair}")
    return shape.mesh
