"""`lis-grasp next`: choice of the next touch, given contacts so far."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

from scipy.spatial.transform import Rotation

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, complain, next_step, say
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Exploration, Observation, TouchLog
from lis_grasp.io.atomic_writing import sole_writer, write_json
from lis_grasp.results.folder import LOG, read_touches
from lis_grasp.shapes import STABLE
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.contact_sources import (
    ContactSource,
    load_source,
    prior_contacts,
    read_source,
)
from lis_grasp.stages.looking import load_views
from lis_grasp.stages.next_touch import NextTouch, ObjectPlace, next_touch
from lis_grasp.surfaces import judge_contacts
from lis_grasp.surfaces.contact_checks import doubt_of_side
from lis_grasp.task.task import Task
from lis_grasp.typing import FloatArray
from lis_grasp.views import Views

_READING = ("units", "normals", "fingertip_radius", "viewpoint")  # what a file does not say
_NOISE = ("position_noise", "normal_noise")
_Before: TypeAlias = tuple[Contacts, tuple[Observation, ...], dict[str, Any]]
_OPTIONS = ("hand", "estimator", "policy", "slide", *_NOISE, "world", "at", "seed", "keep_all")
_SEEING = ("views", "hand_eye")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.description = (
        "Choose the next touch: the motion of a fingertip and the pose of the hand, in"
        " the frame of the contacts."
    )
    parser.add_argument(
        "contacts",
        type=Path,
        nargs="?",
        metavar="CONTACTS",
        help="contacts as of `estimate`, or a touches.jsonl, whose misses count too; none before"
        " the first touch",
    )
    parser.add_argument(
        "--center",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="centre of the object [m] (default: that of the contacts; without contacts, half the"
        " size above the table at x = y = 0)",
    )
    parser.add_argument(
        "--size",
        type=float,
        metavar="METRES",
        help="largest extent of the object (default: 1.2 extents of the contacts)",
    )
    opt.add_support_option(
        parser,
        "height of the table that the hand avoids, or none for an object that is held in the air"
        " (default: as recorded, else that of the lowest contact)",
    )
    parser.add_argument(
        "--region",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="lengths [m] of the box on the table z = 0 that contains the object, centred at"
        " x = y = 0; replaces --center, --size and --support (default: as recorded, without these)",
    )
    opt.add_reading(parser)
    opt.add_options(parser, *_OPTIONS, *_SEEING, recorded=True)
    parser.add_argument(
        "--output",
        type=Path,
        metavar="PATH",
        help="a .json file, or the folder for next.json (default: the folder of CONTACTS)",
    )
    serving = parser.add_argument_group(
        "service", "answer requests, a JSON object a line: next, estimate, grasp, stop"
    )
    serving.add_argument("--serve", action="store_true", help="on standard input and output")
    serving.add_argument("--port", type=int, metavar="N", help="on a port of 127.0.0.1; 0 for any")
    serving.add_argument("--socket", type=Path, metavar="PATH", help="on a Unix socket")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Choose the next touch, print it, and write it; or answer requests for touches."""
    serves = options.serve or options.port is not None or options.socket is not None
    before, observations, recorded = _read(options, serves=serves)
    place = _place(options, recorded)
    # A task's size is that of a built-in shape, and its region needs a true pose.
    task = Task.from_facts({**vars(options), "size": None, "region": None}, recorded)
    task = task.having(arm=None, base=None)  # the robot carries the hand as it can
    before = _credible(before, options, keep_all=task.decide.keep_all)
    if serves:
        _serve(options, place, task)
        return
    contacts = before.append(Exploration.replay(observations).contacts)
    agent = _agent(task, place, contacts)
    known = agent.measured(contacts)
    agent = agent.placed(place.space(known))
    hand = agent.hand
    with Stage(f"Choosing touch {len(contacts) + 1} of {hand.name}") as stage:
        touch = next_touch(agent, before, observations)
        stage.result = f"policy {task.decide.policy}"
    for doubt in filter(None, (place.doubt(known), doubt_of_side(contacts))):
        say(f"warning: {doubt}")
    for line in _lines(touch):
        say(line)
    path = options.output or (options.contacts or Path()).parent
    if path.suffix.lower() != ".json":
        path /= "next.json"
    write_json(path, touch.facts(hand))
    say(f"wrote {path}")


def _agent(task: Task, place: ObjectPlace, contacts: Contacts) -> Agent:
    """Return the robot, which may have views of the object; it does not know its place."""
    agent, paths = Agent.of(task, 0.0), task.known.views
    if not paths:
        return agent
    height = place.table(contacts)
    if height is None:
        raise InvalidOptionError("views are of an object on a table", option="support")
    region = place.region if place.region is None else tuple(place.region)
    task = replace(
        task, known=replace(task.known, region=region), world=replace(task.world, pose=STABLE)
    )
    return replace(agent, views=Views(tuple(load_views(paths, task, height)), height))


def _credible(contacts: Contacts, options: argparse.Namespace, *, keep_all: bool) -> Contacts:
    """Return contacts without those that the others contradict, which it reports."""
    if keep_all or not len(contacts):
        return contacts
    verdicts = judge_contacts(contacts, **opt.given(options, *_NOISE))
    if not verdicts.bad.any():
        return contacts
    credible = verdicts.credible  # raises if too many are bad: nothing was turned then
    say(f"warning: {verdicts.sentence()}")
    return credible


