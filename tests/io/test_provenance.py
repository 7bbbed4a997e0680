import json
from pathlib import Path

import pytest

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io import provenance


def test_facts_survive_a_ply_header(tmp_path: Path) -> None:
    path = tmp_path / "any.ply"
    line = provenance.describe(seed=3, object="box")
    path.write_text(f"ply\nformat ascii 1.0\ncomment {line}\nelement vertex 0\nend_header\n")
    facts = provenance.read(path)
    assert facts["seed"] == 3
    assert facts["object"] == "box"


def test_facts_survive_a_json_file(tmp_path: Path) -> None:
    path = tmp_path / "any.json"
    path.write_text(json.dumps({"header": provenance.describe(seed=7)}))
    assert provenance.read(path)["seed"] == 7


def test_a_later_stage_inherits_and_overrides(tmp_path: Path) -> None:
    facts = provenance.parse(provenance.merge({"seed": 1, "hand": "a", "version": "0"}, hand="b"))
    assert facts["seed"] == 1
    assert facts["hand"] == "b"
    assert facts["version"] != "0"


@pytest.mark.parametrize("text", ["", "a comment", "lis_grasp {broken", "lis_grasp [1]"])
def test_other_headers_have_no_facts(text: str) -> None:
    assert provenance.parse(text) == {}


def test_files_of_other_programs_have_no_facts(tmp_path: Path) -> None:
    path = tmp_path / "any.json"
    path.write_text("[1, 2")
    assert provenance.read(path) == {}


def test_a_folder_is_refused_with_the_file_in_it_that_is_usual(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError) as error:
        provenance.read(tmp_path)
    assert error.value.path == tmp_path
    assert "contacts.ply" not in str(error.value)
    for name in ("contacts.ply", "surface.ply"):
        (tmp_path / name).touch()
        with pytest.raises(InvalidFileError, match=str(tmp_path / name)):
            provenance.read(tmp_path, usual=name)


def _file_with(tmp_path: Path, **facts: object) -> Path:
    path = tmp_path / "any.json"
    path.write_text(json.dumps({"header": "lis_grasp " + json.dumps(facts)}))
    return path


def test_facts_of_later_versions_are_kept(tmp_path: Path) -> None:
    assert provenance.read(_file_with(tmp_path, seed=1, invented=[1])) == {
        "seed": 1,
        "invented": [1],
    }


def test_a_path_may_contain_the_end_of_a_ply_header(tmp_path: Path) -> None:
    path = tmp_path / "any.ply"
    line = provenance.describe(cloud="/data/end_header/c.ply", seed=3)
    path.write_text(f"ply\nformat ascii 1.0\ncomment {line}\nelement vertex 0\nend_header\n")
    assert provenance.read(path)["seed"] == 3
