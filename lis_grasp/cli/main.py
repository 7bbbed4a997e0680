"""The `lis-grasp` command: its verbs and exit codes."""

from __future__ import annotations

import argparse
import logging
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from threadpoolctl import threadpool_limits

from lis_grasp.cli.examples import EXAMPLES, format_examples
from lis_grasp.cli.importing import import_uncollected, interrupts_after_imports
from lis_grasp.cli.progress import complain, open_streams, say
from lis_grasp.exceptions import (
    UNIT_NAMES,
    InvalidInputError,
    InvalidOptionError,
    LisGraspError,
    LisGraspWarning,
    nearest_of,
    shown,
)
from lis_grasp.guesses import advice, advice_on_option
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


class _Parser(argparse.ArgumentParser):
    """Parser whose errors are one sentence, without the list of all options."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        # An option's beginning may be another program's option: --position is no noise.
        super().__init__(*arguments, **{"allow_abbrev": False, **options})
        self.register("type", int, _converter(int, "a whole number"))
        self.register("type", float, _converter(float, "a number"))

    def error(self, message: str) -> NoReturn:
        message = re.sub(r"^argument (\S+): must", r"\1 must", message)
        message = re.sub(
            r"^argument (\S+): ignored explicit argument (.*)",
            r"\1 takes no value; it has \2",
            message,
        )
        flag, number, rest = message.partition(" must be a number; ")
        metavar = next((str(a.metavar) for a in self._actions if flag in a.option_strings), "")
        if number and metavar in UNIT_NAMES:
            message = f"{flag} must be a number in {UNIT_NAMES[metavar]}; {rest}"
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; refuse unknown ones here, where the options of a verb are known."""
        self._refuse_assignments(args or ())
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            options = re.findall(r"--[\w-]+", self.format_usage())
            flag = next((word for word in unknown if word.startswith("-")), unknown[0])
            suggestion = (
                self._positional(flag)
                or self._superfluous(flag, args or ())
                or advice_on_option(flag.partition("=")[0], options)
            )
            self.error(f"unrecognized arguments: {' '.join(unknown)}{suggestion}")
        return known, unknown

    def _refuse_assignments(self, words: Sequence[str]) -> None:
        """Refuse ``name=value``, as other programs have it, where an option has this name."""
        for before, word in zip(("", *words), words, strict=False):
            name, mark, value = word.lstrip("+").partition("=")
            flag = f"--{name.replace('_', '-')}"
            is_own = flag in self._option_string_actions and not before.startswith("-")
            if mark and is_own and not Path(word).exists():
                self.error(f"an option has two hyphens: write {flag} {value} for {word}")

    def _superfluous(self, word: str, words: Sequence[str]) -> str:
        """Return the end of a message on a value that an option does not take, or on --no-OPTION.

        An option that is switched off by default has no opposite.
        """
        opposite = self._option_string_actions.get(f"--{word.removeprefix('--no-')}")
        if word.startswith("--no-") and opposite is not None and opposite.nargs == 0:
            return f": {opposite.option_strings[0]} is off unless it is given"
        if word.startswith("-") or word not in words:
            return ""
        before = [w for w in words[: words.index(word)] if w.startswith("-")]
        action = self._option_string_actions.get(before[-1]) if before else None
        if action is None or action.nargs not in (0, None):
            return ""
        takes = "no value" if action.nargs == 0 else "one value"
        return f": {before[-1]} takes {takes}"

    def _positional(self, flag: str) -> str:
        """Return the end of a message on a name without its flag, or a flag of a name without."""
        from lis_grasp.robots.shipped_models import READY_ARMS, READY_HANDS

        for option, names in (("--hand", READY_HANDS), ("--arm", READY_ARMS)):
            if flag in names and option in self.format_usage():
                return f": use {option} {flag}"
        own = [str(a.metavar) for a in self._actions if not a.option_strings and a.metavar]
        name = flag.partition("=")[0].lstrip("-").lower()
        if flag[:2] != "--" or "-" in name or not own:
            return ""
        asked = {"input": own[0], "depth": "image"}.get(name, name)
        found = [word for word in own if nearest_of(asked, [word])]
        return f": {found[0]} is given without a flag" if found else ""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse what is not one of an argument's choices."""
        if action.choices is not None and value not in action.choices:
            name = action.option_strings[0] if action.option_strings else str(action.metavar)
            raise argparse.ArgumentError(None, str(_not_one_of(name, value, action.choices)))


def _not_one_of(name: str, value: str, choices: Iterable[str]) -> InvalidOptionError:
    """Return the error of a value that is not one of some choices, with what to use instead."""
    answer = advice((f"{name.lower()}s",), value, ())
    if answer:
        return InvalidOptionError(f"there is no {name} '{value}'{answer}", option=name, value=value)
    return InvalidOptionError.not_one_of(name, value, choices)


def _converter(kind: type, required: str) -> Callable[[str], Any]:
    """Return the conversion of an argument to numbers of a kind, with a plain error."""

    def convert(text: str) -> Any:
        try:
            return kind(text)
        except ValueError:
            message = f"must be {required}; it is {shown(text)}"
            raise argparse.ArgumentTypeError(message) from None

    return convert


def build_parser(verb: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of the command line, with the arguments of one verb, or of every verb."""
    parser = _Parser(
        prog="lis-grasp",
        description="Learn an unknown object's shape by touch, and grasp it.",
        epilog="start with: lis-grasp run box --output results/demo (about twenty seconds)",
    )
    parser.add_argument("--version", action="version", version=f"lis-grasp {__version__}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)

    def add_verb(name: str, text: str, examples: Sequence[tuple[str, str]]) -> _Parser:
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
            raise _not_one_of("VERB", verb, names)
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
