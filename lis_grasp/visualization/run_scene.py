"""Scene of a folder of results, read from the files that the stages wrote there."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from lis_grasp.arms.station import Station, Table
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, LisGraspError
from lis_grasp.exploration import Exploration, ProbeOutcome, Region, load_outcomes
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.surface_files import load_growth, load_surface
from lis_grasp.motion import Motion
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import find, placed_as_recorded
from lis_grasp.visualization._exploration_layers import search_of
from lis_grasp.visualization.scene import Scene

_SOURCES = ("grasps.json", "surface.ply", "contacts.ply")


def write_scene_of(directory: Path, *, summary: tuple[str, ...] = ()) -> Path:
    """Write scene.html from the results in a folder, and return its path; see `scene_of`."""
    path = directory / "scene.html"
    scene_of(directory, summary=summary).save(path)
    return path


def scene_of(directory: Path, *, summary: tuple[str, ...] = ()) -> Scene:
    """Return the scene of the results in a folder.

    Raises
    ------
    InvalidFileError
        If the folder has neither contacts nor a surface nor grasps.
    """
    files = {
        name: directory / name
        for name in (*_SOURCES, "motion.npz", "touches.jsonl")
        if (directory / name).exists()
    }
    source = next((files[name] for name in _SOURCES if name in files), None)
    if source is None:
        raise InvalidFileError(
            f"{directory} has no results ({', '.join(_SOURCES)}): name a folder that `lis-grasp"
            " run` or another verb wrote",
            path=directory,
        )
    facts = provenance.read(source)
    content: dict[str, Any] = {"support_height": facts.get("support_height"), "summary": summary}
    content["title"] = f"lis_grasp: {directory.name}"
    if "object" in facts:
        with suppress(InvalidFileError):  # a mesh that is elsewhere now: the scene lacks the truth
            truth = find(facts["object"], size=facts.get("size"), units=facts.get("units", "m"))
            truth = placed_as_recorded(truth, facts)
            content |= {"truth": truth.mesh, "title": f"lis_grasp: {truth.name}"}
    content["hand"] = hand = Hand.load(facts.get("hand", "allegro"))
    if facts.get("arm") is not None and "X_EA" in facts:
        height = facts.get("support_height")
        table = None if height is None else Table(float(height))
        content["station"] = Station.make(Arm.load(facts["arm"]), hand, facts["X_EA"], table=table)
    if "contacts.ply" in files:
        content["contacts"] = contacts = Contacts.load(files["contacts.ply"])
        made = provenance.read(files["contacts.ply"])
        if "touches.jsonl" in files and made.get("hand") == facts.get("hand"):
            outcomes = _outcomes(files["touches.jsonl"])
            content["touches"] = _touches(outcomes, contacts, made, hand)
            content |= _search(outcomes, made)
    if "surface.ply" in files:
        content["estimate"] = load_surface(files["surface.ply"])
        growth = load_growth(directory, provenance.read(files["surface.ply"]))
        all_contacts = len(content.get("contacts", ()))
        content["growth"] = [(count, mesh) for count, mesh in growth if count < all_contacts]
    if "grasps.json" in files:
        content["grasps"] = GraspSearch.load(files["grasps.json"]).grasps
    if "motion.npz" in files:
        content["motion"] = Motion.load(files["motion.npz"])
    return Scene(**content)


def _outcomes(log: Path) -> tuple[ProbeOutcome, ...] | None:
    """Return the recorded outcomes; None for a damaged log: the page is complete without it."""
    try:
        return load_outcomes(log)
    except LisGraspError:
        return None


def _search(outcomes: tuple[ProbeOutcome, ...] | None, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the region, the recorded search in it and the object's motion, as far as recorded."""
    recorded = outcomes or ()
    moved = {"moved": recorded}
    if facts.get("region") is None:
        return moved
    return {**moved, "region": Region(facts["region"]), "search": search_of(recorded)}


def _touches(
    outcomes: tuple[ProbeOutcome, ...] | None,
    contacts: Contacts,
    facts: Mapping[str, Any],
    hand: Hand,
) -> list[ProbeOutcome | None]:
    """Return the recorded touch of each contact; none at all if the log has other contacts."""
    if outcomes is None:
        return []
    replayed = Exploration.replay(outcomes, touches=facts.get("touches"))
    count = len(replayed.contacts)
    if not np.array_equal(replayed.contacts.points, contacts.points[:count]):
        return []
    shown = [
        touch
        if touch.hand_pose is not None
        and len(touch.hand_pose.joint_positions) == len(hand.joint_names)
        else None
        for touch in replayed.touches
    ]
    return [*shown, *[None] * (len(contacts) - count)]
