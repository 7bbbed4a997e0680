"""The table of hands: one line each, whether its model is installed or not."""

from pathlib import Path

import pytest
import yaml

from lis_grasp.robots.shipped_models import model_path
from lis_grasp_studies.hand_table import HandTable


def test_a_hand_without_its_model_has_a_line_that_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("LIS_GRASP_MODELS", "ROS_PACKAGE_PATH"):
        monkeypatch.delenv(variable, raising=False)
    table = HandTable(["shadow"], ["box"], seeds=1, touches=5).run(tmp_path)
    document = yaml.safe_load(model_path("hands/vendors/shadow.yaml").read_text())
    assert document["model_from"] in table
    assert not list(tmp_path.iterdir())  # nothing was run


def test_the_table_counts_held_trials_of_each_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [
        {"hand": hand, "held": held, "seconds_grasp": seconds}
        for hand, held, seconds in [
            ("wsg50", True, 2.0),
            ("wsg50", False, None),
            ("wsg50", True, 4.0),
            ("barrett", False, 7.0),
        ]
    ]
    monkeypatch.setattr(HandTable, "_rows", lambda *_: rows)
    table = HandTable(["wsg50", "barrett"], ["box"], seeds=1, touches=5).run(tmp_path)
    assert "| `wsg50` | ok | 3 s | 2 of 3 |" in table
    assert "| `barrett` | ok | 7 s | 0 of 1 |" in table
