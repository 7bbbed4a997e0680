"""Types of recorded facts: those of the configuration, for every option."""

import json
from pathlib import Path

import pytest

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.pipeline import RunConfig
from lis_grasp.results.folder import read_touches
from lis_grasp.task.recorded_facts import RecordedFacts, read_facts


def _file_with(tmp_path: Path, **facts: object) -> Path:
    path = tmp_path / "any.json"
    path.write_text(json.dumps({"header": "lis_grasp " + json.dumps(facts)}))
    return path


@pytest.mark.parametrize("name", sorted(RecordedFacts.model_fields))
@pytest.mark.parametrize("value", [{"a": 1}, [["x"]], float("nan"), -(10**400)])
def test_a_fact_of_another_type_is_refused_by_its_name(
    tmp_path: Path, name: str, value: object
) -> None:
    with pytest.raises(InvalidFileError) as error:
        read_facts(_file_with(tmp_path, **{name: value}))
    assert error.value.field.split("[")[0] == name
    log = tmp_path / "touches.jsonl"
    log.write_text(json.dumps({"touch_log": 1, name: value}) + "\n")
    with pytest.raises(InvalidFileError) as error:
        read_touches(log)
    assert error.value.path == log


def test_every_option_of_a_run_has_a_type_in_headers() -> None:
    facts = RunConfig(pose="stable", region=(0.1, 0.2, 0.3)).facts()
    assert facts.keys() <= RecordedFacts.model_fields.keys()
    RecordedFacts.model_validate(facts)
