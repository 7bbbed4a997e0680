"""Fields that a message of the library names are options in the messages of the command line."""

from pathlib import Path

import pytest

from lis_grasp.cli.main import main
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


@pytest.mark.parametrize("flag", ["--table", "--support-height", "--suport"])
def test_a_guessed_option_of_the_table_is_answered(
    flag: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("estimate", "grasp", "next"):
        with pytest.raises(SystemExit) as left:
            main([verb, "contacts.csv", flag, "0"])
        assert left.value.code == 2
        assert "'--support'" in capsys.readouterr().err
