"""`lis-grasp estimate`: a surface from contacts, yours or explored, written as a mesh."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lis_grasp import pipeline
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import result_file
from lis_grasp.contacts import Contacts
from lis_grasp.io import provenance
from lis_grasp.io.surface_files import save_surface


def add_parser(verbs: Any) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser(
        "estimate", help="estimate a surface from contacts, write surface.ply"
    )
    parser.add_argument(
        "contacts",
        type=Path,
        metavar="CONTACTS",
        help="points and outward normals in metres: a .ply oriented point cloud, or a .csv with"
        " columns x,y,z,nx,ny,nz",
    )
    opt.add_estimator(parser)
    opt.add_free_space(parser)
    opt.add_noise(parser)
    opt.add_output(parser, "the folder of CONTACTS")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Estimate the surface, and write its mesh."""
    contacts = Contacts.load(options.contacts)
    recorded = provenance.read(options.contacts)
    config = opt.configure(options, recorded)
    output = options.output or options.contacts.parent
    with Stage(f"Estimating the surface ({config.estimator})") as stage:
        _, mesh = pipeline.estimate(
            contacts, config.estimator, config.sensor(), free_space=config.free_space
        )
        stage.result = f"{len(mesh.faces)} triangles from {len(contacts)} contacts"
    path = output / "surface.ply"
    with result_file(path) as temporary:
        header = provenance.merge(
            recorded,
            estimator=config.estimator,
            position_noise=config.position_noise,
            normal_noise=config.normal_noise,
            free_space=config.free_space,
        )
        save_surface(mesh, temporary, header=header)
    say(f"wrote {path}")
    say(f"next: lis-grasp grasp {path}")
