"""`lis-grasp estimate`: surface estimation from contacts, written as a mesh."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import PRINTED, next_step, say
from lis_grasp.evaluation.touch_coverage import touch_coverage, touch_radius
from lis_grasp.results.estimated_file import OPTIONS, estimate_file, millimetres


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument(
        "contacts",
        type=Path,
        nargs="+",
        metavar="CONTACTS",
        help="points and outward normals: a .ply oriented point cloud, or a .csv with"
        " columns x,y,z,nx,ny,nz; without normals they are estimated, from the direction of"
        " approach too if there are columns ax,ay,az; also .pcd, .npy, .npz, .off, .xyz and .pts;"
        " several files, one for each sensor, are joined",
    )
    opt.add_support_option(
        parser,
        "height of the table under the object, which closes the estimate from below, or none for an"
        " object that is held in the air (default: as recorded, else the estimate is not closed)",
    )
    opt.add_reading(parser)
    opt.add_options(parser, *OPTIONS, "position_noise", "normal_noise", recorded=True)
    opt.add_output(parser, "the folder of CONTACTS")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Estimate the surface, and print what was written."""
    used = opt.given(options, *OPTIONS)
    sources = opt.sources(options, options.contacts)
    made = estimate_file(sources, options.output, support=options.support, progress=PRINTED, **used)
    usual, high = 1e3 * np.quantile(made.mesh.vertex_attributes["uncertainty"], (0.5, 0.95))
    near = 0.5 * touch_radius(made.mesh)
    guessed = 1.0 - touch_coverage(made.mesh, made.contacts, radius=near)
    say(
        f"estimate: {millimetres(made.mesh.extents)}; the standard deviation is {usual:.2g} mm in"
        f" the median, {high:.2g} mm at the 95 % quantile"
    )
    say(
        f"untouched: {100 * guessed:.0f} % of the surface is more than {1e3 * near:.2g} mm from any"
        " contact on its side; bulges and concavities there are unknown"
    )
    say(f"wrote {made.path}" + (", contacts.ply" if made.has_new_contacts else ""))
    say(next_step("lis-grasp grasp {}", made.path))
