"""Help of the command line: meanings of names, groups of options, and examples that parse."""

import shlex

import pytest

from lis_grasp.cli.examples import EXAMPLES
from lis_grasp.cli.main import _CORE_VERBS, _verb_registry, build_parser, main
from lis_grasp.exploration import POLICIES
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp.surfaces.estimators import ESTIMATOR_MEANINGS
from lis_grasp.task.decide import POLICY_MEANINGS
from lis_grasp.task.task import PARTS, Task, task_options

ADDED = {name: _verb_registry().find(name) for name in _verb_registry().names[len(_CORE_VERBS) :]}
EXAMPLES_OF_ALL = {**EXAMPLES, **{name: module.EXAMPLES for name, module in ADDED.items()}}


@pytest.mark.parametrize("verb", EXAMPLES_OF_ALL)
def test_the_examples_of_a_verb_can_be_parsed(verb: str) -> None:
    assert EXAMPLES_OF_ALL[verb]
    for call, _ in EXAMPLES_OF_ALL[verb]:
        build_parser(verb).parse_args([verb, *shlex.split(call)])


def test_examples_are_of_existing_verbs() -> None:
    assert set(EXAMPLES) == set(_CORE_VERBS)


def test_the_studies_add_their_verbs() -> None:
    assert set(ADDED) >= {"compare", "paper", "surfaces"}


def test_the_core_has_its_verbs_where_no_package_adds_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("lis_grasp.plugins._registered", lambda group, path: {})
    with pytest.raises(SystemExit):
        main(["--help"])
    listed = capsys.readouterr().out
    assert all(f"\n    {verb}" in listed for verb in _CORE_VERBS)
    assert not any(f"\n    {verb}" in listed for verb in ADDED)
    assert main(["compare", "--quick"]) == 2
    assert "VERB must be one of run" in capsys.readouterr().err


def test_help_explains_every_estimator_and_policy(capsys: pytest.CaptureFixture[str]) -> None:
    assert ESTIMATOR_MEANINGS.keys() == ESTIMATORS.keys()
    assert POLICY_MEANINGS.keys() == POLICIES.keys()
    with pytest.raises(SystemExit):
        build_parser("run").parse_args(["run", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    for name, meaning in {**ESTIMATOR_MEANINGS, **POLICY_MEANINGS}.items():
        assert f"{name} ({meaning})" in said


def test_an_option_of_the_parser_is_declared_with_its_field() -> None:
    declared = task_options()
    assert list(declared) == list(Task().facts())
    documented = "".join(str(record.__doc__) for record in PARTS.values())
    for name, option in declared.items():
        assert option.help, name
        assert name == "seed" or f"    {name}\n        {option.help}." in documented
