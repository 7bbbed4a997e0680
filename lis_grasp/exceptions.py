"""Errors that the package raises on purpose: one sentence for people, attributes for programs.

An attribute that does not apply is empty or None.
"""

from __future__ import annotations

import difflib
import re
import reprlib
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

# Messages quote input, which may be a whole damaged file: the middle of a longer one is left out.
_LONGEST = 800
# Least similarity of the letters of a suggestion, of 1.
_SIMILAR = 0.7
_MOST_NAMED = 8  # in a message


UNIT_NAMES: Mapping[str, str] = {"METRES": "m", "KG": "kg", "S": "s"}
"""Units of an option's number, by the name of its value in the help."""


def counted(number: int, thing: str) -> str:
    """Return a number of things in words, with an s unless it is one."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


def named_rows(rows: Iterable[int]) -> str:
    """Return rows in words, counted from 1."""
    names = [str(row + 1) for row in rows]
    return f"row{'s' if len(names) > 1 else ''} {listed(names)}"


def listed(names: Sequence[str]) -> str:
    """Return the first eight names in words, and the number of the others."""
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"{', '.join(names[:_MOST_NAMED])}{more}"


def shown(value: object) -> str:
    """Return a short representation of a value for a message, however large or deep it is."""
    try:
        return reprlib.repr(value)
    except ValueError:  # an int of more digits than Python writes
        return f"a very long {type(value).__name__}"


# Words of other programs, and ours.
_OUR_WORDS = {
    **dict.fromkeys(("gripper", "hands", "effector", "suction"), "hand"),
    **dict.fromkeys(("arms", "robot", "robots"), "arm"),
    **dict.fromkeys(("objects", "shape", "shapes", "mesh"), "object"),
    **dict.fromkeys(("method", "model", "algorithm"), "estimator"),
    **dict.fromkeys(("table", "ground", "floor"), "support"),
    **dict.fromkeys(("plan", "plans"), "grasp"),
    **dict.fromkeys(("show", "plot", "display", "visualize"), "view"),
    **dict.fromkeys(("gui", "live"), "watch"),
    **dict.fromkeys(("samples", "probes"), "touches"),
    **dict.fromkeys(("simulate", "execute"), "lift"),
    **dict.fromkeys(("reconstruct", "fit"), "estimate"),
    **dict.fromkeys(("bench",), "benchmark"),
    **dict.fromkeys(("read",), "load"),
    **dict.fromkeys(("out", "folder", "dir"), "output"),
    **dict.fromkeys(("ball",), "sphere"),
    **dict.fromkeys(("block", "cube", "cuboid"), "box"),
    **dict.fromkeys(("donut", "ring"), "torus"),
}


def nearest_of(value: object, choices: Iterable[str]) -> str:
    """Return ": did you mean '...'?" with the most similar choice, or nothing.

    Words count before letters, those of other programs as ours: ``--seed`` for ``--random-seed``,
    ``--position-noise`` for ``--noise``, ``--hand`` for ``--gripper``.
    """
    names = {name.lstrip("-").lower(): name for name in sorted(choices)}
    given = str(value)[:_LONGEST].lstrip("-").lower()
    words = {_OUR_WORDS.get(word, word) for word in _words(given)}
    within = [name for name in names if {*_words(name)} <= words]
    around = [name for name in names if words <= {*_words(name)}]
    close = difflib.get_close_matches(given, names, n=1, cutoff=_SIMILAR)
    if within:
        close = [max(within, key=len)]
    elif not close and around:
        close = [min(around, key=len)]
    return f": did you mean '{names[close[0]]}'?" if close else ""


def _words(name: str) -> list[str]:
    return re.split(r"[^a-z0-9]+", name)


def nearest_or_all(value: object, choices: Iterable[str]) -> str:
    """Return the end of a message as in `nearest_of`, or else with all choices."""
    names = sorted(set(choices))
    return nearest_of(value, names) or all_of(names)


def all_of(choices: Iterable[str]) -> str:
    """Return the end of a message that names all choices."""
    return f": it has {', '.join(choices)}"


class LisGraspWarning(UserWarning):
    """What a reader left out of a file or made of it; the command line prints it as a note."""


class InexactContactWarning(LisGraspWarning):
    """A simulated contact that is not between the true shapes of two bodies.

    Attributes
    ----------
    link, body
        Names of the hand's link and of the body that it touches, with their model instances.
    method
        "points" for point pairs, "hull" for the convex hull of a mesh, "unknown" if it may be one.
    """

    def __init__(self, message: str, *, link: str = "", body: str = "", method: str = "") -> None:
        super().__init__(message)
        self.link, self.body, self.method = link, body, method


def note(message: str) -> None:
    """Warn of what was left out of a file or made of it, in one line, where the package is called.

    So Python shows it once for each call of the user's, however often the package says it.
    """
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("lis_grasp"):
        level, frame = level + 1, frame.f_back
    warnings.warn(" ".join(message.split("\n")), LisGraspWarning, stacklevel=level)


class LisGraspError(Exception):
    """Base of every error that the package raises on purpose; its message is one line."""

    def __init__(self, message: str) -> None:
        line = " ".join(message.split("\n")).strip()
        if len(line) > _LONGEST:
            line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
        super().__init__(line)


class InvalidInputError(LisGraspError):
    """Base of the errors that a change of the input or of an option avoids."""


class InvalidContactsError(InvalidInputError):
    """Contacts that are malformed, or from which no surface can be estimated.

    Attributes
    ----------
    field
        Name of the field of `Contacts` that is wrong.
    row
        Index of the first contact that is wrong.
    """

    def __init__(self, message: str, *, field: str = "", row: int | None = None) -> None:
        super().__init__(message)
        self.field, self.row = field, row


class InvalidViewError(InvalidInputError):
    """A depth image, or what belongs to it, that is malformed or does not show an object.

    Attributes
    ----------
    field
        Name of the field of `DepthView` that is wrong.
    """

    def __init__(self, message: str, *, field: str = "") -> None:
        super().__init__(message)
        self.field = field


class NothingSeenError(InvalidViewError):
    """A depth image in which no object was found above the table.

    Attributes
    ----------
    height
        Height above the table that an object needs to be found [m]; what is lower is too flat.
    """

    def __init__(self, message: str, *, height: float = 0.0) -> None:
        super().__init__(message, field="depth")
        self.height = height


class InvalidMeshError(InvalidInputError):
    """A mesh that cannot be used as an object and could not be repaired."""


class InvalidRobotError(InvalidInputError):
    """A description (YAML, URDF or SDF) that is incomplete or contradicts itself.

    Attributes
    ----------
    file
        Name of the file.
    key
        Dotted key in it, for example ``pads.thumb.radius``.
    """

    def __init__(self, message: str, *, file: str = "", key: str = "") -> None:
        super().__init__(message)
        self.file, self.key = file, key


class InvalidHandError(InvalidRobotError):
    """A hand's description that is incomplete or contradicts itself."""


