"""The verb `compare`: options, errors, and a small study from end to end."""

from __future__ import annotations

import html
import json
import sys
from pathlib import Path

import pytest
import yaml

from lis_grasp import shapes
from lis_grasp.cli.main import main
from lis_grasp_studies.cli.compare import QUICK
from lis_grasp_studies.study.columns import blank_row
from lis_grasp_studies.study.results import StudyResults
from lis_grasp_studies.study.study import Study, load_study

pytest.importorskip("pyarrow", reason="needs lis-grasp[study]")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--seeds", "0"], "seeds"),
        (["--jobs", "0"], "--jobs"),
        (["--estimators", "lis"], "reference"),
        (["--objects", "bx"], "'bx'"),
        (["--noise", "much"], "noise"),
        (["--study", "none.yaml"], "none.yaml"),
        (["--quick", "--study", "none.yaml"], "--study"),
        (["--jobs", "2", "--scheduler", "tcp://x:1"], "--jobs"),
        (["--rerun", "abc"], "abc"),
        (["--report-only"], "rows"),
        (["--report-only", "--jobs", "2"], "--jobs"),
        (["--objects", "no.stl"], "no.stl"),
        (["--objects", "a/box.stl", "b/box.stl"], "box.stl"),
    ],
)
def test_an_invalid_study_exits_with_2_and_names_the_option(
    tmp_path: Path, arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *arguments, "--output", str(tmp_path)]) == 2
    assert word in capsys.readouterr().err


def test_the_schema_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "--schema"]) == 0
    assert "objects" in json.loads(capsys.readouterr().out)["properties"]


def test_the_quick_study_is_valid() -> None:
    study = Study.from_facts(QUICK)
    assert study.reference in study.estimators
    assert {True, False} == {name in ("sphere", "torus") for name in study.objects}


def block_results(folder: Path) -> tuple[Path, Path]:
    """Return a folder with rows and study.yaml of a block in a mesh file, and that file."""
    results, block = folder / "results", folder / "meshes" / "block.stl"
    block.parent.mkdir()
    shapes.build("box", 0.1).mesh.export(block)
    study = Study(objects=(str(block),), estimators=("gpis", "blend"), touches=(6,), seeds=(0,))
    stored, box = StudyResults(results), shapes.build("box")
    for job in stored.missing(study):
        rows = [blank_row(job.trial, name, box) for name in job.variants]
        stored.lines.append([row | {"reason": "no_grasp"} for row in rows])
    (results / "study.yaml").write_text("# mine\n" + yaml.safe_dump(study.facts()))
    return results, block


@pytest.mark.slow
def test_a_folder_is_enough_to_make_its_report(tmp_path: Path) -> None:
    results, _ = block_results(tmp_path)
    described = results / "study.yaml"
    assert main(["compare", "--report-only", "--output", str(results)]) == 0
    assert described.read_text().startswith("# mine")
    again = f"lis-grasp compare --study {described} --output {results}"
    assert again in html.unescape((results / "report.html").read_text())
    # With another list of estimators it is another study, and the file says so.
    arguments = ["--study", str(described), "--estimators", "gpis", "--output", str(results)]
    assert main(["compare", "--report-only", *arguments]) == 0
    assert load_study(described)["estimators"] == ["gpis"]


@pytest.mark.slow
def test_a_row_of_a_moved_file_is_repeated_and_a_difference_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results, block = block_results(tmp_path)
    moved = block.parent.rename(tmp_path / "moved")
    key = StudyResults(results).read()[0]["key"]
    assert main(["compare", "--rerun", key, "--output", str(results)]) == 2
    assert "cannot read" in capsys.readouterr().err
    arguments = ["--rerun", key, "--meshes", str(moved), "--output", str(results)]
    # Found, and run; its row differs from the fake one.
    assert main(["compare", *arguments]) == 1
    assert "differs from the recorded one" in capsys.readouterr().err


TINY = ["--objects", "box", "--estimators", "gpis", "blend", "--touches", "8"]
TINY += ["--noise", "none", "--seeds", "2", "--jobs", "1"]


@pytest.mark.parametrize("package", ["pyarrow", "statsmodels"])
def test_a_missing_package_of_the_report_is_found_before_the_first_trial(
    tmp_path: Path,
    package: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    assert main(["compare", *TINY, "--output", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert package in error
    assert "bash bootstrap.sh study" in error
    assert not (tmp_path / "rows.jsonl").exists()


@pytest.mark.slow
def test_one_estimator_is_added_and_a_list_replaces_those_of_the_study(tmp_path: Path) -> None:
    results, _ = block_results(tmp_path)
    compared = ["compare", "--report-only", "--output", str(results)]
    for options, expected in (
        (["--estimator", "lis"], ["gpis", "blend", "lis"]),
        (["--estimators", "gpis", "lis"], ["gpis", "lis"]),
    ):
        assert main([*compared, *options]) == 0
        assert load_study(results / "study.yaml")["estimators"] == expected
