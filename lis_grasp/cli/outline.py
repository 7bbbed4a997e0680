"""`lis-grasp outline`: the silhouette of an estimate as DXF and SVG, with a clearance."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import PRINTED, say
from lis_grasp.exports.outline import AXES, USUAL_PROBABILITY, outline
from lis_grasp.exports.outline_files import FORMATS, save_outline
from lis_grasp.results.grasped_file import load_mesh
from lis_grasp.task.recorded_facts import read_facts


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    text = "surface.ply of `estimate`, the folder of a run, or any mesh file"
    parser.add_argument("mesh", type=Path, metavar="SURFACE|RUN", help=text)
    parser.add_argument(
        "--clearance-for",
        type=float,
        default=USUAL_PROBABILITY,
        metavar="P",
        help="probability that the object goes into the cut-out, 0.5 to 0.95"
        f" (default: {USUAL_PROBABILITY:g})",
    )
    view = parser.add_mutually_exclusive_group()
    view.add_argument(
        "--axis", choices=AXES, default="z", help="axis to look along, from its end (default: z)"
    )
    view.add_argument(
        "--pose",
        type=int,
        metavar="N",
        help="look from above at the object in a resting pose, 0 the likeliest",
    )
    opt.add_options(parser, "units", "up")
    opt.add_output(parser, "that of the surface")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Compute the outline, and write it in each format."""
    path = options.mesh / "surface.ply" if options.mesh.is_dir() else options.mesh
    recorded = read_facts(path, usual="surface.ply")
    mesh = load_mesh(path, vars(options), recorded, PRINTED)
    found = outline(mesh, options.axis, pose=options.pose, clearance_for=options.clearance_for)
    folder = options.output or path.parent
    for ending in FORMATS:
        save_outline(found, folder / f"outline{ending}")
    low, high = found.polygon.bounds[:2], found.polygon.bounds[2:]
    width, height = (1e3 * (b - a) for a, b in zip(low, high, strict=True))
    say(f"outline   {width:.1f} x {height:.1f} mm, {1e6 * found.polygon.area:.0f} mm2")
    meaning = f"the object goes in with probability {options.clearance_for:g}"
    if "uncertainty" not in mesh.vertex_attributes:
        meaning = "the mesh has no uncertainty, and is taken to be exact"
    say(f"clearance {1e3 * found.clearance:.1f} mm: {meaning}")
    say(f"wrote {folder / 'outline.dxf'}, outline.svg")