class InvalidArmError(InvalidRobotError):
    """An arm's description that is incomplete or contradicts itself."""


class InvalidOptionError(InvalidInputError):
    """An option outside its permitted range or set.

    Attributes
    ----------
    option
        Its name; empty if the options contradict each other.
    value
        What was given.
    """

    def __init__(self, message: str, *, option: str = "", value: object = None) -> None:
        super().__init__(message)
        self.option, self.value = option, value

    @classmethod
    def not_one_of(
        cls, option: str, value: object, choices: Iterable[object]
    ) -> InvalidOptionError:
        """Return the error of a value that is not in a set of choices; it names the nearest."""
        names = [str(choice) for choice in choices]
        return cls(
            f"{option} must be one of {', '.join(names)}; it is"
            f" {shown(value)}{nearest_of(value, names)}",
            option=option,
            value=value,
        )

    @classmethod
    def out_of_range(cls, option: str, value: object, required: str) -> InvalidOptionError:
        """Return the error of a value out of range; `required` ends "<option> must be ..."."""
        return cls(f"{option} must be {required}; it is {shown(value)}", option=option, value=value)


def require_positive(**options: float) -> None:
    """Raise `InvalidOptionError` for the first option that is not above 0 and finite."""
    for option, value in options.items():
        _require_number(option, value)
        if not 0.0 < value <= sys.float_info.max:
            required = "above 0" if value <= 0.0 else "finite"
            raise InvalidOptionError.out_of_range(option, value, required)


