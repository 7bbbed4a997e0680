"""Scene of a folder of results, read from its files."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np

from lis_grasp.arms.station import Station, Table
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, LisGraspError
from lis_grasp.exploration import Exploration, LoggedProbe, ProbeOutcome, Region
from lis_grasp.geometry import inverse_pose, require_pose
from lis_grasp.io.atomic_writing import write_bytes
from lis_grasp.io.limits import reading
from lis_grasp.io.surface_files import load_growth
from lis_grasp.results.folder import LOG, PAGE, PICTURE, read_touches, view_paths
from lis_grasp.results.run_results import SOURCES, Run
from lis_grasp.results.summary import headline, run_lines
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.stages.place import corner_walls
from lis_grasp.stages.surroundings import find_surroundings
from lis_grasp.stages.views_prior import ViewsPrior
from lis_grasp.task.recorded_facts import read_facts
from lis_grasp.task.task import Task
from lis_grasp.typing import FloatArray
from lis_grasp.views import Views, load_view
from lis_grasp.visualization.scene import Scene
from lis_grasp.visualization.view_layers import SeenSurface
from lis_grasp.world import Surroundings


def write_scene_of(directory: Path, report: Mapping[str, Any] | None = None) -> Path:
    """Write page and picture of the results in a folder; return the page's path; see `scene_of`."""
    path, scene = directory / PAGE, scene_of(directory, report)
    scene.save(path)
    write_bytes(directory / PICTURE, scene.png())
    return path


def scene_of(directory: Path, report: Mapping[str, Any] | None = None) -> Scene:
    """Return the scene of the results in a folder, also of an unfinished exploration.

    Its texts come from `report`; None for the report in the folder, if there is one.

    Raises `InvalidFileError` if the folder has neither contacts nor a surface nor grasps nor a
    touch log.
    """
    header, probes = _recorded(directory / LOG)
    unfinished = _unfinished(directory, header, probes)
    run = unfinished or Run.load(directory)
    facts, contacts = run.facts, run.contacts
    hand = Hand.load(facts.get("hand", "allegro"))
    content: dict[str, Any] = {"support_height": facts.get("support_height")}
    told = nullcontext() if report else reading(directory / "report.json", "a report of a run")
    report = report or run.report
    if report is not None:
        with told:
            content |= {"headline": headline(report), "summary": run_lines(report)}
    content |= {"title": f"lis_grasp: {directory.name}", "hand": hand, "motion": run.motion}
    with suppress(InvalidFileError):  # the mesh was moved: the scene lacks the truth
        if run.truth is not None:
            content |= {"truth": run.truth.mesh, "title": f"lis_grasp: {run.truth.name}"}
    with suppress(LisGraspError):  # the page is complete without them
        content["surroundings"] = _beside({**facts, **_place_of(report)}, probes)
    if facts.get("arm") is not None and "X_EA" in facts:
        height = facts.get("support_height")
        table = None if height is None else Table(float(height))
        X_EA = np.asarray(facts["X_EA"])
        if unfinished:  # the frame of the contacts has moved since
            X_EA = inverse_pose(_frame(probes)) @ X_EA
        content["station"] = Station.make(Arm.load(facts["arm"]), hand, X_EA, table=table)
    if contacts is not None:
        content["contacts"] = contacts
        file = directory / "contacts.ply"
        made = read_facts(file) if file.exists() else facts
        if (directory / LOG).exists() and made.get("hand") == facts.get("hand"):
            content["touches"] = _touches(probes, contacts, made, hand)
            content |= _search(probes, made)
    if contacts is not None and facts.get("seen"):
        with suppress(LisGraspError):  # the page is complete without it
            content["seen"] = _seen(directory, facts, contacts)
    rows = [*(facts.get("turned") or ()), *(facts.get("left_out") or ())]
    content["bad_contacts"] = [] if contacts is None else [i for i in rows if i < len(contacts)]
    if "summary" not in content:
        content["summary"] = [f"warning: {line}" for line in facts.get("warnings") or ()]
    known = 0 if contacts is None else len(contacts)
    if run.mesh is not None:
        content["estimate"] = run.mesh
        growth = load_growth(directory, read_facts(directory / "surface.ply"))
        content["growth"] = [(count, mesh) for count, mesh in growth if count < known]
    elif run.grasps is None and header:
        growth = load_growth(directory, facts)
        content["growth"] = [(count, mesh) for count, mesh in growth if count <= known]
    if run.grasps is not None:
        content["grasps"] = run.grasps.grasps
    return Scene(**content)


