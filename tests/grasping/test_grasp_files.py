import json
from pathlib import Path

import numpy as np
import pytest

from lis_grasp import Grasp, GraspSearch
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError


def make_grasp(**changes: object) -> Grasp:
    fields: dict[str, object] = {
        "hand": "wsg50",
        "X_OH": np.eye(4),
        "joint_names": ("left_slide", "right_slide"),
        "joint_positions": [0.1 / 3.0, 0.02],
        "pregrasp_positions": [0.05, 0.05],
        "approach_O": [0.0, 0.0, -1.0],
        "contact_points": [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]],
        "contact_normals": [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
        "contact_fingers": ("left", "right"),
        "contact_forces": [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        "quality": {"epsilon": 0.25},
        "accepted": "force closure",
    }
    return Grasp(**(fields | changes))  # type: ignore[arg-type]


def test_a_saved_search_loads_to_the_last_bit(tmp_path: Path) -> None:
    search = GraspSearch((make_grasp(),), {"steep": 3}, 7)
    search.save(tmp_path / "g.json", header="who made it")
    loaded = GraspSearch.load(tmp_path / "g.json")
    assert loaded.candidates == 7
    assert dict(loaded.rejections) == {"steep": 3}
    first, again = search.grasps[0], loaded.grasps[0]
    for name in (
        "X_OH",
        "joint_positions",
        "pregrasp_positions",
        "contact_points",
        "contact_forces",
    ):
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
    assert again.contact_fingers == ("left", "right")
    assert dict(again.quality) == {"epsilon": 0.25}


def test_equal_searches_write_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        GraspSearch((make_grasp(),), {"b": 1, "a": 2}, 3).save(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_file_says_its_frames_and_units(tmp_path: Path) -> None:
    GraspSearch(()).save(tmp_path / "g.json")
    content = json.loads((tmp_path / "g.json").read_text())
    assert content["units"]["length"] == "m"
    assert "O" in content["frames"]


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("{", ""),
        ("{}", "grasps"),
        ('{"grasps": [1], "rejections": {}, "candidates": 0}', "grasps[0]"),
        ('{"grasps": [], "rejections": [], "candidates": 0}', "rejections"),
    ],
)
def test_a_file_that_holds_no_grasps_is_refused(tmp_path: Path, text: str, field: str) -> None:
    (tmp_path / "g.json").write_text(text)
    with pytest.raises(InvalidFileError) as error:
        GraspSearch.load(tmp_path / "g.json")
    assert (error.value.path, error.value.field) == (tmp_path / "g.json", field)


@pytest.mark.parametrize(
    "change",
    [
        {"X_OH": np.eye(3)},
        {"joint_positions": [0.1]},
        {"contact_points": [[np.nan, 0, 0], [0, 0, 0]]},
        {"quality": {}},
        {"quality": {"epsilon": np.nan}},
    ],
)
def test_a_grasp_that_contradicts_itself_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(InvalidOptionError):
        make_grasp(**change)


def test_a_grasp_cannot_be_changed() -> None:
    grasp = make_grasp()
    with pytest.raises(ValueError, match="read-only"):
        grasp.X_OH[0, 0] = 2.0


def test_a_family_is_kept_and_files_without_one_hold_pinches(tmp_path: Path) -> None:
    path = tmp_path / "g.json"
    GraspSearch((make_grasp(family="rim"),)).save(path)
    assert GraspSearch.load(path).best.family == "rim"
    content = json.loads(path.read_text())
    del content["grasps"][0]["family"]
    path.write_text(json.dumps(content))
    assert GraspSearch.load(path).best.family == "pinch"
    content["grasps"][0]["family"] = "toss"
    path.write_text(json.dumps(content))
    with pytest.raises(InvalidFileError) as error:
        GraspSearch.load(path)
    assert (error.value.path, error.value.field) == (path, "family")
