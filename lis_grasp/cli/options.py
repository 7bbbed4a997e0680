"""Command line options that mean the same for every verb."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from lis_grasp.cli.progress import next_step, say, with_flags
from lis_grasp.exceptions import InvalidOptionError, shown
from lis_grasp.io.option import Option, kind_of, options_of
from lis_grasp.shapes import FORMATS, UNITS
from lis_grasp.stages.contact_sources import ContactSource
from lis_grasp.surfaces.contact_checks import NormalSide
from lis_grasp.task.option_groups import GROUPS
from lis_grasp.task.scene_file import SCHEMA_NAME, is_scene_file, load_scene, write_scene
from lis_grasp.task.task import (
    IDEAL_CAMERA,
    IDEAL_SENSOR,
    LIFTING,
    OLD_NAMES,
    Task,
    option_default,
    option_items,
    option_kind,
    task_options,
)

_OPTIONS = task_options()

_OBJECT, _CONDITIONS = ("size", "units", "up"), ("pose", "region", "free", "load")

TOUCH = tuple(
    name
    for name in _OPTIONS
    if name not in ("object", *_OBJECT, *_CONDITIONS, "free_space", *LIFTING)
)
"""Options of an exploration, beside its object."""


def add_options(
    parser: argparse._ActionsContainer,
    *names: str,
    show_default: bool = True,
    recorded: bool = False,
) -> None:
    """Add options of a `Task` by their names; omitted ones parse as None.

    With `recorded`, the verb reads a file with recorded facts.
    """
    used = {title: [n for n in names if _OPTIONS[n].group == title] for title in GROUPS}
    grouped = sum(map(bool, used.values())) > 1
    for name in (n for n in names if not (grouped and _OPTIONS[n].group)):
        _add(parser, name, show_default=show_default, recorded=recorded)
    for title, members in used.items() if grouped else ():
        group = parser.add_argument_group(title) if members else parser
        for name in members:
            _add(group, name, show_default=show_default, recorded=recorded)


def _add(
    group: argparse._ActionsContainer, name: str, *, show_default: bool, recorded: bool
) -> None:
    default = _default(name, recorded) if show_default else ""
    text = _text(_OPTIONS[name]) + (f" (default: {default})" if default else "")
    flag = f"--{name.replace('_', '-')}"
    kind = _kind(_OPTIONS[name], option_kind(name), option_default(name))
    if option_kind(name) is tuple and option_items(name) is str:  # given one by one
        flag, text = flag.removesuffix("s"), f"{text}; repeatable"
        kind = {"action": "append", "dest": name, "metavar": _OPTIONS[name].metavar}
    old = [f"--{before}" for before, now in OLD_NAMES.items() if now == name]
    group.add_argument(flag, *old, default=None, help=text, **kind)


def add_declared(
    group: argparse._ActionsContainer, config: type, name: str, *, flag: str = "", also: str = ""
) -> None:
    """Add the option of a field of any record; an omitted one parses as None.

    `flag` is its name if it differs from the field's, and `also` ends its help.
    """
    option, default = options_of(config)[name], getattr(config(), name)
    shown = f"{default:g}" if isinstance(default, float) else str(default or "")
    words = option.words or shown
    text = with_flags(option.help) + (f" (default: {words})" if words else "") + also
    kind = _kind(option, kind_of(config, name), default)
    group.add_argument(f"--{flag or name.replace('_', '-')}", default=None, help=text, **kind)


def _default(name: str, recorded: bool) -> str:
    """Return the default of an option in words; empty if there is none."""
    option, value = _OPTIONS[name], option_default(name)
    words = option.words or ("" if value is None or value is False else str(value))
    if not recorded:
        return words
    words = option.words_else or words
    return f"as recorded, else {words}" if words else ""


def _text(option: Option) -> str:
    """Return the help of an option, with the names that it may have and their meanings."""
    text = with_flags(option.help)
    if option.registry is None:
        return text
    own = [f"{name} ({meaning})" for name, meaning in option.meanings.items()]
    added = option.registry.names[len(option.registry.builtin) :]
    return f"{text}: {', '.join([*own, *added, 'or my.module:Class'])}"


def _kind(option: Option, kind: type, default: Any) -> dict[str, Any]:
    """Return the arguments of the parser that say which values an option has."""
    if option.choices:
        return {"choices": option.choices}
    if kind is bool:
        is_on = default and option is not _OPTIONS["free"]  # --clamped switches it off
        return {"action": argparse.BooleanOptionalAction if is_on else "store_true"}
    if isinstance(option.metavar, tuple):
        return {"type": float, "nargs": len(option.metavar), "metavar": option.metavar}
    if kind is tuple:
        return {"nargs": "+", "metavar": option.metavar}
    return {"metavar": option.metavar} | ({} if kind is str else {"type": kind})


def add_xacro_args(group: argparse._ActionsContainer) -> None:
    """Add the arguments of a xacro file."""
    group.add_argument(
        "--xacro-args",
        nargs="+",
        default=(),
        metavar="NAME:=VALUE",
        help="arguments of FILE, if it is a xacro file",
    )


def xacro_args(options: argparse.Namespace) -> dict[str, str]:
    """Return the given arguments of a xacro file by name."""
    parts = [text.partition(":=") for text in options.xacro_args]
    for text, (name, mark, _) in zip(options.xacro_args, parts, strict=True):
        if not name or not mark:
            raise InvalidOptionError.out_of_range("xacro-args", text, "NAME:=VALUE")
    return {name: value for name, _, value in parts}


def given(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Return the parsed values of options by name; None for those that are not given."""
    return {name: getattr(options, name) for name in names}


