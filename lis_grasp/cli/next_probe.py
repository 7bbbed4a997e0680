"""`lis-grasp next`: choice of the next touch, given contacts so far."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import shown
from lis_grasp.exploration import Exploration, ProbeOutcome, load_outcomes
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.io.json_lines import read_lines
from lis_grasp.pipeline.contact_sources import ContactSource, load_source, prior_contacts
from lis_grasp.pipeline.known import Known
from lis_grasp.pipeline.next_touch import NextTouch, ObjectPlace, next_touch
from lis_grasp.pipeline.recorded_facts import read_facts
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.robots.hand import Hand
from lis_grasp.surfaces import load_contacts
from lis_grasp.typing import FloatArray


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
        help="centre of the object [m] (default: that of the contacts)",
    )
    parser.add_argument(
        "--size",
        type=float,
        metavar="METRES",
        help="largest extent of the object (default: 1.2 extents of the contacts)",
    )
    parser.add_argument(
        "--support",
        type=_height,
        metavar="METRES",
        help="height of the table that the hand avoids, or none for an object that is held in the"
        " air (default: as recorded, else that of the lowest contact)",
    )
    parser.add_argument(
        "--region",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="lengths [m] of the box on the table z = 0 that contains the object, centred at"
        " x = y = 0; replaces --center, --size and --support (default: as recorded, without these)",
    )
    names = ("hand", "estimator", "policy", "position_noise", "normal_noise", "seed")
    opt.add_options(parser, *names, recorded=True)
    parser.add_argument(
        "--output",
        type=Path,
        metavar="PATH",
        help="a .json file, or the folder for next.json (default: the folder of CONTACTS)",
    )
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Choose the next touch, print it, and write it; or answer requests for touches."""
    before, outcomes, recorded = _read(options.contacts, options.position_noise)
    place = _place(options, recorded)
    config = _configuration(options, recorded)
    contacts = before.append(Exploration.replay(outcomes).contacts)
    space = place.space(contacts)
    hand = Hand.load(config.hand)
    config = replace(config, arm=None, base=None)  # the robot carries the hand as it can
    known = Known.for_hand(config, hand, space, 0.0)
    with Stage(f"Choosing touch {len(contacts) + 1} of {hand.name}") as stage:
        touch = next_touch(known, before, outcomes)
        stage.result = f"policy {config.policy}"
    if place.doubt(contacts):
        say(f"warning: {place.doubt(contacts)}")
    for line in _lines(touch):
        say(line)
    path = options.output or (options.contacts or Path()).parent
    if path.suffix.lower() != ".json":
        path /= "next.json"
    write_json(path, touch.facts(hand))
    say(f"wrote {path}")


def _height(text: str) -> float | str:
    try:
        return text if text == "none" else float(text)
    except ValueError:
        message = f"must be a number, or none; it is {shown(text)}"
        raise argparse.ArgumentTypeError(message) from None


def _place(options: argparse.Namespace, recorded: dict[str, Any]) -> ObjectPlace:
    """Return what the options say of the object's place and the table, else what is recorded."""
    given = (options.center, options.size, options.support)
    region = options.region or (recorded.get("region") if given == (None, None, None) else None)
    support = recorded.get("support_height") if options.support is None else options.support
    held = support == "none"
    return ObjectPlace(options.center, options.size, None if held else support, held, region)


def _configuration(options: argparse.Namespace, recorded: dict[str, Any]) -> RunConfig:
    # In a configuration, size is that of a built-in shape, and a region needs a true pose.
    return RunConfig.from_facts({**vars(options), "size": None, "region": None}, recorded)


def _read(
    path: Path | None, position_noise: float | None
) -> tuple[Contacts, tuple[ProbeOutcome, ...], dict[str, Any]]:
    """Return the contacts of a file, or of a log its cloud and outcomes; and the recorded facts."""
    if path is None:
        return Contacts.empty(), (), {}
    if path.suffix.lower() == ".jsonl":
        outcomes, recorded = load_outcomes(path), read_lines(path)[0]
        cloud = recorded.get("cloud")
        before = prior_contacts(load_source(ContactSource(cloud))) if cloud else Contacts.empty()
        return before, outcomes, recorded
    recorded = read_facts(path)
    return load_contacts(path, position_noise=position_noise), (), recorded


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
