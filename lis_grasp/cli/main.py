"""The `lis-grasp` command: its verbs and exit codes."""

from __future__ import annotations

import argparse
import logging
import re
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from lis_grasp.cli.examples import EXAMPLES, format_examples
from lis_grasp.cli.importing import import_uncollected, interrupts_after_imports
from lis_grasp.cli.parser import Parser, not_one_of
from lis_grasp.cli.progress import complain, open_streams, say
from lis_grasp.exceptions import (
    InvalidInputError,
    InvalidOptionError,
    LisGraspError,
    LisGraspWarning,
)
from lis_grasp.version import __version__

if TYPE_CHECKING:
    from lis_grasp.plugins import Registry

# Name, module in this folder, and help of each verb. A module is imported when its verb is used.
# Other packages add verbs: see `_verb_registry`.
_VERBS = (
    ("run", "run", "touch -> estimate -> mesh -> grasp -> lift and shake, one folder of results"),
    ("explore", "explore", "touch an object, write contacts.ply"),
    ("next", "next_probe", "choose the next touch, given contacts so far; write next.json"),
    (
        "contacts",
        "log_contacts",
        "find touches in a robot's log (ROS 1, ROS 2, MCAP, CSV), write contacts",
    ),
    ("see", "see", "find an object in a depth image, write contacts and what is unknown"),
    ("estimate", "estimate", "estimate a surface from contacts, write surface.ply"),
    ("grasp", "grasp", "plan grasps on a mesh, write grasps.json"),
    ("lift", "lift", "simulate the lift of the true object, write lifts.json"),
    ("motion", "arm_motion", "write joint trajectories of an arm for a grasp and its lift"),
    ("export", "export", "write an object as URDF, SDF and MJCF with mass, inertia, convex parts"),
    ("outline", "outline", "write an estimate's silhouette and a clearance as DXF and SVG"),
    ("view", "view", "show the scene of a folder of results in the browser"),
    ("hand", "hand_files", "write the first YAML of a hand, or draw a hand"),
    ("doctor", "doctor", "check this machine, or the files of a hand, and list fixes"),
)
_CORE_VERBS = tuple(name for name, _, _ in _VERBS)


def build_parser(verb: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of the command line, with the arguments of one verb, or of every verb."""
    parser = Parser(
        prog="lis-grasp",
        description="Learn an unknown object's shape by touch, and grasp it.",
        epilog="start with: lis-grasp run box --output results/demo (about twenty seconds)",
    )
    parser.add_argument("--version", action="version", version=f"lis-grasp {__version__}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)

    def add_verb(name: str, text: str, examples: Sequence[tuple[str, str]]) -> Parser:
        return verbs.add_parser(
            name,
            help=text,
            description=text,
            epilog=format_examples(name, examples),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    for name, module, text in _VERBS:
        verb_parser = add_verb(name, text, EXAMPLES[name])
        if verb in (None, name):
            load = partial(import_module, f"lis_grasp.cli.{module}")
            import_uncollected(load).add_arguments(verb_parser)
    if verb not in _CORE_VERBS:
        registry = _verb_registry()
        for name in (verb,) if verb else registry.names[len(_CORE_VERBS) :]:
            added = import_uncollected(partial(registry.find, name))
            verb_parser = add_verb(name, added.HELP, added.EXAMPLES)
            if verb in (None, name):
                added.add_arguments(verb_parser)
    return parser


def _verb_registry() -> Registry:
    """Return the names of all verbs, the core's first, then those that other packages register.

    The value of an entry point of the group ``lis_grasp.verbs`` is a module with a text `HELP`,
    `EXAMPLES` like those in `cli.examples`, and a function ``add_arguments(parser)``. This sets the
    parser's default ``execute``, a function of the parsed arguments that returns the exit code, or
    None for 0.
    """
    from lis_grasp.plugins import Registry

    return Registry("verb", dict.fromkeys(_CORE_VERBS))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    0 when done, 1 when it failed or found nothing (no grasp, no contact), 2 on misuse, 130 on
    Ctrl-C.
    """
    with interrupts_after_imports():
        return _run(arguments)


def _run(arguments: Sequence[str] | None) -> int:
    open_streams()
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    verb = next((word for word in arguments if not word.startswith("-")), "")
    try:
        if not arguments:
            say(build_parser("").format_help().rstrip())
            return 2
        if verb and verb not in _CORE_VERBS and verb not in (names := _verb_registry().names):
            if arguments[0].startswith("-") and (after := [w for w in arguments if w in names]):
                raise InvalidInputError(
                    f"options come after VERB: write lis-grasp {after[0]} before {arguments[0]}"
                )
            raise not_one_of("VERB", verb, names)
        options = build_parser(verb).parse_args(arguments)
        # Threads change the order of sums, and thus the last digits of results.
        with threadpool_limits(1), _notes_only(), ExitStack() as options.until_end:
            return int(options.execute(options) or 0)
    except LisGraspError as error:
        complain(f"lis-grasp: {_message(error, arguments)}")
        return 2 if isinstance(error, InvalidInputError) else 1
    except BrokenPipeError:
        return 128 + signal.SIGPIPE  # as a shell reports it
    except OSError as error:  # outside the package's readers and writers
        complain(f"lis-grasp: {error.filename or 'a file'}: {error.strerror or error}")
        return 1
    except MemoryError:
        complain("lis-grasp: memory ran out: use smaller files, or fewer processes (--jobs)")
        return 1
    except KeyboardInterrupt:
        complain(
            "lis-grasp: interrupted; the files already written are complete: the same command"
            " again continues a study or an exploration, and repeats other stages"
        )
        return 130


def _message(error: LisGraspError, arguments: Sequence[str]) -> str:
    """Return the message of an error, with the option that was given for its field."""
    if isinstance(error, InvalidOptionError):
        flag = f"--{error.option.replace('_', '-')}"
        if any(word.partition("=")[0] == flag for word in arguments):
            return re.sub(rf"^{error.option}\b", flag, str(error))
    return str(error)


@contextmanager
def _notes_only() -> Iterator[None]:
    """Print the package's warnings as notes, once each, and no warning or log of a library."""
    said = set()

    def show(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        if issubclass(category, LisGraspWarning) and str(message) not in said:
            said.add(str(message))
            complain(f"note: {message}")

    silent = logging.NullHandler()
    logging.getLogger().addHandler(silent)
    with warnings.catch_warnings():
        warnings.simplefilter("always", LisGraspWarning)
        warnings.showwarning = show
        try:
            yield
        finally:
            logging.getLogger().removeHandler(silent)


if __name__ == "__main__":
    sys.exit(main())
