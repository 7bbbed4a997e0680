"""`lis-grasp estimate`: surface estimation from contacts, written as a mesh."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, get_args

import numpy as np
import trimesh

from lis_grasp import pipeline, surfaces
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import LOG, require_own, result_file
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError, LisGraspError
from lis_grasp.io import provenance
from lis_grasp.io.contact_files import read_point_file
from lis_grasp.io.surface_files import save_surface
from lis_grasp.pipeline.scenario import Perception
from lis_grasp.shapes import UNITS
from lis_grasp.surfaces.contact_loading import DOUBTFUL, NormalSide, fraction_in_front
from lis_grasp.typing import FloatArray

_NOISE = ("position_noise", "normal_noise")
# Fields that distinguish contacts.
_COMPARED = ("points", "normals", *_NOISE)
# Fewer contacts show hardly more than position and size: a run plans no grasp on them either.
_FEW = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument(
        "contacts",
        type=Path,
        nargs="+",
        metavar="CONTACTS",
        help="points and outward normals: a .ply oriented point cloud, or a .csv with"
        " columns x,y,z,nx,ny,nz; without normals they are estimated, from the direction of"
        " approach too if there are columns ax,ay,az (.off and .xyz: points only); several files,"
        " one for each sensor, are joined",
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
        "--units", choices=list(UNITS), default="m", help="length unit of CONTACTS (default: m)"
    )
    parser.add_argument(
        "--normals",
        choices=get_args(NormalSide),
        help="side that the normals of CONTACTS point to (default: outward, which is checked)",
    )
    names = ("estimator", "free_space", "position_noise", "normal_noise")
    opt.add_options(parser, *names, recorded=True)
    opt.add_output(parser, "the folder of CONTACTS")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Estimate the surface, and write its mesh, with its contacts if the folder lacks them."""
    contacts, recorded = load_contacts(options)
    if not len(contacts):
        raise InvalidContactsError(f"{options.contacts[0]} has no contacts: add at least one row")
    config = opt.configure(options, recorded)
    folder: Path = options.output or options.contacts[0].parent
    kept = _require_contacts_fit(folder, contacts, options.contacts)
    say(f"contacts: {len(contacts)} within {_millimetres(np.ptp(contacts.bounds, axis=0))}")
    _say_estimated_normals(contacts, options.contacts)
    doubt = 0.0 if options.normals else fraction_in_front(contacts)
    if doubt > DOUBTFUL and "object" not in recorded:
        say(
            f"warning: {100 * doubt:.0f} % of the contacts are in front of another: if the estimate"
            " is inside out, give --normals inward"
        )
    path = folder / "surface.ply"
    if len(contacts) < _FEW:
        say(
            f"warning: fewer than {_FEW} contacts show little more than position and size of an"
            " object, and the standard deviation is too small"
        )
    with result_file(path) as temporary:
        known = Perception.from_config(config, recorded.get("support_height"))
        mesh = write_surface(temporary, known, contacts, recorded)
        if not kept:
            with result_file(folder / "contacts.ply") as copy:
                contacts.save(copy, header=provenance.merge(recorded))
    uncertainty = np.median(mesh.vertex_attributes["uncertainty"])
    say(
        f"estimate: {_millimetres(mesh.extents)}, with a median standard deviation of"
        f" {1e3 * uncertainty:.2g} mm"
    )
    say(f"wrote {path}" + ("" if kept else ", contacts.ply"))
    say(f"next: lis-grasp grasp {path}")


def _require_contacts_fit(folder: Path, contacts: Contacts, sources: Sequence[Path]) -> bool:
    """Return whether a folder has the contacts of a new surface as its contacts.ply.

    Raises
    ------
    InvalidOptionError
        If it has others that must be kept: a source of the new ones, or those of an exploration;
        or if its surface.ply is a source.
    """
    path, inputs = folder / "contacts.ply", [source.resolve() for source in sources]
    if (folder / "surface.ply").resolve() in inputs:
        raise InvalidOptionError(
            f"{folder}/surface.ply would be replaced by its own estimate: estimate from contacts,"
            " or name another folder with --output",
            option="--output",
            value=str(folder),
        )
    if not path.exists():
        return False
    with suppress(LisGraspError):  # points without normals, perhaps
        known = Contacts.load(path)
        if all(_are_equal(getattr(known, n), getattr(contacts, n)) for n in _COMPARED):
            return True
    require_own(path)
    if (folder / LOG).exists() or path.resolve() in inputs:
        raise InvalidOptionError(
            "contacts.ply in the folder of results must have the contacts of the surface, in metres"
            f" and with outward normals; {path} has others: name another folder with --output",
            option="--output",
            value=str(folder),
        )
    return False


def _are_equal(first: FloatArray | None, second: FloatArray | None) -> bool:
    if first is None or second is None:
        return first is second
    return np.array_equal(first, second, equal_nan=True)


def _say_estimated_normals(contacts: Contacts, sources: Sequence[Path]) -> None:
    """Print how certain estimated normals are, and what would make them more certain."""
    files = [file for file in map(read_point_file, sources) if file["normals"] is None]
    if not files or contacts.normal_noise is None:
        return
    degrees = np.rad2deg(np.nanmedian(contacts.normal_noise))
    known = all(file["approach"] is not None for file in files)
    advice = "" if known else "; directions of approach in columns ax,ay,az make it smaller"
    say(f"normals: estimated, with a median standard deviation of {degrees:.0f} deg{advice}")


def load_contacts(options: argparse.Namespace) -> tuple[Contacts, dict[str, Any]]:
    """Return the contacts of all files, and the facts that they record, of the first file first.

    Contacts of several files carry the noise of their file.
    """
    paths = options.contacts
    radii = options.fingertip_radius or [0.0] * len(paths)
    if len(radii) != len(paths):
        raise InvalidOptionError.out_of_range(
            "fingertip-radius", radii, f"given once for each of the {len(paths)} files"
        )
    if len(paths) == 1:
        recorded = provenance.read(paths[0])
        contacts = surfaces.load_contacts(
            paths[0],
            units=options.units,
            # Normals that this package simulated are outward.
            normals=options.normals or ("outward" if "object" in recorded else None),
            fingertip_radius=radii[0],
            position_noise=options.position_noise,
        )
        return contacts, recorded
    contacts = pipeline.join_sources(
        pipeline.ContactSource(
            path,
            options.units,
            options.normals,
            options.position_noise,
            options.normal_noise,
            radius,
        )
        for path, radius in zip(paths, radii, strict=True)
    )
    recorded = {}
    for path in reversed(paths):
        recorded |= provenance.read(path)
    # The contacts carry what the files record of their sensors.
    return contacts, {k: v for k, v in recorded.items() if k not in _NOISE}


def write_surface(
    path: Path, known: Perception, contacts: Contacts, recorded: dict[str, Any]
) -> trimesh.Trimesh:
    """Estimate a surface from contacts with the recorded facts, and write and return its mesh."""
    with Stage(f"Estimating the surface ({known.estimator})") as stage:
        _, mesh = pipeline.estimate(known, contacts)
        facts = {name: getattr(known.sensor, name) for name in _NOISE}
        facts |= {"estimator": known.estimator, "free_space": known.free_space}
        save_surface(mesh, path, header=provenance.merge(recorded, **facts))
        stage.result = f"{len(mesh.faces)} triangles from {len(contacts)} contacts"
    return mesh


def _millimetres(extents: FloatArray) -> str:
    """Return extents (3,) [m] as text."""
    return " x ".join(f"{1e3 * extent:.3g}" for extent in extents) + " mm"
