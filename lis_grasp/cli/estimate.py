"""`lis-grasp estimate`: surface estimation from contacts, written as a mesh."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import get_args

import numpy as np

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import PRINTED, say
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.pipeline.contact_sources import ContactSource
from lis_grasp.pipeline.file_stages import estimate_file, millimetres
from lis_grasp.shapes import UNITS
from lis_grasp.surfaces.contact_loading import NormalSide


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
    parser.add_argument(
        "--fingertip-radius",
        type=float,
        action="append",
        metavar="METRES",
        help="the points are centres of a spherical fingertip of this radius (default: 0, they are"
        " on the surface); for several files repeat it, in their order",
    )
    parser.add_argument(
        "--units",
        choices=list(UNITS),
        help="length unit of CONTACTS (default: what the file states, else m)",
    )
    parser.add_argument(
        "--normals",
        choices=get_args(NormalSide),
        help="side that the normals of CONTACTS point to; unsigned: unknown for each, the likeliest"
        " sides are chosen (default: outward, which is checked)",
    )
    parser.add_argument(
        "--viewpoint",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="place of the sensor [m] that the normals of CONTACTS point to",
    )
    names = ("estimator", "free_space", "keep_all", "position_noise", "normal_noise")
    opt.add_options(parser, *names, recorded=True)
    opt.add_output(parser, "the folder of CONTACTS")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Estimate the surface, and print what was written."""
    paths = options.contacts
    radii = options.fingertip_radius or [0.0] * len(paths)
    if len(radii) != len(paths):
        raise InvalidOptionError.out_of_range(
            "fingertip-radius", radii, f"given once for each of the {len(paths)} files"
        )
    noise = options.position_noise, options.normal_noise
    sources = [
        ContactSource(path, options.units, options.normals, *noise, radius, options.viewpoint)
        for path, radius in zip(paths, radii, strict=True)
    ]
    used = opt.given(options, "estimator", "free_space", "keep_all")
    made = estimate_file(sources, options.output, progress=PRINTED, **used)
    uncertainty = np.median(made.mesh.vertex_attributes["uncertainty"])
    say(
        f"estimate: {millimetres(made.mesh.extents)}, with a median standard deviation of"
        f" {1e3 * uncertainty:.2g} mm"
    )
    say(f"wrote {made.path}" + (", contacts.ply" if made.has_new_contacts else ""))
    say(f"next: lis-grasp grasp {made.path}")
