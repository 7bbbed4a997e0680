"""The verb `compare`: refused options, and a small study from end to end."""

from __future__ import annotations

import html
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from lis_grasp import shapes
from lis_grasp.cli.compare import QUICK
from lis_grasp.cli.main import main
from lis_grasp.experiments.study import study_trial as trial_module
from lis_grasp.experiments.study.scheduling import InProcess, run_study
from lis_grasp.experiments.study.study import Study
from lis_grasp.experiments.study.study_file import load_study
from lis_grasp.experiments.study.study_results import StudyResults, without_times
from lis_grasp.experiments.study.study_trial import Job
from lis_grasp.io.json_lines import Row

pytest.importorskip("pyarrow", reason="needs lis-grasp[study]")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--seeds", "0"], "seeds"),
        (["--jobs", "0"], "--jobs"),
        (["--estimators", "lis"], "gpis"),
        (["--objects", "bx"], "bx"),
        (["--noise", "much"], "noise"),
        (["--study", "none.yaml"], "none.yaml"),
        (["--quick", "--study", "none.yaml"], "--study"),
        (["--jobs", "2", "--scheduler", "tcp://x:1"], "--jobs"),
        (["--rerun", "abc"], "key"),
        (["--report-only"], "rows"),
        (["--objects", "no.stl"], "no.stl"),
        (["--objects", "a/box.stl", "b/box.stl"], "name"),
    ],
)
def test_an_invalid_study_exits_with_2_and_names_the_option(
    tmp_path: Path, arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *arguments, "--output", str(tmp_path)]) == 2
    assert named in capsys.readouterr().err


def test_the_quick_study_is_valid() -> None:
    study = Study.from_facts(QUICK)
    assert study.reference in study.estimators
    assert {True, False} == {name in ("sphere", "torus") for name in study.objects}


@pytest.mark.slow
def test_report_only_and_rerun_use_the_study_file_of_the_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def named_rows(job: Job) -> list[Row]:
        box = shapes.build("box")
        return [
            trial_module._blank_row(job.trial, job.setup, name, box) | {"reason": "no_grasp"}
            for name in job.estimators
        ]

    results, block = tmp_path / "results", tmp_path / "meshes" / "block.stl"
    block.parent.mkdir()
    shapes.build("box", 0.1).mesh.export(block)
    study = Study(objects=(str(block),), estimators=("gpis", "blend"), touches=(6,), seeds=(0,))
    list(run_study(study, StudyResults(results), InProcess(), runner=named_rows))
    described = results / "study.yaml"
    described.write_text("# mine\n" + yaml.safe_dump(study.facts()))

    assert main(["compare", "--report-only", "--output", str(results)]) == 0
    assert described.read_text().startswith("# mine")
    again = f"lis-grasp compare --study {described} --output {results}"
    assert again in html.unescape((results / "report.html").read_text())
    # Other estimators are another study, so the file is written again.
    arguments = ["--study", str(described), "--estimators", "gpis", "--output", str(results)]
    assert main(["compare", "--report-only", *arguments]) == 0
    assert load_study(described)["estimators"] == ["gpis"]

    moved = block.parent.rename(tmp_path / "moved")
    key = StudyResults(results).read()[0]["key"]
    capsys.readouterr()
    assert main(["compare", "--rerun", key, "--output", str(results)]) == 2
    assert "cannot read" in capsys.readouterr().err
    arguments = ["--rerun", key, "--meshes", str(moved), "--output", str(results)]
    # The row is found and run, and differs from the fake one.
    assert main(["compare", *arguments]) == 1
    assert "differs from the recorded one" in capsys.readouterr().err


TINY = ["--objects", "box", "--estimators", "gpis", "blend", "--touches", "8"]
TINY += ["--noise", "none", "--seeds", "2", "--jobs", "1"]


@pytest.mark.slow
def test_a_killed_study_continues_to_the_same_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [sys.executable, "-m", "lis_grasp.cli.main", "compare", *TINY, "--output"]
    process = subprocess.Popen([*command, str(tmp_path / "killed")])
    results = StudyResults(tmp_path / "killed")
    while not results.keys():
        assert process.poll() is None
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    first = {path: path.stat().st_mtime_ns for path in (tmp_path / "killed/rows").iterdir()}
    assert 1 <= len(results.keys()) < 4

    for folder in ("killed", "plain"):
        assert main(["compare", *TINY, "--output", str(tmp_path / folder)]) == 0
    assert all(path.stat().st_mtime_ns == at for path, at in first.items() if path.exists())
    study = Study.from_facts(load_study(tmp_path / "plain" / "study.yaml"))
    rows = [StudyResults(tmp_path / folder).of(study) for folder in ("killed", "plain")]
    assert len(rows[0]) == 4
    assert [without_times(r) for r in rows[0]] == [without_times(r) for r in rows[1]]
    for name in ("comparisons.csv", "losses.csv", "reasons.tex", "report.html"):
        same = [(tmp_path / folder / name).read_text() for folder in ("killed", "plain")]
        assert same[0].replace("/killed", "/plain") == same[1]

    capsys.readouterr()
    key = rows[0][0]["key"]
    assert main(["compare", "--rerun", key[:8], "--output", str(tmp_path / "killed")]) == 0
    assert "equal to the recorded row" in capsys.readouterr().err
