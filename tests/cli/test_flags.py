"""Fields that a message of the library names are options in the messages of the command line."""

import argparse
import ast
import re
from pathlib import Path

import pytest

import lis_grasp
from lis_grasp.cli.main import build_parser, main
from lis_grasp.cli.progress import with_flags


def test_a_field_is_written_as_the_option_of_it() -> None:
    assert with_flags("give `position_noise`, or another `folder`") == (
        "give --position-noise, or another --output"
    )
    assert with_flags("load it with `shapes.load`, or `lis-grasp run`") == (
        "load it with `shapes.load`, or `lis-grasp run`"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["box", "--touches", "0"], "--touches must be at least 1"),
        (["box", "--units", "mm"], "the largest extent is --size"),
        (["box", "--until-coverage=2"], "--until-coverage must be above 0"),
    ],
)
def test_an_error_names_the_option(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", *arguments, "--output", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err


def _options(parser: argparse.ArgumentParser) -> set[str]:
    """Return the names of all options and verbs of a parser."""
    found: set[str] = set()
    for action in parser._actions:
        found |= {flag.lstrip("-").replace("-", "_") for flag in action.option_strings}
        if isinstance(action, argparse._SubParsersAction):
            for name, each in action.choices.items():
                found |= {name} | _options(each)
    return found


def test_a_word_in_backquotes_of_a_message_is_an_option_or_a_verb() -> None:
    known = _options(build_parser()) | {"folder"}  # which is --output
    package = Path(lis_grasp.__file__).parent
    for path in sorted(package.rglob("*.py")):
        tree = ast.parse(path.read_text("utf-8"))
        docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                words = re.findall(r"`([a-z]+(?:_[a-z]+)*)`", node.value)
                if id(node) not in docstrings:
                    assert set(words) <= known, (path.name, node.lineno)


@pytest.mark.parametrize("flag", ["--table", "--support-height", "--suport"])
def test_a_guessed_option_of_the_table_is_answered(
    flag: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("estimate", "grasp", "next"):
        with pytest.raises(SystemExit) as left:
            main([verb, "contacts.csv", flag, "0"])
        assert left.value.code == 2
        assert re.search("(use --support|'--support'[?]); see", capsys.readouterr().err)