def add_conditions(parser: argparse.ArgumentParser) -> None:
    """Add the options for what is known of the object, its pose, and the sensor."""
    conditions = parser.add_argument_group("conditions")
    given = conditions.add_mutually_exclusive_group()
    given.add_argument(
        "--unknown",
        action="store_true",
        default=None,
        help="nothing is known but the region, not even mass and friction: the object is free"
        " on a table in a stable pose (fixed with --prober kinematic), and the sensor is realistic:"
        " 0.5 mm, 3 deg, 0.05 N, taxels 2 mm apart (default, unless there is a --cloud)",
    )
    given.add_argument(
        "--known",
        dest="unknown",
        action="store_false",
        default=None,
        help="place, size, mass and friction of the object are known, it is fixed in the air at"
        " the pose of its mesh, and the sensor is ideal; the options below change each of these",
    )
    add_options(conditions, *_CONDITIONS)
    conditions.add_argument(
        "--clamped", action="store_true", help="the object is fixed, as with --prober kinematic"
    )
    conditions.add_argument("--ideal", action="store_true", help="the sensor has no noise")


def configure_touch(options: argparse.Namespace) -> Task:
    """Return the task of a run or an exploration, with the conditions of its options.

    Raises `InvalidOptionError` if two options contradict each other, or a value is out of range.
    """
    if options.clamped and options.free:
        raise InvalidOptionError("give either --clamped or --free; both are given", option="free")
    if options.force_threshold is not None and options.prober == "kinematic":
        raise InvalidOptionError(
            "--force-threshold needs the dynamic prober: touches by geometry have no force",
            option="--force-threshold",
        )
    named = {name: getattr(options, name, None) for name in _OPTIONS}
    given = {name: value for name, value in named.items() if value is not None}
    if options.clamped:
        given["free"] = False
    if options.ideal:
        given = {**IDEAL_SENSOR, **IDEAL_CAMERA, **given}
    known = None if options.unknown is None else not options.unknown
    if is_scene_file(options.object):
        del given["object"]
        return load_scene(options.object).having(known=known, **given)
    return Task.of(known=known, **given)


def written_scene(options: argparse.Namespace) -> bool:
    """Write the requested scene file; return whether one is requested."""
    path: Path | None = options.write_scene
    if path is None:
        return False
    if not is_scene_file(path):
        raise InvalidOptionError.out_of_range("--write-scene", str(path), "a name with .yaml")
    write_scene(configure_touch(options), path)
    say(f"wrote {path}, and {SCHEMA_NAME} beside it")
    say(next_step("lis-grasp run {}", path))
    return True


