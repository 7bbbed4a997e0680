"""Progress of stages as bars."""

from __future__ import annotations

import pytest

from lis_grasp import pipeline
from lis_grasp.exceptions import InvalidOptionError


def test_without_the_library_bars_are_refused_before_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("lis_grasp.exceptions.find_spec", lambda name: None)
    with pytest.raises(InvalidOptionError) as error:
        pipeline.Bars()
    assert error.value.option == "progress"


def test_a_bar_shows_the_steps_and_the_result_of_a_stage(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("tqdm")
    bars = pipeline.Bars()
    with bars.stage("Touching") as stage:
        stage.count(3, 12)
        stage.note("the object moved")
        stage.count(12, 12)
        stage.result = "12 contacts"
    bars.say("done")
    told = capsys.readouterr()
    shown = told.err.replace("\r", "\n").splitlines()
    assert any("Touching" in line and "3/12" in line for line in shown)
    assert "12/12" in shown[-1] or "12/12" in shown[-2]
    assert "12 contacts" in told.err
    assert told.out.splitlines() == ["Touching: the object moved", "done"]
