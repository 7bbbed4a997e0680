"""The scene of a folder of results, made from the files that the stages wrote there."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from lis_grasp import pipeline
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, LisGraspError
from lis_grasp.exploration import (
    STEP_FRACTION,
    Exploration,
    TactileSensor,
    Workspace,
    load_outcomes,
)
from lis_grasp.grasping.grasps import load_grasps
from lis_grasp.hands.hand import Hand
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.io.surface_files import load_surface
from lis_grasp.motion import Motion
from lis_grasp.shapes import Shape, find
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp.visualization import write_scene
from lis_grasp.visualization.touch_poses import TouchPose, replay_touches

# Estimates on the way to the last one; each takes some tenths of a second and half a megabyte.
_STEPS = 8
# The first one on the way, where nearly everything is a guess.
_FIRST = 3
# Estimates from more contacts than these take too long to make only to be looked at.
_MOST_CONTACTS = 300
# So do more hands at their touches: the surface is estimated anew for each, if not meshed.
_MOST_POSES = 60


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
    touched = Contacts.empty() if contacts is None else Contacts.load(contacts)
    growth = [] if surface is None else estimates_on_the_way(touched, provenance.read(surface))
    hand = Hand.load(facts.get("hand", "allegro"))
    log = directory / "touches.jsonl"
    touch_poses: list[TouchPose | None] = []
    if truth is not None and contacts is not None and log.exists():
        made = provenance.read(contacts)
        if made.get("hand") == facts.get("hand"):
            touch_poses = poses_of_touches(log, touched, made, truth, hand)
    path = directory / "scene.html"
    with whole_file(path) as temporary:
        write_scene(
            temporary,
            truth=None if truth is None else truth.mesh,
            estimate=None if surface is None else load_surface(surface),
            contacts=touched,
            growth=growth,
            touch_poses=touch_poses,
            grasps=() if grasps is None else load_grasps(grasps).grasps,
            hand=hand,
            motion=None if motion is None else Motion.load(motion),
            support_height=facts.get("support_height"),
            title=f"lis_grasp: {truth.name if truth is not None else directory.name}",
            summary=summary,
        )
    return path


def estimates_on_the_way(
    contacts: Contacts, facts: Mapping[str, Any]
) -> list[tuple[int, trimesh.Trimesh]]:
    """Estimate the surface again from the first few contacts, from some more, and so on.

    Parameters
    ----------
    contacts
        All contacts, in the order of the touches.
    facts
        What made the surface of them all: its estimator and the sensor's noise. Without an
        estimator that is known here there is nothing on the way.

    Returns
    -------
    list of (int, trimesh.Trimesh)
        Numbers of contacts, increasing, less than all of them; and what the same estimator makes of
        so many. Where it cannot make a surface, there is none.
    """
    estimator = str(facts.get("estimator"))
    if estimator not in ESTIMATORS:
        return []
    growth = []
    for count in counts_on_the_way(len(contacts)):
        try:
            # What was known to be free by then, these contacts do not tell.
            _, mesh = pipeline.estimate(
                contacts.subset(np.arange(count)), estimator, _sensor(facts), free_space=False
            )
        except LisGraspError:  # too few contacts, or nothing that they enclose
            continue
        growth.append((count, mesh))
    return growth


def counts_on_the_way(contacts: int) -> list[int]:
    """Return after how many of so many contacts the surface is estimated, without the last."""
    last = min(contacts, _MOST_CONTACTS)
    counts = {_FIRST, *(round(k * last / _STEPS) for k in range(1, _STEPS + 1))}
    return sorted(n for n in counts if 2 <= n < contacts)


def poses_of_touches(
    log: Path, contacts: Contacts, facts: Mapping[str, Any], truth: Shape, hand: Hand
) -> list[TouchPose | None]:
    """Return where the hand was at each contact, as far as the log of the touches tells.

    Parameters
    ----------
    log
        Of the exploration.
    contacts
        What came of it.
    facts
        What made the contacts: their estimator, the sensor's noise, whether the object was free.
    truth, hand
        The object and the hand of the exploration.

    Returns
    -------
    list of TouchPose or None
        One a contact, None beyond the first 60; empty if the log is not one of these contacts.
    """
    estimator = str(facts.get("estimator"))
    if estimator not in ESTIMATORS:
        return []
    sensor = _sensor(facts)
    noise = {"position_noise": sensor.position_noise, "normal_noise": sensor.normal_noise}
    told = partial(ESTIMATORS[estimator], **noise) if any(noise.values()) else ESTIMATORS[estimator]
    support = facts["support_height"] if facts.get("free") else None
    middle = truth.mesh.bounds.mean(axis=0)
    try:
        outcomes = load_outcomes(log)
        replayed = Exploration.replay(outcomes, touches=len(contacts)).contacts
        if not np.array_equal(replayed.points, contacts.points):
            return []
        poses = replay_touches(
            outcomes,
            min(len(contacts), _MOST_POSES),
            mesh=truth.mesh,
            hand=hand,
            space=Workspace(STEP_FRACTION * truth.size, middle, truth.size, support),
            estimate=told,
            position_noise=sensor.position_noise,
        )
        return poses[: len(contacts)] + [None] * (len(contacts) - len(poses))
    except LisGraspError:  # a damaged log, say; the page does without the hand at its touches
        return []


def _sensor(facts: Mapping[str, Any]) -> TactileSensor:
    return TactileSensor(
        position_noise=facts.get("position_noise", 0.0), normal_noise=facts.get("normal_noise", 0.0)
    )