def add_object_argument(parser: argparse.ArgumentParser, *, required_name: bool = True) -> None:
    """Add the object to touch or lift, with its size and units."""
    text = _OPTIONS["object"].help
    if required_name:
        parser.add_argument("object", metavar="OBJECT", help=f"{text}, or a scene file (YAML)")
    else:
        parser.add_argument("--object", metavar="OBJECT", help=f"{text} (default: as recorded)")
    add_options(parser, *_OBJECT)


def add_support_option(parser: argparse.ArgumentParser, meaning: str) -> None:
    """Add the height of the table under the object."""
    parser.add_argument("--support", type=_height, metavar="METRES", help=meaning)


def _height(text: str) -> float | str:
    try:
        return text if text == "none" else float(text)
    except ValueError:
        message = f"must be a number, or none; it is {shown(text)}"
        raise argparse.ArgumentTypeError(message) from None


def add_output(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the folder of results."""
    parser.add_argument(
        "--output", type=_folder, metavar="DIR", help=f"folder of results (default: {default})"
    )


def _folder(text: str) -> Path:
    path = Path(text)
    if path.suffix.lower() in FORMATS and not path.is_dir():
        message = f"must be a folder, which gets several files; {shown(text)} is the name of a file"
        raise argparse.ArgumentTypeError(message)
    return path


def add_exploration(parser: argparse.ArgumentParser, *later: str) -> None:
    """Add the object, the conditions and the options of an exploration, and those of `later`."""
    add_object_argument(parser)
    add_conditions(parser)
    add_options(parser, *TOUCH, *later)
    parser.add_argument(
        "--write-scene",
        type=Path,
        metavar="FILE",
        help="write these options as a scene file, which OBJECT may be, and its schema; no run",
    )
    parser.add_argument(
        "--fresh",
        action="store_true",
        help="explore from the beginning (default: an interrupted exploration is resumed, and a"
        " finished one is used again, if nothing that it depends on has changed)",
    )
    parser.add_argument(
        "--watch",
        action="store_true",
        help="show touches, estimates, grasps and lift in the browser as they come, until Ctrl-C",
    )
    add_output(parser, "results/<run>")


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add the options for what files of contacts do not say."""
    parser.add_argument(
        "--fingertip-radius",
        type=float,
        action="append",
        metavar="METRES",
        help="the points are centres of a spherical fingertip of this radius (default: 0, they are"
        " on the surface); for several files repeat it, in their order",
    )
    parser.add_argument(
        "--units",
        choices=list(UNITS),
        help="length unit of CONTACTS (default: what the file states, else m)",
    )
    parser.add_argument(
        "--normals",
        choices=get_args(NormalSide),
        help="side that the normals of CONTACTS point to; unsigned: unknown for each, the likeliest"
        " sides are chosen (default: outward, which is checked)",
    )
    parser.add_argument(
        "--viewpoint",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="place of the sensor [m] that the normals of CONTACTS point to",
    )


def sources(options: argparse.Namespace, paths: Sequence[Path]) -> list[ContactSource]:
    """Return files of contacts with the options of `add_reading` and the noise."""
    radii = options.fingertip_radius or [0.0] * len(paths)
    if len(radii) != len(paths):
        raise InvalidOptionError.out_of_range(
            "fingertip-radius", radii, f"given once for each of the {len(paths)} files"
        )
    noise = options.position_noise, options.normal_noise
    return [
        ContactSource(path, options.units, options.normals, *noise, radius, options.viewpoint)
        for path, radius in zip(paths, radii, strict=True)
    ]


def add_mesh(parser: argparse.ArgumentParser) -> None:
    """Add the mesh, estimated or any."""
    text = "surface.ply of `estimate`, or any mesh file"
    parser.add_argument("mesh", type=Path, metavar="MESH", help=text)


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add the number of processes."""
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="processes (default: the machine's cores)"
    )
