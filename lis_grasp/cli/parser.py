"""Parser of the command line whose errors are one sentence, with what to write instead."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from lis_grasp.exceptions import UNIT_NAMES, InvalidOptionError, nearest_of, shown
from lis_grasp.guesses import advice, advice_on_option


class Parser(argparse.ArgumentParser):
    """Parser whose errors are one sentence, without the list of all options."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        # An option's beginning may be another program's option: --position is no noise.
        super().__init__(*arguments, **{"allow_abbrev": False, **options})
        self.register("type", int, _converter(int, "a whole number"))
        self.register("type", float, _converter(float, "a number"))

    def error(self, message: str) -> NoReturn:
        """Exit with 2 and one sentence: of argparse's message, what is required and what came."""
        message = re.sub(r"^argument (\S+): must", r"\1 must", message)
        if (missing := re.match(r"argument (--[\w-]+).*: expected ", message)) is not None:
            (of,) = (a for a in self._actions if missing[1] in a.option_strings)
            message += f": {(of.help or '').split(';')[0]}"
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
                or self._unflagged(flag)
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

    def _unflagged(self, word: str) -> str:
        """Return the end of a message on an argument without a flag: which ones there are."""
        if word.startswith("-"):
            return ""
        return f": arguments without a flag are {', '.join(self._own()) or 'not taken'}"

    def _own(self) -> list[str]:
        """Return the names of arguments without a flag."""
        return [str(a.metavar) for a in self._actions if not a.option_strings and a.metavar]

    def _positional(self, flag: str) -> str:
        """Return the end of a message on a name without its flag, or a flag of a name without."""
        from lis_grasp.robots.shipped_models import READY_ARMS, READY_HANDS

        for option, names in (("--hand", READY_HANDS), ("--arm", READY_ARMS)):
            if flag in names and option in self.format_usage():
                return f": use {option} {flag}"
        own = self._own()
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
            raise argparse.ArgumentError(None, str(not_one_of(name, value, action.choices)))


def not_one_of(name: str, value: str, choices: Iterable[str]) -> InvalidOptionError:
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