def _place(options: argparse.Namespace, recorded: dict[str, Any]) -> ObjectPlace:
    """Return the object's place and the table from the options, else as recorded."""
    given = (options.center, options.size, options.support)
    region = options.region or (recorded.get("region") if given == (None, None, None) else None)
    support = recorded.get("support_height") if options.support is None else options.support
    held = support == "none"
    return ObjectPlace(options.center, options.size, None if held else support, held, region)


def _read(options: argparse.Namespace, *, serves: bool) -> _Before:
    """Return the contacts of a file, or a log's cloud and observations; and the facts."""
    path, is_log = options.contacts, _is_log(options.contacts)
    for name in _READING if is_log or serves else ():
        if getattr(options, name) is not None:
            raise InvalidOptionError(
                f"`{name}` is for points that no service answers on: write contacts.ply by"
                f" lis-grasp estimate with `{name}`, and name it as CONTACTS",
                option=name,
            )
    if path is None or is_log:
        return (Contacts.empty(), (), {}) if path is None else _read_log(path)
    contacts, recorded = read_source(opt.sources(options, [path])[0])
    return contacts, (), recorded


def _read_log(path: Path) -> _Before:
    recorded, probes = read_touches(path)
    observations = tuple(probe.observation for probe in probes)
    return _cloud(recorded.get("cloud")), observations, recorded


def _is_log(path: Path | None) -> bool:
    return path is not None and path.suffix.lower() == ".jsonl"


def _cloud(path: Path | str | None) -> Contacts:
    """Return the contacts that are known before the first touch, as an exploration reads them."""
    return Contacts.empty() if path is None else prior_contacts(load_source(ContactSource(path)))


def _serve(options: argparse.Namespace, place: ObjectPlace, task: Task) -> None:
    """Answer requests until one asks to stop, or the standard input ends."""
    from lis_grasp.io.request_lines import answer_lines, serve_socket
    from lis_grasp.service.touch_service import TouchService

    if options.output is not None and options.output.suffix.lower() == ".json":
        raise InvalidOptionError.out_of_range("--output", str(options.output), "a folder")
    source = options.contacts
    agent = _agent(task, place, Contacts.empty())
    folder = options.output or (source or Path()).parent
    resumed = _is_log(source)
    path = source if resumed else folder / LOG
    if path.exists() and not resumed:
        message = f"{path} is of other touches: name it as CONTACTS, or another folder"
        raise InvalidOptionError(f"{message} with --output", option="--output", value=str(folder))
    if source is not None and source.resolve() == (folder / "contacts.ply").resolve():
        message = f"{source} would be replaced: name another folder with --output"
        raise InvalidOptionError(message, option="--output", value=str(folder))
    options_of_task = task.facts()
    names = [n for n in _OPTIONS if n != "keep_all" or task.decide.keep_all]
    names += _SEEING if task.known.views else ()
    facts = {n: options_of_task[n] for n in names}
    if place.region is not None:
        facts |= {"region": list(place.region), "pose": STABLE}
    if place.support is not None:
        facts["support_height"] = place.support
    if not resumed and source is not None:
        facts["cloud"] = str(source)
    log = TouchLog(path, facts)
    with sole_writer(folder):
        before, observations, _ = _read_log(path) if resumed else (_cloud(source), (), {})
        service = TouchService(agent, place, folder, log, before, observations)
        if options.port is None and options.socket is None:
            with _own_output() as answers:
                complain("ready: requests on standard input, one JSON object a line")
                answer_lines(service.answer, sys.stdin.buffer, answers)
        else:
            address = options.socket if options.port is None else options.port
            serve_socket(service.answer, address, lambda name: say(f"ready: {name}"))
    if path.exists():
        complain(next_step("the same command with {} as CONTACTS goes on", path))


@contextmanager
def _own_output() -> Iterator[BinaryIO]:
    """Open the standard output for answers alone; other prints go to the error stream."""
    sys.stdout.flush()
    copy = os.dup(1)
    os.dup2(2, 1)
    try:
        with os.fdopen(copy, "wb", closefd=False) as answers:
            yield answers
    finally:
        os.dup2(copy, 1)
        os.close(copy)


def _lines(touch: NextTouch) -> tuple[str, ...]:
    pose, probe = touch.approach.X_OH, touch.probe
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return (
        f"touch     near {_millimetres(probe.target)} along"
        f" ({', '.join(f'{x:.3f}' for x in probe.direction)})",
        f"finger    {touch.approach.posture.finger}: from {_millimetres(probe.start)} at most to"
        f" {_millimetres(probe.end)}",
        f"hand      palm at {_millimetres(pose[:3, 3])}, quaternion xyzw"
        f" ({x:.4f}, {y:.4f}, {z:.4f}, {w:.4f}), after a straight approach of"
        f" {1e3 * touch.approach.distance:.0f} mm",
        f"why       {touch.why()}",
    )


def _millimetres(point: FloatArray) -> str:
    return f"({', '.join(f'{1e3 * x:.1f}' for x in point)}) mm"
