"""The estimate from files of contacts, written as a surface."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from trimesh.graph import connected_components

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError, LisGraspError
from lis_grasp.io import provenance
from lis_grasp.io.contact_files import read_point_file
from lis_grasp.results.folder import LOG, require_own, result_file, view_paths
from lis_grasp.results.notes import WARNING
from lis_grasp.results.progress import SILENT, Progress
from lis_grasp.results.stage_files import (
    NOISE,
    write_surface,
)
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.stages.contact_sources import ContactSource, join_sources, read_source
from lis_grasp.stages.known_table import known_table
from lis_grasp.stages.looking import load_views
from lis_grasp.stages.views_prior import ViewsPrior
from lis_grasp.surfaces.contact_checks import doubt_of_side
from lis_grasp.surfaces.estimators import require_noise_below_size
from lis_grasp.task.recorded_facts import read_facts
from lis_grasp.task.task import Task, require_options
from lis_grasp.typing import FloatArray
from lis_grasp.views import Views

OPTIONS = ("estimator", "free_space", "keep_all", "views", "hand_eye")
"""Options of an estimate, beside the noise of its contacts."""

# Fields by which contacts are compared.
_COMPARED = ("points", "normals", *NOISE)


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedFile:
    """A surface in a file, and the contacts that it was estimated from."""

    path: Path
    mesh: trimesh.Trimesh  #: in O [m]
    contacts: Contacts
    has_new_contacts: bool  #: whether contacts.ply was written beside it


def estimate_file(
    sources: Sequence[ContactSource],
    folder: Path | None = None,
    *,
    support: float | Literal["none"] | None = None,
    progress: Progress = SILENT,
    **options: Any,
) -> EstimatedFile:
    """Estimate the surface from files of contacts of one object, and write surface.ply.

    Its contacts are written beside it if the folder lacks them, and files made from an earlier
    surface are removed. `folder` is by default that of the first file. `support` is the height of
    the table under the object [m], which closes the estimate from below, or "none" for an object
    held in the air; by default as recorded in the files. The options are ``estimator``,
    ``free_space``, ``keep_all``, ``views`` and ``hand_eye``, by default as recorded in the files,
    else as in `Task`.

    Raises `InvalidContactsError` if there are no contacts, `InvalidOptionError` if the folder has
    others that must be kept, `TypeError` for another option.

    Examples
    --------
    >>> contacts.save("contacts.ply")
    >>> source = pipeline.ContactSource("contacts.ply")
    >>> made = pipeline.estimate_file([source], Path("estimated"), estimator="gpis")
    >>> made.path.name, made.mesh.is_watertight
    ('surface.ply', True)
    """
    require_options(options, OPTIONS)
    paths = [Path(source.path) for source in sources]
    contacts, recorded = _load_sources(sources)
    if not len(contacts):
        raise InvalidContactsError(f"{paths[0]} has no contacts: add at least one row")
    noise = {n: getattr(sources[0], n) for n in NOISE if len({getattr(s, n) for s in sources}) == 1}
    task = Task.from_facts({"estimator": None, **noise, **options}, recorded)
    require_noise_below_size(contacts, task.robot.position_noise)
    place, known = known_table(support, task, recorded)
    views = _views(options.get("views"), task, recorded, paths[0].parent, place.support)
    if views is not None:
        known = replace(known, prior=ViewsPrior(views))
    folder = paths[0].parent if folder is None else folder
    is_kept = _require_contacts_fit(folder, contacts, paths)
    checked = "object" in recorded or any(source.normals or source.viewpoint for source in sources)
    warnings = list(recorded.get("warnings") or ())
    for line in _findings(contacts, paths, checked=checked):
        progress.say(line)
        warnings += [line.removeprefix(WARNING)] if line.startswith(WARNING) else []
    if doubt := place.doubt(contacts):
        warnings.append(doubt)  # for grasps
        progress.say("table: unknown; if the object is on one, `support` closes the estimate there")
    made = {**recorded, "support_height": place.table(contacts)}
    if place.held:
        del made["support_height"]
    if support is not None and task.world.prober == "dynamic":  # a kinematic one has fixed objects
        made["free"] = not place.held
    made |= {"warnings": warnings} if warnings else {}
    path = folder / "surface.ply"
    with result_file(path, progress) as temporary:
        mesh = write_surface(temporary, known, contacts, made, progress)
        if not is_kept:
            with result_file(folder / "contacts.ply", progress) as copy:
                given = {} if place.support is None else {"support_height": place.support}
                contacts.save(copy, header=provenance.merge(recorded, **given))
    if doubt := _doubt_of_one(mesh, contacts):
        progress.say(f"{WARNING}{doubt}")
    return EstimatedFile(path, mesh, contacts, not is_kept)


def _views(
    given: Sequence[str] | None,
    task: Task,
    recorded: Mapping[str, Any],
    folder: Path,
    support_height: float | None,
) -> Views | None:
    """Return the given views, else those that belong to the contacts; None without any.

    An exploration keeps its views beside its contacts, unless it lost the object.
    """
    seen = recorded.get("seen")
    paths: Sequence[Path | str] = given or task.known.views or ()
    if not given and seen is not None:
        paths = view_paths(folder, seen)
    if not paths:
        return None
    if support_height is None:
        raise InvalidOptionError(
            "views are of an object on a table: give its height by `support`", option="support"
        )
    return Views(tuple(load_views(paths, task, support_height)), support_height)


def _load_sources(sources: Sequence[ContactSource]) -> tuple[Contacts, dict[str, Any]]:
    """Return the contacts of all files, and their recorded facts, the first file's first.

    Contacts of several files carry the noise of their own file.
    """
    if len(sources) == 1:
        return read_source(sources[0])
    recorded: dict[str, Any] = {}
    contacts = join_sources(sources)
    for source in reversed(sources):
        recorded |= read_facts(Path(source.path))
    # The contacts carry the sensor noise that the files record.
    return contacts, {k: v for k, v in recorded.items() if k not in NOISE}


def _require_contacts_fit(folder: Path, contacts: Contacts, sources: Sequence[Path]) -> bool:
    """Return whether the contacts.ply of a folder has the contacts of a new surface.

    Raises `InvalidOptionError` if it has other contacts that must be kept (a source of the new
    ones, or contacts of an exploration), or if its surface.ply is a source.
    """
    path, inputs = folder / "contacts.ply", [source.resolve() for source in sources]
    if (folder / "surface.ply").resolve() in inputs:
        raise InvalidOptionError(
            f"{folder}/surface.ply would be replaced by its own estimate: estimate from contacts,"
            " or name another by `folder`",
            option="folder",
            value=str(folder),
        )
    if not path.exists():
        return False
    with suppress(LisGraspError):  # points without normals, perhaps
        present = Contacts.load(path)
        both = ([np.asarray(getattr(c, n), float) for c in (present, contacts)] for n in _COMPARED)
        if all(np.array_equal(first, second, equal_nan=True) for first, second in both):
            return True
    require_own(path)
    if (folder / LOG).exists() or path.resolve() in inputs:
        raise InvalidOptionError(
            "contacts.ply in the folder of results must have the contacts of the surface, in metres"
            f" and with outward normals; {path} has others: name another by `folder`",
            option="folder",
            value=str(folder),
        )
    return False


def _doubt_of_one(mesh: trimesh.Trimesh, contacts: Contacts) -> str:
    """Return how many separate bodies an estimate has that were touched; empty for one."""
    faces = connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))
    if len(faces) < 2:
        return ""
    _, nearest = distances_to_mesh(contacts.points, mesh)
    part_of = np.empty(len(mesh.faces), dtype=np.intp)
    for part, members in enumerate(faces):
        part_of[members] = part
    count = len(np.unique(part_of[nearest]))
    if count < 2:
        return ""
    return (
        f"the estimate has {count} separate bodies that were touched, and its size is that of all"
        " together: give the contacts of one object"
    )


def _findings(contacts: Contacts, paths: Sequence[Path], *, checked: bool) -> Iterator[str]:
    """Yield the extent of contacts, the certainty of estimated normals, and warnings."""
    yield f"contacts: {len(contacts)} within {millimetres(np.ptp(contacts.bounds, axis=0))}"
    files = [file for file in map(read_point_file, paths) if file["normals"] is None]
    if files and contacts.normal_noise is not None:
        degrees = np.rad2deg(np.nanmedian(contacts.normal_noise))
        have_all = all(file["approach"] is not None for file in files)
        advice = "" if have_all else "; directions of approach in columns ax,ay,az make it smaller"
        yield f"normals: estimated, with a median standard deviation of {degrees:.0f} deg{advice}"
    doubt = "" if checked else doubt_of_side(contacts)
    if doubt:
        yield f"{WARNING}{doubt}"


def millimetres(extents: FloatArray) -> str:
    """Return extents (3,) [m] as text."""
    return " x ".join(f"{1e3 * extent:.3g}" for extent in extents) + " mm"
