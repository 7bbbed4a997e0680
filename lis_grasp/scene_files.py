"""The scene of a folder of results, made from the files that the stages wrote there."""

from __future__ import annotations

from pathlib import Path

from lis_grasp import provenance
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.grasping.grasp import load_grasps
from lis_grasp.grasping.hand import Hand
from lis_grasp.mesh_files import load_surface
from lis_grasp.motion import Motion
from lis_grasp.output_files import whole_file
from lis_grasp.shapes import find
from lis_grasp.visualization import write_scene


def write_scene_of(directory: Path, *, summary: tuple[str, ...] = ()) -> Path:
    """Write scene.html from whatever results the folder holds, and return its path.

    Raises
    ------
    InvalidFileError
        If the folder holds neither contacts nor a surface nor grasps.
    """
    files = {
        name: directory / name
        for name in ("contacts.ply", "surface.ply", "grasps.json", "motion.npz")
        if (directory / name).exists()
    }
    sources = [files[n] for n in ("grasps.json", "surface.ply", "contacts.ply") if n in files]
    if not sources:
        raise InvalidFileError(
            f"{directory} holds no results (contacts.ply, surface.ply or grasps.json):"
            " name a folder that `lis-grasp run` or another verb wrote"
        )
    facts = provenance.read(sources[0])
    truth = None
    if "object" in facts:
        truth = find(facts["object"], size=facts.get("size"), units=facts.get("units", "m"))
    contacts = files.get("contacts.ply")
    surface = files.get("surface.ply")
    grasps = files.get("grasps.json")
    motion = files.get("motion.npz")
    path = directory / "scene.html"
    with whole_file(path) as temporary:
        write_scene(
            temporary,
            truth=None if truth is None else truth.mesh,
            estimate=None if surface is None else load_surface(surface),
            contacts=Contacts.empty() if contacts is None else Contacts.load(contacts),
            grasps=() if grasps is None else load_grasps(grasps).grasps,
            hand=Hand.load(facts.get("hand", "allegro")),
            motion=None if motion is None else Motion.load(motion),
            support_height=facts.get("support_height"),
            title=f"lis_grasp: {truth.name if truth is not None else directory.name}",
            summary=summary,
        )
    return path
