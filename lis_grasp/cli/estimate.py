"""`lis-grasp estimate`: surface estimation from contacts, written as a mesh."""

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
from lis_grasp.pipeline.run_config import RunConfig


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
    opt.add_options(parser, "estimator", "free_space", "position_noise", "normal_noise")
    opt.add_output(parser, "the folder of CONTACTS")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Estimate the surface, and write its mesh."""
    contacts = Contacts.load(options.contacts)
    recorded = provenance.read(options.contacts)
    config = opt.configure(options, recorded)
    path = (options.output or options.contacts.parent) / "surface.ply"
    with result_file(path) as temporary:
        write_surface(temporary, contacts, config, recorded)
    say(f"wrote {path}")
    say(f"next: lis-grasp grasp {path}")


def write_surface(
    path: Path, contacts: Contacts, config: RunConfig, recorded: dict[str, Any]
) -> None:
    """Estimate a surface from contacts with the recorded facts, and write its mesh."""
    with Stage(f"Estimating the surface ({config.estimator})") as stage:
        _, mesh = pipeline.estimate(
            contacts, config.estimator, config.sensor(), free_space=config.free_space
        )
        names = ("estimator", "position_noise", "normal_noise", "free_space")
        facts = {name: getattr(config, name) for name in names}
        save_surface(mesh, path, header=provenance.merge(recorded, **facts))
        stage.result = f"{len(mesh.faces)} triangles from {len(contacts)} contacts"
