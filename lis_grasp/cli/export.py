"""`lis-grasp export`: an estimated object as URDF, SDF or MJCF for simulators."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable
from pathlib import Path

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import PRINTED, Stage, say
from lis_grasp.exceptions import InvalidFileError, require_at_least
from lis_grasp.exports.object_models import FORMATS, MARK, VISUAL, ObjectModel
from lis_grasp.results.grasped_file import load_mesh
from lis_grasp.shapes import default_mass
from lis_grasp.shapes.solids import convex_parts
from lis_grasp.task.recorded_facts import read_facts
from lis_grasp.task.task import Task

_MOST_PARTS = 32


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    opt.add_mesh(parser)
    parser.add_argument(
        "--format",
        nargs="+",
        choices=list(FORMATS),
        default=list(FORMATS),
        help="formats to write (default: all)",
    )
    parser.add_argument(
        "--name", metavar="NAME", help="name of the model (default: that of the object, or of MESH)"
    )
    parser.add_argument(
        "--parts",
        type=int,
        default=_MOST_PARTS,
        metavar="N",
        help=f"convex parts at most; 1 is the convex hull (default: {_MOST_PARTS})",
    )
    opt.add_options(parser, "units", "up")
    opt.add_options(parser, "mass", "friction", recorded=True)
    opt.add_output(parser, "model in the folder of MESH")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Split the mesh into convex parts, and write the descriptions."""
    recorded = read_facts(options.mesh, usual="surface.ply")
    require_at_least(1, parts=options.parts)
    task = Task.from_facts(vars(options), recorded)
    mesh = load_mesh(options.mesh, vars(options), recorded, PRINTED)
    folder = options.output or options.mesh.parent / "model"
    name = options.name or Path(recorded.get("object", options.mesh)).stem
    name = re.sub(r"[^\w.-]", "_", name)
    formats = dict.fromkeys(options.format)
    _require_own(folder, name, formats, options.mesh)
    with Stage("Splitting into convex parts") as stage:
        parts = convex_parts(mesh, most=options.parts)
        volume = sum(part.volume for part in parts) / mesh.volume
        stage.result = f"{len(parts)}, of {100 * volume:.0f} % of the object's volume together"
    mass = default_mass(mesh, task.world.object) if task.world.mass is None else task.world.mass
    model = ObjectModel(name, mesh, parts, mass, task.world.friction)
    for format_name in formats:
        say(f"wrote {model.save(folder, format_name)}")
    say(f"object: {mass:.3g} kg of uniform density, friction {task.world.friction:g}")


def _require_own(folder: Path, name: str, formats: Iterable[str], mesh: Path) -> None:
    """Raise `InvalidFileError` if a model would replace its mesh, or a file of another program.

    Meshes are this package's own if a description beside them is.
    """
    endings = {ending for ending, _ in FORMATS.values()}
    ours = {
        path
        for path in folder.glob("*")
        if path.suffix in endings and path.is_file() and MARK in path.read_text(errors="replace")
    }
    meshes = [folder / VISUAL, *folder.glob("part_*.obj")]
    if ours:
        ours.update(meshes)
    for path in (*meshes, *(folder / f"{name}{FORMATS[f][0]}" for f in formats)):
        if path.exists() and (path not in ours or path.samefile(mesh)):
            raise InvalidFileError(
                f"{path} would be replaced, and is not a model that lis_grasp wrote: name another"
                " folder with --output",
                path=path,
            )
