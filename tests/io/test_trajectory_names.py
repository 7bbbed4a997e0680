"""Names of joints in the files of a trajectory: texts, whatever YAML or CSV make of them."""

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

from lis_grasp.io.trajectory_files import write_joint_trajectory, write_trajectory_csv
from lis_grasp.io.yaml_files import word

_NAMES = ("1", "010", "1e3", "on", "off", "no", "y", "left: joint", "[right]", "a # b", "~", "null")
_NAMES += ("2024-01-01", "1:30", "'", '"', "-", "- x", "{a", "&a", "*b", "!c", "%d", "@e", "`f")
_NAMES += ("夹爪", "häng", "😀: x", "", " a ", "a,b", "0x1F", ".inf", "=", "<<", "a\tb")


@pytest.mark.parametrize("name", _NAMES)
def test_a_word_is_read_as_the_text_that_was_written(name: str) -> None:
    assert yaml.safe_load(f"- {word(name)}") == [name]
    assert yaml.safe_load(f"{word(name)}: 1") == {name: 1}


def test_names_of_joints_are_the_same_texts_when_they_are_read(tmp_path: Path) -> None:
    times = np.array([0.0, 1.0])
    states = np.zeros((2, len(_NAMES)))
    write_joint_trajectory(tmp_path / "a.yaml", _NAMES, times, states, states, states)
    written = yaml.safe_load((tmp_path / "a.yaml").read_text("utf-8"))
    assert written["joint_names"] == list(_NAMES)
    write_trajectory_csv(tmp_path / "a.csv", _NAMES, times, states, states)
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["time", *_NAMES, *(f"{name}_velocity" for name in _NAMES)]
    assert [len(row) for row in rows] == [len(header)] * 2