def _seen(directory: Path, facts: Mapping[str, Any], contacts: Contacts) -> SeenSurface:
    """Return what the cameras of a run saw of its object, given its contacts."""
    views = tuple(map(load_view, view_paths(directory, facts["seen"])))
    height = float(facts.get("support_height") or 0.0)
    known = ViewsPrior(Views(views, height)).given(contacts)
    return SeenSurface(views[0], known.seen, known.guesses)


def _beside(facts: Mapping[str, Any], probes: tuple[LoggedProbe, ...] | None) -> Surroundings:
    """Return the bodies beside the object, where touches left them, in the frame of the contacts.

    The robot's error about their places is left out: the page shows the truth.
    """
    height = float(facts.get("support_height") or 0.0)
    task = Task.from_facts({}, facts)
    is_corner = task.decide.place == "corner"
    in_W = corner_walls(height) if is_corner else find_surroundings(task, height)
    if not probes:
        return in_W.in_frame(require_pose("X_WE", facts.get("X_WE", np.eye(4))))
    pushed = [probe.disturbance.poses for probe in probes if probe.disturbance is not None]
    return in_W.placed(pushed[-1] if pushed else {}).in_frame(_frame(probes))


def _place_of(report: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the kind of place in a report, which no header has; nothing without one."""
    config = {} if report is None else report.get("config", {})
    return {"place": config["place"]} if config.get("place") else {}


def _frame(probes: tuple[LoggedProbe, ...] | None) -> FloatArray:
    """Return the pose (4, 4) of the frame of the contacts after the probes, in W."""
    believed = probes[-1].observation.belief if probes else None
    return np.eye(4) if believed is None else believed.X_WE


def _unfinished(
    folder: Path, header: Mapping[str, Any], probes: tuple[LoggedProbe, ...] | None
) -> Run | None:
    """Return the results of an exploration that has only its log; None if there are more files."""
    if not header or any((folder / name).exists() for name in SOURCES):
        return None
    contacts = Exploration.replay([probe.observation for probe in probes or ()]).contacts
    return Run(folder, header, contacts, None, None, None, None)


def _recorded(log: Path) -> tuple[Mapping[str, Any], tuple[LoggedProbe, ...] | None]:
    """Return a log's header and probes; {} and None without a sound log, which a page can lack."""
    try:
        return read_touches(log)
    except LisGraspError:
        return {}, None


def _search(probes: tuple[LoggedProbe, ...] | None, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the region, the recorded search in it and the object's motion, where recorded."""
    moved = probes or ()
    if facts.get("region") is None:
        return {"moved": moved}
    outcomes = [probe.observation.outcome for probe in moved]
    touched = (k for k, outcome in enumerate(outcomes) if len(outcome.contacts))
    search = outcomes[: next(touched, len(outcomes)) + 1]  # up to the first contact
    return {"moved": moved, "region": Region(facts["region"]), "search": search}


def _touches(
    probes: tuple[LoggedProbe, ...] | None,
    contacts: Contacts,
    facts: Mapping[str, Any],
    hand: Hand,
) -> list[ProbeOutcome | None]:
    """Return the recorded touch of each contact; none at all if the log has other contacts."""
    if probes is None:
        return []
    observations = [probe.observation for probe in probes]
    replayed = Exploration.replay(observations, touches=facts.get("touches"))
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
