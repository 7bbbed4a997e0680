"""Help of the command line: meanings of names, groups of options, and examples that parse."""

import shlex

import pytest

from lis_grasp.cli import options
from lis_grasp.cli.examples import EXAMPLES
from lis_grasp.cli.main import _VERBS, build_parser
from lis_grasp.exploration import POLICIES
from lis_grasp.surfaces import ESTIMATORS

VERBS = [name for name, _, _ in _VERBS]


@pytest.mark.parametrize("verb", VERBS)
def test_the_examples_of_a_verb_can_be_parsed(verb: str) -> None:
    assert EXAMPLES[verb]
    for call, _ in EXAMPLES[verb]:
        build_parser(verb).parse_args([verb, *shlex.split(call)])


def test_examples_are_of_existing_verbs() -> None:
    assert set(EXAMPLES) == set(VERBS)


def test_help_explains_every_estimator_and_policy(capsys: pytest.CaptureFixture[str]) -> None:
    assert options._ESTIMATOR_HELP.keys() == ESTIMATORS.keys()
    assert options._POLICY_HELP.keys() == POLICIES.keys()
    with pytest.raises(SystemExit):
        build_parser("run").parse_args(["run", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    for name, meaning in {**options._ESTIMATOR_HELP, **options._POLICY_HELP}.items():
        assert f"{name} ({meaning})" in said


def test_an_option_is_in_one_group_at_most() -> None:
    grouped = [name for members in options._GROUPS.values() for name in members]
    assert len(grouped) == len(set(grouped))
    assert set(grouped) <= set(options._OPTIONS)