def require_at_least(least: float, **options: float) -> None:
    """Raise `InvalidOptionError` for the first option that is below `least` or not finite."""
    for option, value in options.items():
        _require_number(option, value)
        if not least <= value <= sys.float_info.max:
            required = f"at least {least:g}" if value < least else "finite"
            raise InvalidOptionError.out_of_range(option, value, required)


def _require_number(option: str, value: object) -> None:
    try:
        float(value if not isinstance(value, str | bytes) else "")  # type: ignore[arg-type]
    except OverflowError:  # a whole number beyond floating point
        return
    except (TypeError, ValueError):
        raise InvalidOptionError.out_of_range(option, value, "a number") from None


class InvalidFileError(InvalidInputError):
    """A file that is missing, unreadable, or not of the format that its name promises.

    Attributes
    ----------
    path
        The file.
    field
        Name of the value in it that is wrong, such as ``friction`` or ``grasps[0]``.
    """

    def __init__(self, message: str, *, path: Path | None = None, field: str = "") -> None:
        super().__init__(message)
        self.path, self.field = path, field

    @classmethod
    def of(cls, path: Path, reason: str) -> InvalidFileError:
        """Return the error of a file with a sentence that begins with its path."""
        return cls(f"{path} {reason}", path=path)

    @classmethod
    def unreadable(cls, path: Path, error: OSError) -> InvalidFileError:
        """Return the error of a file that the system does not read."""
        cure = ": standard input is not read; write it to a file" if str(path) == "-" else ""
        return cls(f"cannot read {path}: {error.strerror or error}{cure}", path=path)


class EstimationError(LisGraspError):
    """A surface that could not be estimated or meshed from valid contacts."""


class TooManyBadContactsError(EstimationError):
    """Contacts more than a quarter of which contradict the others.

    Attributes
    ----------
    bad, count
        Numbers of bad and of all contacts.
    """

    def __init__(self, message: str, *, bad: int = 0, count: int = 0) -> None:
        super().__init__(message)
        self.bad, self.count = bad, count


class PluginError(EstimationError):
    """An error that a plug-in raised: an estimator, a policy or a hand. The cause is chained.

    Attributes
    ----------
    plugin
        The name that the user gave.
    """

    def __init__(self, message: str, *, plugin: str = "") -> None:
        super().__init__(message)
        self.plugin = plugin


class FailedCheckError(InvalidInputError):
    """A claim of `lis_grasp.testing` that an estimator, a policy or a hand does not meet.

    Attributes
    ----------
    failures
        Sentences by the names of the checks that failed.
    """

    def __init__(self, message: str, *, failures: Mapping[str, str] | None = None) -> None:
        super().__init__(message)
        self.failures = dict(failures or {})


class NoGraspError(LisGraspError):
    """A search that found no grasp."""


class SimulationError(LisGraspError):
    """A simulation that diverged or could not be set up."""


class OutputError(LisGraspError):
    """Standard output that cannot be written to: its disk is full, or its reader has ended."""


@contextmanager
def needed_package(name: str, extra: str, *, option: str = "") -> Iterator[None]:
    """Turn a failed import into an InvalidOptionError; `extra` is one of this package."""
    try:
        yield
    except ImportError:
        raise _missing(name, extra, option) from None


def require_packages(*names: str, extra: str, option: str = "") -> None:
    """Raise the error of `needed_package` for the first package that is not installed."""
    for name in names:
        if find_spec(name) is None:
            raise _missing(name, extra, option)


def _missing(name: str, extra: str, option: str) -> InvalidOptionError:
    return InvalidOptionError(
        f"{option or 'this'} needs {name}, which is not installed: bash bootstrap.sh {extra}"
        f" in a clone, or pip install 'lis-grasp[{extra}]'",
        option=option,
    )
